"""Motions one behind the other."""

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import JoinOptions, find_joins, join_motions, peak_acceleration, place_at
from muybridge.motion.blending.joins.quadratic import raised_cosine, smooth_join
from muybridge.motion.formats.registry import read_file
from tests.motion.editing.clips import PERIOD, walk
from tests.paths import SHARED


def halves() -> tuple[Motion, Motion, Motion]:
    """A walk; its beginning; and its end, which was turned and moved, with 20 frames in common."""
    whole = walk(200)
    return whole, whole.select(slice(0, 110)), place_at(whole.select(slice(90, 200)), 2.0, np.array([5.0, 1.0]))


@pytest.mark.parametrize("how", ["inertial", "crossfade", "align"])
def test_a_motion_that_was_cut_is_put_together_again(how: str) -> None:
    whole, first, second = halves()
    joined = join_motions([first, second], ["a", "b"], JoinOptions(how, 0.2, overlap=0.3, plant=False))
    place = joined.places[0]
    assert place.leave - place.enter == 90 and joined.frames[0] == place.leave
    assert len(joined.motion) == len(whole)
    error = np.abs(joined.motion.joint_positions_world() - whole.joint_positions_world()).max()
    assert error < 1e-6


def test_the_quadratic_fit_keeps_a_parabola_and_changes_nothing_beyond_its_window() -> None:
    motion = walk(60)
    t = np.arange(60.0)[:, None]
    parabola = Motion(motion.skeleton, 60.0, 0.3 + 0.01 * t * [1, -1, 0] + 1e-4 * t**2 * [0, 1, 1],
                      np.repeat(motion.quat_wxyz[:1], 60, axis=0))  # fmt: skip
    out = smooth_join(parabola, 29.5, 10)
    np.testing.assert_allclose(out.root_positions_world, parabola.root_positions_world, atol=1e-9)
    out = smooth_join(motion, 29.5, 10)
    changed = np.flatnonzero(np.abs(out.quat_wxyz - motion.quat_wxyz).max(axis=(1, 2)) > 1e-9)
    assert changed[0] >= 20 and changed[-1] <= 39
    assert raised_cosine(np.array([0.0, 5.0, 10.0, 12.0]), 10).tolist() == pytest.approx([1, 0.5, 0, 0])


@pytest.mark.parametrize("how", ["inertial", "crossfade", "quadratic"])
def test_a_join_of_other_phases_has_no_jump(how: str) -> None:
    whole = walk(200)
    pair = [whole.select(slice(0, 100)), whole.select(slice(100 + PERIOD // 4, 200))]
    joined = join_motions(pair, ["a", "b"], JoinOptions(how, overlap=0.1, plant=False))
    steps = np.linalg.norm(np.diff(joined.motion.joint_positions_world(), axis=0), axis=-1).max(axis=1)
    cut = join_motions(pair, ["a", "b"], JoinOptions("align", overlap=0.1, plant=False))
    jump = np.linalg.norm(np.diff(cut.motion.joint_positions_world(), axis=0), axis=-1).max(axis=1)
    assert steps.max() < 0.5 * jump.max()


def test_an_inertialised_join_is_no_more_violent_than_the_motions() -> None:
    whole = walk(200)
    pair = [whole.select(slice(0, 120)), whole.select(slice(20, 200))]
    joined = join_motions(pair, ["a", "b"], JoinOptions(plant=False))
    assert peak_acceleration(joined.motion) <= max(peak_acceleration(m) for m in pair) * 1.0001


def test_planting_changes_nothing_where_no_foot_stands() -> None:
    """The feet of this walk swing through what is taken for the floor, and none of them stands."""
    whole = walk(200)
    pair = [whole.select(slice(0, 120)), whole.select(slice(20, 200))]
    planted, plain = (join_motions(pair, ["a", "b"], JoinOptions(seconds=0.5, plant=p)) for p in (True, False))
    assert planted.contacts is not None and not planted.contacts.contact.any()
    np.testing.assert_allclose(
        planted.motion.joint_positions_world(), plain.motion.joint_positions_world(), rtol=0, atol=1e-9
    )


def test_feet_stand_about_a_join_of_captures() -> None:
    path = SHARED / "data" / "motion" / "02_01.amc"
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    motion = read_file(path).motion
    assert motion is not None
    joined = join_motions([motion, motion], ["a", "b"])
    assert joined.contacts is not None and joined.contacts.contact[joined.transitions].any()
    assert joined.drift() < 3e-3
    assert joined.transitions[joined.frames[0]] and not joined.transitions[0]


def test_three_motions_are_joined_in_order() -> None:
    whole = walk(200)
    joined = join_motions([whole, whole, whole], ["a", "b", "c"], JoinOptions(plant=False))
    assert len(joined.places) == 2 and joined.frames[0] < joined.frames[1]
    x = joined.motion.root_positions_world
    assert np.linalg.norm(x[-1, :2] - x[0, :2]) > 2 * np.linalg.norm((whole.root_positions_world[-1] - x[0])[:2])


def test_a_given_place_is_kept() -> None:
    whole, first, second = halves()
    joined = join_motions([first, second], ["a", "b"], JoinOptions(plant=False), at=[(1.5, 0.25)])
    assert (joined.places[0].leave, joined.places[0].enter) == (90, 15)
    with pytest.raises(MuybridgeError, match="second motion of a join lasts from 0 to .* no frame at 9 s"):
        find_joins(first, second, at=(None, 9.0))
    with pytest.raises(MuybridgeError, match="first motion of a join.*no frame at nan s"):
        find_joins(first, second, at=(np.nan, None))


def test_bad_input_is_refused_by_name() -> None:
    motion = walk(100)
    with pytest.raises(MuybridgeError, match=r"b\.bvh has 1 frame, and a join needs at least 3"):
        join_motions([motion, motion.select(slice(0, 1))], ["a.bvh", "b.bvh"])
    with pytest.raises(MuybridgeError, match="at least two motions"):
        join_motions([motion], ["a.bvh"])
    with pytest.raises(MuybridgeError, match="nothing would overlap"):
        join_motions([motion, motion], ["a", "b"], JoinOptions(overlap=0.0))
    with pytest.raises(MuybridgeError, match="nothing to fade over"):
        join_motions([motion, motion], ["a", "b"], JoinOptions("crossfade"), at=[(99 / 60, 0.0)])
    with pytest.raises(MuybridgeError, match="longer than 0 s, not -1 s"):
        JoinOptions(seconds=-1.0)
    with pytest.raises(MuybridgeError, match="5 to 20 frames on either side, not 3"):
        JoinOptions("quadratic", frames=3)
