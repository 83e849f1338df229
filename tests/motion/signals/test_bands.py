"""Frequency bands: they add up, unit gains change nothing, and gains change what they should."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import multiply_quat, quat_from_rotvec
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts import feet_of_motion, keep_feet, plant_feet
from muybridge.motion.editing import edit_take, parse_steps
from muybridge.motion.formats import read_file
from muybridge.motion.signals import scale_bands, split_bands
from muybridge.motion.signals.filter_bank import band_range, filter_bank, level_count
from muybridge.motion.take import Take
from tests.motion.editing.clips import CLIPS, FPS, moved_by, turned_by, walk
from tests.paths import DATA


def spinning(turns: float = 2.5, frames: int = 200) -> Motion:
    """The walk of a body that turns around more than once, with a hand that wraps at half a turn."""
    motion = walk(frames)
    angle = np.linspace(0, 2 * np.pi * turns, frames)
    quat = motion.quat_wxyz.copy()
    quat[:, 0] = multiply_quat(quat_from_rotvec(angle[:, None] * np.array([0.0, 0, 1])), quat[:, 0])
    hand = motion.skeleton.index("left_hand")
    swing = np.pi + 0.8 * np.sin(np.arange(frames) / 9)  # through 180 degrees again and again
    quat[:, hand] = quat_from_rotvec(swing[:, None] * np.array([0.6, 0.8, 0.0]))
    return replace(motion, quat_wxyz=quat)  # with sign flips, as files may have them


@pytest.mark.parametrize("clip", [*CLIPS.values(), spinning], ids=[*CLIPS, "spinning"])
def test_unit_gains_change_nothing_and_bands_add_up(clip) -> None:
    motion = clip()
    bands = split_bands(motion)
    same = bands.with_gains([1.0] * len(bands))
    assert turned_by(motion, same) < 1e-10
    assert moved_by(motion, same) < 1e-10
    assert np.abs(bands.rotations.sum(0) + bands.slow_rotations - bands.chart.vectors).max() < 1e-12
    places = bands.positions.sum(0) + bands.slow_positions
    assert np.abs(places[:, 0] - motion.root_positions_world).max() < 1e-12


def test_vectors_are_continuous_at_half_turns() -> None:
    chart = split_bands(spinning()).chart
    assert np.linalg.norm(np.diff(chart.vectors, axis=0), axis=-1).max() < 0.2
    assert np.linalg.norm(chart.vectors, axis=-1).max() < np.radians(120)


def test_a_sine_is_in_the_band_that_its_frequency_lies_in() -> None:
    time = np.arange(1024) / 64
    for band in (2, 3, 4):
        low, high = band_range(band, 64.0)
        bands, _ = filter_bank(np.sin(2 * np.pi * np.sqrt(low * high) * time)[:, None])
        power = (bands[:, 200:-200] ** 2).sum(axis=(1, 2))
        assert int(np.argmax(power)) == band - 1
        assert power[band - 1] > 0.5 * power.sum()


def test_a_gain_scales_a_swing_and_leaves_its_middle() -> None:
    motion = walk(264)
    arm = motion.skeleton.index("left_upper_arm")
    low, high = band_range(5, FPS)
    assert low < FPS / 66 < high  # the stride
    more = scale_bands(motion, [1, 1, 1, 1.5, 1.5, 1.5])
    before, after = (split_bands(m).chart.vectors[40:-40, arm, 0] for m in (motion, more))
    assert np.ptp(after) / np.ptp(before) == pytest.approx(1.5, abs=0.06)
    assert abs(after.mean() - before.mean()) < 0.02
    assert scale_bands(motion, [0.0]).quat_wxyz.shape == motion.quat_wxyz.shape


def test_the_way_over_the_ground_keeps_its_ends() -> None:
    motion = walk()
    away = scale_bands(motion, [0.0] * level_count(len(motion)))
    assert np.allclose(away.root_positions_world[[0, -1]], motion.root_positions_world[[0, -1]], atol=1e-12)


@pytest.mark.parametrize(("words", "message"), [
    ("bands", "gains is missing"), ("bands 1 x", "feet is free or keep"), ("bands 1 2 keep free", "gains is a number"),
])  # fmt: skip
def test_words(words: str, message: str) -> None:
    with pytest.raises(MuybridgeError, match=message):
        parse_steps(words.split())


def test_clips_without_bands_are_refused() -> None:
    with pytest.raises(MuybridgeError, match="the clip has 1 frame; bands need at least 3"):
        split_bands(walk(1))
    with pytest.raises(MuybridgeError, match="5 gains are given, and a clip of 20 frames has 4 bands"):
        scale_bands(walk(20), [1, 1, 1, 1, 2])
    with pytest.raises(MuybridgeError, match="gains must be numbers, not nan"):
        scale_bands(walk(20), [np.nan])


def test_the_step_says_what_it_scales() -> None:
    take, notes = edit_take(Take(motion=walk(60)), parse_steps("bands 1 150% trim 0 10f".split()))
    assert "4.9 to 11 Hz times 1.5, of 5 bands" in notes[0]
    assert len(take.motion) == 10


@pytest.mark.parametrize("gains", [(1, 1, 1.5, 0.5), (1, 1, 1, 1, 2, 2)])
@pytest.mark.parametrize("name", ["02_01", "02_03"])
def test_planted_feet_stay_where_they_stood(name: str, gains: tuple[float, ...]) -> None:
    path = DATA / "motion" / f"{name}.amc"
    if not path.is_file():
        pytest.skip("../shared/data is not here")
    motion = read_file(path).motion
    planted = plant_feet(motion)
    kept = keep_feet(scale_bands(motion, gains), motion)
    before, after = (feet_of_motion(m).places for m in (planted.motion, kept.motion))
    contact = planted.contacts.contact
    assert contact.any()
    assert np.linalg.norm(after - before, axis=-1)[contact].max() < 2e-3
    assert kept.unreached_m < 1e-3


def test_keeping_feet_needs_the_same_frames() -> None:
    with pytest.raises(ValueError, match="frames"):
        keep_feet(walk(20), walk(21))
