"""Loops close without a seam in pose or velocity."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing import GroundPath, close_loop, find_loop, in_place, loop, with_path, without_path
from muybridge.motion.editing.looping import kept_way
from muybridge.motion.formats.registry import read_file
from tests.motion.editing.clips import CLIPS, PERIOD, walk
from tests.paths import DATA


def _next_round(closed: Motion, way: GroundPath) -> FloatArray:
    """(2, J, 3) where the joints are in the first two frames, once the clip has gone its way."""
    start = closed.select(slice(0, 2))
    first, last = (GroundPath(np.repeat(way.places[k : k + 1] if k == 0 else way.places[-1:], 2, axis=0),
                              np.repeat(way.yaw[:1] if k == 0 else way.yaw[-1:], 2)) for k in (0, 1))  # fmt: skip
    return with_path(without_path(start, first), last).joint_positions_world()


def _check_seam(part: Motion) -> None:
    way, closed = kept_way(part), close_loop(part)
    places, following = closed.joint_positions_world(), _next_round(closed, way)
    assert np.abs(following[0] - places[-1]).max() < 1e-6
    usual = np.linalg.norm(np.diff(places, 2, axis=0), axis=-1)
    step = np.linalg.norm(following[1] - following[0] - (places[-1] - places[-2]), axis=-1)
    assert step.mean() <= np.median(usual.mean(axis=1)) + 1e-9
    assert step.max() <= np.median(usual.max(axis=1)) + 1e-9


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize("moved", [False, True])
def test_no_seam_on_any_skeleton(name: str, moved: bool) -> None:
    motion = CLIPS[name]()
    motion = in_place(motion) if moved else motion
    cut = find_loop(motion)
    _check_seam(motion.select(slice(cut.start, cut.end + 1)))


@pytest.mark.parametrize("start", [0, 17, 40, 71])
def test_no_seam_wherever_the_clip_is_cut(start: int) -> None:
    _check_seam(walk().select(slice(start, start + PERIOD + 9)))


@pytest.mark.parametrize("name", ["motion/02_01.amc", "motion/02_03.amc", "characters/kaykit_knight.glb"])
def test_no_seam_on_recordings(name: str) -> None:
    if not (DATA / name).is_file():
        pytest.skip(f"../shared/data/{name} is not here")
    motion = read_file(DATA / name).motion
    assert motion is not None
    cut = find_loop(motion)
    _check_seam(motion.select(slice(cut.start, cut.end + 1)))


def test_one_stride_is_found() -> None:
    motion = walk()
    cut = find_loop(motion, shortest=0.5, longest=1.6)
    assert abs(cut.end - cut.start - PERIOD) <= 1
    assert abs(find_loop(motion).end - find_loop(motion).start - 2 * PERIOD) <= 1
    assert cut.pose_gap < 0.03


def test_a_long_clip_is_searched_in_two_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = walk()
    exact = find_loop(motion, 0.5, 1.6)
    monkeypatch.setattr("muybridge.motion.editing.looping._MOST_COMPARED", 40)
    coarse = find_loop(motion, 0.5, 1.6)
    assert abs(coarse.end - coarse.start - PERIOD) <= 1
    assert coarse.pose_gap < exact.pose_gap + 0.01


def test_the_way_is_kept_or_closed() -> None:
    motion = walk()
    part = motion.select(slice(0, PERIOD + 1))
    goes = part.root_positions_world[-1] - part.root_positions_world[0]
    kept, closed = close_loop(part), close_loop(part, "close")
    np.testing.assert_allclose((kept.root_positions_world[-1] - kept.root_positions_world[0])[:2], goes[:2], atol=1e-9)
    np.testing.assert_allclose(closed.root_positions_world[-1], closed.root_positions_world[0], atol=1e-9)
    assert np.linalg.norm(goes[:2]) > 1.0
    # What is changed is little: the difference is spread over the clip.
    assert np.linalg.norm(kept.joint_positions_world() - part.joint_positions_world(), axis=-1).max() < 0.06


def test_a_clip_that_turns_goes_on_from_where_it_faces() -> None:
    motion = walk(120)
    path = GroundPath(np.stack([np.sin(np.arange(120) / 60), 1 - np.cos(np.arange(120) / 60)], 1), np.arange(120) / 60)
    turning = with_path(in_place(motion), path)
    part = turning.select(slice(3, PERIOD + 4))
    assert abs(kept_way(part).yaw[-1] - PERIOD / 60) < 0.15
    _check_seam(part)


def test_what_cannot_be_a_loop_is_refused() -> None:
    motion = walk(30)
    for call, words in (
        (lambda: loop(motion.select(slice(0, 4))), "4 frames"),
        (lambda: close_loop(motion.select(slice(0, 4))), "4 frames"),
        (lambda: loop(motion, 3.0), "does not fit"),
        (lambda: loop(motion, 0.4, 0.2), "shorter than the shortest"),
        (lambda: loop(motion.select(slice(0, 0))), "empty"),
        (lambda: loop(replace(motion, root_positions_world=motion.root_positions_world * np.nan)), "frame 1"),
    ):
        with pytest.raises(MuybridgeError, match=words):
            call()
