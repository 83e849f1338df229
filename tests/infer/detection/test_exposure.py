"""Dark and flat pictures before networks read them."""

import numpy as np
import pytest

from muybridge.infer.detection.exposure import brighten_crops, stretch_contrast, stretch_frames


@pytest.fixture
def picture():
    """A room with somebody in it who takes a hundredth of the picture and is brighter than all else."""
    rng = np.random.default_rng(0)
    room = rng.integers(10, 180, (270, 480, 3)).astype(np.uint8)
    room[100:150, 200:226] = rng.integers(190, 245, (50, 26, 3))
    return room


def stretched(frame):
    frame = frame.copy()
    stretch_contrast(frame)
    return frame


def test_an_image_that_uses_its_range_is_unchanged(picture):
    assert np.array_equal(stretched(picture), picture)


@pytest.mark.parametrize(("gain", "offset"), [(0.2, 0.0), (0.1, 0.0), (0.2, 115.0), (0.2, 205.0)])
def test_dark_and_flat_images_are_stretched_without_clipping_people(picture, gain, offset):
    poor = (picture * gain + offset).astype(np.uint8)
    after = stretched(poor)
    assert np.ptp(after.astype(int)) > min(130, 4 * np.ptp(poor.astype(int)))
    assert np.corrcoef(after.ravel(), picture.ravel())[0, 1] > 0.98
    # The brightest in the picture keeps its shades: nothing is burnt out.
    person = (slice(100, 150), slice(200, 226))
    assert np.corrcoef(after[person].ravel(), poor[person].ravel())[0, 1] > 0.98


def test_fading_light_changes_the_stretch_gradually(picture):
    light = np.linspace(1.0, 0.3, 60)
    frames = np.stack([(picture * share).astype(np.uint8) for share in light])
    level = next(stretch_frames([frames])).mean((1, 2, 3))
    assert np.abs(np.diff(level)).max() < 4 and level.min() > 0.5 * level.max()


@pytest.mark.parametrize("value", [0, 7, 128, 255])
def test_an_image_of_one_colour_is_unchanged(value):
    frame = np.full((40, 60, 3), value, np.uint8)
    assert np.array_equal(stretched(frame), frame)


def test_a_dark_person_in_front_of_a_window_is_brightened(picture):
    dim = (0.18 * picture[:128, :128]).astype(np.uint8)
    dim[:40, :60] = 255  # the window
    dim[-10:] = 0  # beyond the picture
    crop = np.concatenate([dim, np.full((128, 128, 1), 7, np.uint8)], -1)
    crops = np.stack([crop, crop])
    crops[1, ..., :3] = picture[:128, :128]
    bright = crops[1].copy()
    brighten_crops(crops)
    assert (crops[1] == bright).all()
    gain = crops[0, 60, 60, 0] / max(dim[60, 60, 0], 1)
    assert 2 < gain <= 6 and crops[0, 0, 0, 3] == pytest.approx(7 * gain, abs=1)
    assert (crops[0, -10:, :, :3] == 0).all() and (crops[0, :40, :60, :3] == 255).all()
    shown = crops[0, 41:118, :, :3].max(-1)
    assert 140 < np.quantile(shown, 0.99) < 160


def test_a_lit_person_in_the_dark_is_unchanged(picture):
    crops = (0.18 * picture[None, :128, :128]).astype(np.uint8)
    crops[0, 40:90, 60:70] = 170  # three in a hundred of the crop
    before = crops.copy()
    brighten_crops(crops)
    assert (crops == before).all()


def test_empty_crops_are_unchanged():
    for value in (0, 255):
        crops = np.full((1, 32, 32, 3), value, np.uint8)
        brighten_crops(crops)
        assert (crops == value).all()
