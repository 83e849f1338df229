"""Crops that a GPU uses again while the next are being made."""

import time

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from muybridge.geometry.landmarks.marker_sets import SURFACE  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.train.keypoints import data_echoing as echo  # noqa: E402
from muybridge.train.keypoints.data_echoing import Echo, augment  # noqa: E402

SIDE, COUNT = 96, len(BODY23) + len(SURFACE)
LEFT, RIGHT = BODY23.index("left_wrist"), BODY23.index("right_wrist")
CPU = torch.device("cpu")


def crops(count):
    """Crops with a bright spot in each channel at the left wrist, and where it is."""
    rng = np.random.default_rng(5)
    pixels = torch.zeros(count, 4, SIDE, SIDE, dtype=torch.uint8)
    landmarks = torch.full((count, COUNT, 2), torch.nan)
    for k, (x, y) in enumerate(rng.integers(20, SIDE - 20, (count, 2))):
        pixels[k, :, y - 2 : y + 3, x - 2 : x + 3] = 200
        landmarks[k, LEFT] = torch.tensor([float(x), float(y)])
    return pixels, landmarks, landmarks.isfinite().all(-1)


def centre(image):
    """(x, y) of what is bright."""
    y, x = torch.meshgrid(torch.arange(SIDE), torch.arange(SIDE), indexing="ij")
    weight = image.float()
    return torch.stack([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


def test_landmarks_follow_augmented_crops():
    pixels, landmarks, visible = crops(64)
    new, at, seen = augment(pixels, landmarks, visible, np.random.default_rng(1))
    assert new.dtype == torch.uint8 and new.shape == pixels.shape
    mirrored = 0
    for k in range(64):
        name = int(seen[k].nonzero())
        assert name in (LEFT, RIGHT)
        mirrored += name == RIGHT
        for layer in (new[k, :3].sum(0), new[k, 3]):
            assert (centre(layer) - at[k, name]).norm() < 0.15
    assert 15 < mirrored < 50
    assert (at.isfinite().all(-1) == seen).all(), "what was unknown stays unknown"


def test_half_of_the_augmented_crops_stay_sharp():
    pixels, landmarks, visible = crops(64)
    new, _, _ = augment(pixels, landmarks, visible, np.random.default_rng(2))
    same = [
        any((new[k, 3] == old).all() for old in (pixels[k, 3], pixels[k, 3].flip(-1)))
        for k in range(64)
    ]  # fmt: skip
    assert 15 < sum(same) < 50


def test_landmarks_moved_out_of_a_crop_become_invisible(monkeypatch):
    monkeypatch.setattr(echo, "_SHIFT_SD", 1.0)
    pixels, landmarks, visible = crops(64)
    _, at, seen = augment(pixels, landmarks, visible, np.random.default_rng(3))
    inside = ((at >= 0) & (at <= SIDE - 1)).all(-1)
    assert (seen == inside).all() and 10 < int(inside.sum()) < 60


def slow_batches(sides):
    for number, side in enumerate(sides):
        time.sleep(0.05)
        yield (
            torch.full((8, 4, side, side), 10 + number, dtype=torch.uint8), torch.full((8, COUNT, 2), 7.0),
            torch.ones(8, COUNT, dtype=torch.bool), torch.full((8,), number),
        )  # fmt: skip


def test_old_crops_are_echoed_until_new_ones_arrive():
    stream = Echo(slow_batches([32, 48, 32, 48]), CPU, times=3, seed=0)
    batches = list(stream)
    numbers = [set(batch[3].tolist()) for batch in batches]
    assert stream.fresh == 32
    new = [n for n, batch in enumerate(batches) if len(numbers[n]) == 1 and (batch[0] == 10 + batch[3][0]).all()]
    assert set().union(*numbers) == {0, 1, 2, 3} and len(new) >= 4
    assert 32 < stream.used <= 3 * 32 + 8
    for batch in batches:
        assert len(batch[0]) == 8
        assert {n % 2 for n in batch[3].tolist()} == {int(batch[0].shape[-1] == 48)}, "sides are not mixed"


def test_errors_of_crop_workers_are_raised():
    def broken():
        yield from slow_batches([32])
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        list(Echo(broken(), CPU, times=2, seed=0))


def test_new_batches_replace_old_ones_when_memory_is_full():
    stream = Echo(slow_batches([32] * 5), CPU, times=1, seed=0)
    first = next(stream)
    stream._free = sum(part.nbytes for part in first)
    list(stream)
    assert len(stream._kept[32]) == 2
