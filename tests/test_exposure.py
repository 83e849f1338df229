"""Dark and flat pictures before networks read them."""

import numpy as np
import pytest

from muybridge.infer.exposure import stretch, well_exposed


@pytest.fixture
def picture():
    """A room with somebody in it who takes a hundredth of the picture and is brighter than all else."""
    rng = np.random.default_rng(0)
    room = rng.integers(10, 180, (270, 480, 3)).astype(np.uint8)
    room[100:150, 200:226] = rng.integers(190, 245, (50, 26, 3))
    return room


def stretched(frame):
    frame = frame.copy()
    stretch(frame)
    return frame


def test_a_picture_that_uses_its_range_is_left_alone(picture):
    assert np.array_equal(stretched(picture), picture)


@pytest.mark.parametrize(("gain", "offset"), [(0.2, 0.0), (0.1, 0.0), (0.2, 115.0), (0.2, 205.0)])
def test_dark_and_flat_pictures_are_drawn_apart_and_nobody_is_cut_off(picture, gain, offset):
    poor = (picture * gain + offset).astype(np.uint8)
    after = stretched(poor)
    assert np.ptp(after.astype(int)) > min(130, 4 * np.ptp(poor.astype(int)))
    assert np.corrcoef(after.ravel(), picture.ravel())[0, 1] > 0.98
    # The brightest in the picture keeps its shades: nothing is burnt out.
    person = (slice(100, 150), slice(200, 226))
    assert np.corrcoef(after[person].ravel(), poor[person].ravel())[0, 1] > 0.98


def test_light_that_fades_changes_little_from_frame_to_frame(picture):
    light = np.linspace(1.0, 0.3, 60)
    frames = np.stack([(picture * share).astype(np.uint8) for share in light])
    level = next(well_exposed([frames])).mean((1, 2, 3))
    assert np.abs(np.diff(level)).max() < 4 and level.min() > 0.5 * level.max()


@pytest.mark.parametrize("value", [0, 7, 128, 255])
def test_a_picture_of_one_colour_stays_as_it_is(value):
    frame = np.full((40, 60, 3), value, np.uint8)
    assert np.array_equal(stretched(frame), frame)
