"""Warps through key poses: keys are met, nothing jumps, and what does not fit is refused by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import multiply_quat, quat_from_rotvec
from muybridge.geometry.roles import find_motion_roles
from muybridge.motion.contacts import feet_of_motion, plant_feet
from muybridge.motion.editing import edit_take, parse_steps
from muybridge.motion.formats import read_file, write_file
from muybridge.motion.signals import keys_of_motion, reach, split_bands, warp_to_keys
from muybridge.motion.signals.warping import correction
from muybridge.motion.take import Take
from tests.motion.editing.clips import CLIPS, FPS, moved_by, turned_by, walk
from tests.paths import DATA


def posed(motion, frames, size=0.4, seed=0):
    """Poses of these frames, changed by an animator."""
    rng = np.random.default_rng(seed)
    poses = motion.select(np.array(frames))
    change = rng.normal(0, size, (len(frames), len(motion.skeleton), 3))
    root = poses.root_positions_world + rng.normal(0, 0.05, (len(frames), 3))
    return replace(poses, quat_wxyz=multiply_quat(poses.quat_wxyz, quat_from_rotvec(change)), root_positions_world=root)


@pytest.mark.parametrize("method", ["add", "multiply"])
@pytest.mark.parametrize("clip", CLIPS)
def test_keys_are_met(clip: str, method) -> None:
    motion = CLIPS[clip]()
    poses = posed(motion, [30, 80, 110])
    keys = keys_of_motion(poses, motion, [0.5, 80 / FPS, 110 / FPS])
    out = warp_to_keys(motion, keys, method)
    assert turned_by(out.select(keys.frames), poses) < 1e-6
    assert moved_by(out.select(keys.frames), poses) < 1e-6
    far = np.r_[0:1, 170:200]  # half a second before and behind nothing changes
    assert turned_by(out.select(np.r_[141:200]), motion.select(np.r_[141:200])) < 1e-12
    assert moved_by(out.select(far[1:]), motion.select(far[1:])) < 1e-12


def test_the_slope_of_a_correction_is_continuous() -> None:
    rng = np.random.default_rng(1)
    frames = np.array([20, 31, 70, 72])
    course = correction(frames, rng.normal(size=(4, 3)), 30.0)
    at = np.concatenate([frames, [-10, 102, 132]]).astype(float)
    step = 1e-4
    before, after = ((course(at + s) - course(at)) / s for s in (-step, step))
    assert np.abs(before - after).max() < 1e-3
    assert np.abs(course(np.array([-40.0, -10.0, 102.0, 500.0]))).max() < 1e-12
    assert np.allclose(course(frames.astype(float)), course.c[-1][[2, 3, 4, 5]], atol=1e-12)


def test_scaling_makes_swings_larger_about_their_middle() -> None:
    motion = walk(264)
    arm = motion.skeleton.index("left_upper_arm")
    chart = split_bands(motion).chart
    top = 132 + int(np.argmax(np.abs(chart.vectors[132:198, arm, 0])))
    wanted = chart.vectors[[top]].copy()
    wanted[:, arm, 0] *= 1.6
    pose = motion.select([top])
    pose = replace(pose, quat_wxyz=multiply_quat(chart.mean_wxyz[[top]], quat_from_rotvec(wanted)))
    scaled, shifted = (
        warp_to_keys(motion, keys_of_motion(pose, motion, [top / FPS]), method, blend=2.0)
        for method in ("multiply", "add")
    )
    # A quarter of a stride earlier the arm swings through its middle, where only translation moves it.
    middle = top - 15
    moved = [np.abs(m.quat_wxyz[middle, arm] - motion.quat_wxyz[middle, arm]).max() for m in (scaled, shifted)]
    assert moved[0] < 0.4 * moved[1]


def test_some_joints_and_times_of_their_own(tmp_path: Path) -> None:
    motion = walk(120)
    poses = posed(motion, [12, 60])
    file = tmp_path / "keys.bvh"
    write_file(file, Take(motion=replace(poses, fps=FPS / 30)))  # poses at 0 and 0.5 s
    take, notes = edit_take(Take(motion=motion), parse_steps(["warp", str(file), "12f", "1", "blend=0.3", "multiply"]))
    assert turned_by(take.motion.select([12, 60]), poses) < 1e-5
    assert "2 key poses of 21 joints at 0.2, 1 s" in notes[0]
    take, notes = edit_take(Take(motion=motion), parse_steps(["warp", str(file)]))
    assert turned_by(take.motion.select([0, 30]), poses) < 1e-5


def test_keys_that_do_not_fit(tmp_path: Path) -> None:
    motion = walk(60)
    poses = posed(motion, [10, 30])
    named = replace(poses, skeleton=replace(poses.skeleton, names=("tail", *poses.skeleton.names[1:])))
    longer = replace(poses, skeleton=replace(poses.skeleton, offsets=1.2 * poses.skeleton.offsets))
    for keys, times, words in (
        (named, (), "joint 'tail', which the motion has not"),
        (longer, (), "key poses' bone to .* differs by"),
        (poses, (0.1,), "1 times are given for 2 key poses"),
        (poses, (0.1, 3.0), "the key at 3 s is outside of the clip, which ends at 0.983 s"),
        (poses, (0.5, 0.5), "key 2 is not behind key 1: they fall on the frames 31 and 31"),
    ):
        with pytest.raises(MuybridgeError, match=words):
            keys_of_motion(keys, motion, times)
    with pytest.raises(MuybridgeError, match="step 1, warp .*no such file"):
        edit_take(Take(motion=motion), parse_steps(["warp", str(tmp_path / "none.bvh")]))


@pytest.mark.parametrize("end", ["left_hand", "right_hand", "left_foot"])
@pytest.mark.parametrize("clip", ["body", "uneven", "with_root_bone"])
def test_an_end_gets_to_its_place_in_time(clip: str, end: str) -> None:
    motion = CLIPS[clip]()
    frame, j = 60, motion.skeleton.index(end)
    goal = motion.joint_positions_world()[frame, j] + [0.02, -0.12, 0.15 if "hand" in end else 0.08]
    out = reach(motion, end, frame / FPS, goal)
    assert np.linalg.norm(out.joint_positions_world()[frame, j] - goal) < 1e-6
    others = [k for k in range(len(motion.skeleton)) if not motion.skeleton.is_ancestor[k, j]
              and not motion.skeleton.is_ancestor[j, k]]  # fmt: skip
    assert np.abs(out.quat_wxyz[:, others] - motion.quat_wxyz[:, others]).max() < 1e-12
    assert moved_by(out.select(slice(95, 200)), motion.select(slice(95, 200))) < 1e-12


def test_the_trunk_helps_a_hand_that_is_too_far_away() -> None:
    motion = walk()
    frame, index = 60, motion.skeleton.index
    places = motion.joint_positions_world()[frame]
    shoulder = places[index("left_upper_arm")]
    arm = np.linalg.norm(np.diff(places[[index(f"left_{p}") for p in ("upper_arm", "forearm", "hand")]], axis=0),
                         axis=1).sum()  # fmt: skip
    goal = shoulder + (arm + 0.1) * np.array([0.0, -1.0, 0.0])
    out = reach(motion, "left_hand", frame / FPS, goal)
    assert np.linalg.norm(out.joint_positions_world()[frame, index("left_hand")] - goal) < 1e-6
    with pytest.raises(MuybridgeError, match=r"left_hand cannot reach .* m too far away, even with the trunk's help"):
        reach(motion, "left_hand", 1.0, goal + [0.0, -2.0, 0.0])


def test_reaching_from_the_table_keeps_feet_if_asked() -> None:
    path = DATA / "motion" / "02_01.amc"
    if not path.is_file():
        pytest.skip("../shared/data is not here")
    motion = read_file(path).motion
    hand = motion.joint_positions_world()[60, find_motion_roles(motion).roles["right_hand"]]
    words = ["reach", "right_hand", "60f", *(f"{v:.3f}" for v in hand + [0, 0.05, 0.1]), "keep"]
    take, notes = edit_take(Take(motion=motion), parse_steps(words))
    assert "right_hand moved by 0.11 m in frame 61, with 3 joints; feet kept" in notes[0]
    planted = plant_feet(motion)
    before, after = (feet_of_motion(m).places for m in (planted.motion, take.motion))
    assert np.linalg.norm(after - before, axis=-1)[planted.contacts.contact].max() < 2e-3


def test_ends_that_are_none() -> None:
    with pytest.raises(MuybridgeError, match="part is left_hand, right_hand"):
        parse_steps("reach tail 1 0 0 0".split())
    dog = replace(walk(20), skeleton=replace(walk(20).skeleton, names=tuple(f"b{k}" for k in range(21))))
    with pytest.raises(MuybridgeError, match="no joint is known to be left_upper_arm, left_forearm, left_hand"):
        reach(dog, "left_hand", 0.1, np.zeros(3), roles={"hips": 0})
