"""Clips completed by captured takes: what was animated stays, what was not goes with it."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import multiply_quat, quat_from_rotvec
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.assistance import (
    AssistOptions,
    assist,
    bring_take,
    driving_joints,
    mirrored,
    still_joints,
)
from muybridge.motion.assistance.fragments import break_clip, find_driving, signals_of
from muybridge.motion.assistance.joining import fade_weights, joined_rotations
from muybridge.motion.editing.resampling import motion_at, resample
from tests.motion.editing.clips import FPS, PERIOD, turned_by, walk
from tests.paths import DATA

ARMS = ("left_upper_arm", "right_upper_arm")


def without_arms(motion: Motion) -> tuple[Motion, tuple[int, ...]]:
    """The walk with arms that do not move, and their joints."""
    made = tuple(motion.skeleton.index(name) for name in (*ARMS, "spine"))
    quat = motion.quat_wxyz.copy()
    quat[:, made] = quat[:1, made]
    return replace(motion, quat_wxyz=quat), made


def slower(motion: Motion, factor: float) -> Motion:
    """The same movement at another speed."""
    return motion_at(motion, np.arange(0, len(motion) - 1, factor))


def completed(keys: Motion, made: tuple[int, ...], take: Motion, options: AssistOptions | None = None):
    roles = find_motion_roles(keys).roles
    one = bring_take("take", take, find_motion_roles(take).roles, keys, roles)
    return assist(keys, [one], made, driving_joints(keys, made, roles), options)


def test_arms_go_with_the_legs_of_a_slower_walk_and_the_legs_stay() -> None:
    truth = walk(264)
    keys, made = without_arms(truth)
    done = completed(keys, made, slower(walk(264), 0.85))
    kept = [j for j in range(len(keys.skeleton)) if j not in made]
    np.testing.assert_array_equal(done.motion.root_positions_world, keys.root_positions_world)
    np.testing.assert_allclose(done.motion.quat_wxyz[:, kept], keys.quat_wxyz[:, kept], atol=1e-12)
    inside = slice(20, -20)  # the ends of a clip are fragments that end where no movement does
    assert turned_by(done.motion.select(inside), truth.select(inside)) < np.radians(8)
    swing = [m.quat_wxyz[inside, truth.skeleton.index(ARMS[0]), 1] for m in (done.motion, truth)]
    assert np.corrcoef(*swing)[0, 1] > 0.97


def test_made_movement_has_no_jumps() -> None:
    truth = walk(264)
    keys, made = without_arms(truth)
    rng = np.random.default_rng(0)
    roles = find_motion_roles(keys).roles
    lifted = quat_from_rotvec(rng.normal(0, 0.3, (3, 1, len(made), 3)))
    takes = []
    for turn, factor in zip(lifted, (0.8, 1.0, 1.2), strict=True):  # whose arms hang differently
        quat = (take := slower(walk(200), factor)).quat_wxyz.copy()
        quat[:, made] = multiply_quat(quat[:, made], turn)
        takes.append(bring_take("take", replace(take, quat_wxyz=quat), roles, keys, roles))
    done = assist(keys, takes, made, driving_joints(keys, made, roles))
    steps = np.abs(np.diff(done.motion.quat_wxyz[:, made], axis=0)).max()
    assert steps < 0.06


def test_texture_is_added_to_what_was_animated() -> None:
    keys, made = without_arms(walk(264))
    take = walk(264)
    shin = take.skeleton.index("left_shin")
    shake = np.zeros((264, 3))
    shake[:, 0] = np.radians(2) * np.sin(2 * np.pi * 12 * np.arange(264) / FPS)
    quat = take.quat_wxyz.copy()
    quat[:, shin] = multiply_quat(quat[:, shin], quat_from_rotvec(shake))
    take = replace(take, quat_wxyz=quat)
    plain, fine = (completed(keys, made, take, AssistOptions(texture=g)).motion for g in (0.0, 1.0))
    assert turned_by(plain, fine) > np.radians(1)
    others = [j for j in range(len(keys.skeleton)) if j not in (shin, *made)]
    # The two fastest bands pass 2.2 % of a stride of 66 frames: 1 - cos(pi f)^4 cos(2 pi f)^4.
    change = np.abs(fine.quat_wxyz - keys.quat_wxyz).max(axis=(0, 2))
    swing = np.ptp(keys.quat_wxyz, axis=0).max(axis=-1)
    assert (change[others] <= 0.03 * swing[others] + 1e-12).all()
    np.testing.assert_array_equal(fine.quat_wxyz[:, 0], keys.quat_wxyz[:, 0])


def test_fragments_cover_a_clip_and_meet_where_the_thighs_turn() -> None:
    motion = walk(264)
    joints = [motion.skeleton.index(f"{side}_thigh") for side in ("left", "right")]
    driving = find_driving(motion.quat_wxyz, joints, FPS)
    pieces = break_clip(signals_of(motion.quat_wxyz, driving, FPS), driving, 0)
    assert pieces[0].start == 0 and pieces[-1].end == 263
    assert all(a.end == b.start and a.rises != b.rises for a, b in zip(pieces[1:-2], pieces[2:-1], strict=True))
    turns = np.array([piece.start for piece in pieces[2:-1]])
    assert np.abs(np.diff(turns) - PERIOD / 2).max() <= 4


def test_a_take_that_is_the_clip_comes_back_as_it_was() -> None:
    motion = walk(200)
    joints = [motion.skeleton.index(f"{side}_thigh") for side in ("left", "right")]
    driving = find_driving(motion.quat_wxyz, joints, FPS)
    pieces = break_clip(signals_of(motion.quat_wxyz, driving, FPS), driving, 0)
    weights = fade_weights(pieces, pieces, 200, FPS)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-12)
    assert weights.min() >= 0
    back = joined_rotations(pieces, pieces, [motion.quat_wxyz], 200, FPS)
    np.testing.assert_allclose(back, motion.quat_wxyz, atol=1e-12)


def test_joints_that_never_turn_are_those_to_make() -> None:
    keys, made = without_arms(walk())
    moving = {keys.skeleton.index(f"{side}_{part}") for side in ("left", "right") for part in ("thigh", "shin")}
    assert set(made) <= set(still_joints(keys)) and not moving & set(still_joints(keys))
    assert 0 not in still_joints(keys)


def test_takes_of_other_skeletons_and_frame_rates_are_brought_over() -> None:
    keys, _ = without_arms(walk())
    roles = find_motion_roles(keys).roles
    small = walk()
    skeleton = replace(small.skeleton, offsets=small.skeleton.offsets * 0.7)
    taller = replace(small, skeleton=skeleton, root_positions_world=small.root_positions_world * 0.7)
    one = bring_take("small", resample(taller, 30.0), roles, keys, roles)
    assert one.motion.skeleton.names == keys.skeleton.names and one.motion.fps == keys.fps
    assert any("retargeted" in n for n in one.notices) and any("from 30 to 60 frames/s" in n for n in one.notices)
    assert turned_by(one.motion, walk().select(slice(0, len(one.motion)))) < np.radians(6)
    both = mirrored(one, roles)
    swing = [m.motion.quat_wxyz[:, keys.skeleton.index("left_thigh"), 1] for m in (one, both)]
    assert np.corrcoef(*swing)[0, 1] < -0.9


def test_what_cannot_be_used_is_refused_by_name() -> None:
    keys, made = without_arms(walk())
    roles = find_motion_roles(keys).roles
    driving = driving_joints(keys, made, roles)
    take = bring_take("take", walk(), roles, keys, roles)
    with pytest.raises(MuybridgeError, match="1 frame; at least 8"):
        assist(keys.select(slice(0, 1)), [take], made, driving)
    with pytest.raises(MuybridgeError, match="short: has 1 frame"):
        bring_take("short", walk().select(slice(0, 1)), roles, keys, roles)
    with pytest.raises(MuybridgeError, match="no takes"):
        assist(keys, [], made, driving)
    with pytest.raises(MuybridgeError, match="name those to make"):
        assist(keys, [take], (), driving)
    with pytest.raises(MuybridgeError, match="cannot drive and be made"):
        assist(keys, [take], made, made[:1])
    still = replace(keys, quat_wxyz=np.repeat(keys.quat_wxyz[:1], len(keys), axis=0))
    with pytest.raises(MuybridgeError, match="do not move"):
        assist(still, [take], made, driving)
    with pytest.raises(MuybridgeError, match="no joint below the root is key-framed"):
        driving_joints(still, still_joints(still), roles)


def test_another_skeleton_without_roles_is_refused_with_those_that_are_missing() -> None:
    keys, _ = without_arms(walk())
    roles = find_motion_roles(keys).roles
    other = replace(walk(), skeleton=replace(walk().skeleton, offsets=walk().skeleton.offsets * 0.7))
    known = {role: j for role, j in roles.items() if role != "left_hand"}
    with pytest.raises(MuybridgeError, match="odd: no joint was found for left_hand") as error:
        bring_take("odd", other, known, keys, roles)
    assert error.value.remedy == "take_map"
    with pytest.raises(MuybridgeError, match="the key frames: no joint was found for left_hand"):
        bring_take("odd", other, roles, keys, known)


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "motion" / "02_03.amc").is_file(), reason="needs the recorded takes of shared/data")
def test_arms_of_a_recorded_walk_and_run_swing_as_they_did() -> None:
    from scripts.benchmarks.motion.assist import correlations, legs_alone, nearest_pose, others_of, real_takes, swings

    takes = real_takes(DATA / "motion")
    for take in takes[:2]:
        keys, made = legs_alone(take)
        others = others_of(take, takes)
        driving = driving_joints(keys, made, take.roles)
        done = assist(keys, others, made, driving).motion
        base = nearest_pose(keys, others, made, driving)
        truth = swings(take.motion, take.roles)
        mine, theirs = (correlations(swings(m, take.roles), truth) for m in (done, base))
        assert mine.min() > 0.7
        assert (mine > theirs).all()
