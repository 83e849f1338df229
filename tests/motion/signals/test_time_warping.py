"""Warps of time: moments where they belong, strictly forward, without a jump in speed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.errors import MuybridgeError
from muybridge.motion.editing import edit_take, parse_steps
from muybridge.motion.signals import time_map, warp_time
from muybridge.motion.take import Take
from tests.motion.editing.clips import CLIPS, FPS, moved_by, turned_by, walk


@given(st.lists(st.tuples(st.floats(0.01, 2), st.floats(0.05, 20)), min_size=1, max_size=8))
@settings(max_examples=200, deadline=None)
def test_maps_are_strictly_monotone_and_pass_through_their_moments(steps) -> None:
    old, new = np.cumsum(np.array(steps), axis=0).T
    warp = time_map(list(zip(old, new, strict=True)), old[-1] + 1.0)
    assert np.abs(warp(new) - old).max() < 1e-9 * max(new[-1], 1)
    assert warp(np.zeros(1))[0] == 0.0
    for k in range(len(warp.new) - 1):  # each interval finely, as one may be far shorter than another
        times = np.linspace(warp.new[k], warp.new[k + 1], 60)
        assert (np.diff(warp(times)) > 0).all()
    # The slope on both sides of each moment is one.
    step = 1e-6 * np.diff(warp.new).min()
    inner = warp.new[1:-1]
    left, right = (warp(inner) - warp(inner - step)) / step, (warp(inner + step) - warp(inner)) / step
    assert np.allclose(left, right, rtol=1e-2, atol=1e-3)


def test_moments_get_to_their_times_and_the_rest_keeps_its_speed() -> None:
    motion = walk()
    out = warp_time(motion, [(1.0, 0.8), (2.0, 2.4)])
    assert len(out) == len(motion) + round(0.4 * FPS)
    pairs = [(0, 0), (60, 48), (120, 144), (199, 223)]
    for before, after in pairs:
        assert turned_by(motion.select([before]), out.select([after])) < 1e-9
        assert moved_by(motion.select([before]), out.select([after])) < 1e-9
    speed = np.linalg.norm(np.diff(out.root_positions_world, axis=0), axis=1)
    assert np.abs(np.diff(speed)).max() < 0.2 * speed.max()


@pytest.mark.parametrize("clip", CLIPS)
def test_a_map_that_moves_nothing_changes_nothing(clip: str) -> None:
    motion = CLIPS[clip]()
    out = warp_time(motion, [(1.0, 1.0)])
    assert len(out) == len(motion)
    assert turned_by(motion, out) < 1e-9
    assert moved_by(motion, out) < 1e-9


@pytest.mark.parametrize(("words", "message"), [
    ("timewarp 1.0=0.8 2.0=0.7", r"2=0.7: the warp would run back, since the moment 1 s before it is put at 0.8 s"),
    ("timewarp 1=1 1=2", "1=2: the moment 1 s is given twice"),
    ("timewarp 9=1", "9=1: the clip has no moment 9 s; it ends at 3.317 s"),
    ("timewarp 0=1", "0=1: the clip begins at 0 s, and stays there"),
    ("timewarp 1=0", "1=0: the warp would run back"),
    ("timewarp 1=1000000", "frames; 1,000,000 are the most"),
])  # fmt: skip
def test_maps_that_are_refused(words: str, message: str) -> None:
    with pytest.raises(MuybridgeError, match=message):
        edit_take(Take(motion=walk()), parse_steps(words.split()))


@pytest.mark.parametrize("words", ["timewarp", "timewarp 1.0", "timewarp x=y", "timewarp 1=2=3"])
def test_words_that_are_no_times(words: str) -> None:
    with pytest.raises(MuybridgeError, match="times|OLD=NEW|one argument too many"):
        parse_steps(words.split())


def test_times_in_frames_and_the_words_of_the_step() -> None:
    take, notes = edit_take(Take(motion=walk()), parse_steps("timewarp 60f=48f 2=2.4 trim 0 1".split()))
    assert "2 moments moved; speed between 0." in notes[0]
    assert len(take.motion) == 60


def test_one_frame_has_no_time_to_warp() -> None:
    with pytest.raises(MuybridgeError, match="one moment|begins"):
        warp_time(walk(1), [(0.0, 0.0)])
