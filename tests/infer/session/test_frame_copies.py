"""Small copies of frames: read in any order, bounded, and gone where a run fails."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.session.frame_copies import CopyWriter, halved, holds, read_copies, times_halved


def _frames(count: int) -> np.ndarray:
    ramp = np.linspace(0, 200, 64 * 48).reshape(48, 64)
    return np.stack([np.repeat((ramp + 2 * k)[..., None], 3, -1) for k in range(count)]).astype(np.uint8)


def test_frames_come_back_in_the_order_asked_for(tmp_path: Path) -> None:
    frames = _frames(20)
    with CopyWriter(path := tmp_path / "frames.jpegs") as copies:
        for frame in frames:
            copies.add(frame)
    chunks = list(read_copies(path, copies.ends, np.array([3, 4, 4, 19])))
    assert np.abs(np.concatenate(chunks).astype(int) - frames[[3, 4, 4, 19]]).max() <= 4
    assert sum(map(len, read_copies(path, copies.ends))) == 20
    assert holds(path, copies.ends)
    path.write_bytes(path.read_bytes()[:-1])
    assert not holds(path, copies.ends)


def test_a_take_that_is_too_long_has_no_copies(tmp_path: Path) -> None:
    with CopyWriter(path := tmp_path / "frames.jpegs", most_bytes=3000) as copies:
        for frame in _frames(20):
            copies.add(frame)
    assert not path.exists() and not len(copies.ends) and holds(path, copies.ends)


def test_a_run_that_fails_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), CopyWriter(tmp_path / "frames.jpegs") as copies:
        copies.add(_frames(1)[0])
        raise RuntimeError
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("size", "times"),
    [((640, 480), 0), ((1280, 720), 1), ((1080, 1920), 1), ((3840, 2160), 2), ((1279, 720), 0), ((1281, 721), 0)],
)
def test_copies_of_large_frames_are_halved_until_they_are_small(size: tuple[int, int], times: int) -> None:
    assert times_halved(*size) == times


def test_halving_averages_two_by_two_pixels() -> None:
    image = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    mean = image.reshape(3, 2, 4, 2, 3).mean((1, 3))
    assert np.abs(halved(image) - mean).max() <= 0.51
