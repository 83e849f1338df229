"""BVH: round trips, what an independent reader sees, malformed files, CMU's file."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.registry import ReadOptions, read_file
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from muybridge.motion.formats.skeletal.bvh_units import read_bvh_take
from tests.paths import DATA, SHARED

CMU = SHARED / "data" / "motion" / "01_01.bvh"


def make_motion(frames: int = 30, seed: int = 0, fps: float = 59.94, spin: float = 2.0) -> Motion:
    rng = np.random.default_rng(seed)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, spin, frames)[:, None, None]
    turn[:, 0] = np.linspace(0, 3 * spin, frames)[:, None] * (0, 0, 1)
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, fps, root, quat_from_matrix(exp_so3(turn)))


def blender_positions(path: Path) -> tuple[dict[str, np.ndarray], float]:
    """Joints and end sites over time as Blender's default import places them, by a reader of its own.

    Rotation matrices are multiplied in the order of the channels; then (x, y, z) becomes (x, -z, y).
    """
    head, _, tail = path.read_text().partition("MOTION")
    numbers = tail.split("\n")
    seconds = float(numbers[2].split(":")[1])
    rows = np.array([[float(v) for v in line.split()] for line in numbers[3:] if line.strip()])
    column, stack, places = 0, [], {}
    turn, place = None, None
    for line in head.split("\n"):
        word = line.split()
        if not word or word[0] in ("HIERARCHY", "{"):
            continue
        if word[0] in ("ROOT", "JOINT"):
            name = word[1]
        elif word[0] == "End":
            name = stack[-1][0] + "_end"
        elif word[0] == "OFFSET":
            offset = np.array([float(v) for v in word[1:]])
            if stack:
                turn = stack[-1][1]
                place = stack[-1][2] + np.einsum("tij,j->ti", turn, offset)
            else:
                turn = np.tile(np.eye(3), (len(rows), 1, 1))
                place = np.tile(offset, (len(rows), 1))
            places[name] = place
            if name.endswith("_end"):
                stack.append((name, turn, place))
        elif word[0] == "CHANNELS":
            assert int(word[1]) == len(word) - 2 == (3 if stack else 6)
            for channel in word[2:]:
                value = rows[:, column]
                column += 1
                axis = "XYZ".index(channel[0])
                if channel.endswith("position"):
                    places[name][:, axis] = value
                else:
                    turn = turn @ Rotation.from_rotvec(np.radians(value)[:, None] * np.eye(3)[axis]).as_matrix()
            stack.append((name, turn, places[name]))
        elif word[0] == "}":
            stack.pop()
    assert not stack and column == rows.shape[1]
    return {name: p @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]) for name, p in places.items()}, seconds


def test_blender_sees_the_motion_at_its_size(tmp_path):
    motion = make_motion()
    write_bvh(tmp_path / "m.bvh", motion)
    seen, seconds = blender_positions(tmp_path / "m.bvh")
    assert seconds == pytest.approx(1 / 59.94, rel=1e-6)
    at = motion.joint_positions_world()
    for j, name in enumerate(motion.skeleton.names):
        np.testing.assert_allclose(seen[name], at[:, j], atol=2e-6)
    tips = np.isfinite(motion.skeleton.tips[:, 0])
    assert {n for n in seen if n.endswith("_end")} == {
        n + "_end" for n, tip in zip(motion.skeleton.names, tips, strict=True) if tip
    }


def test_rest_pose_stands_upright_faces_plus_z_and_left_is_left(tmp_path):
    skeleton = BODY.skeleton(prior_shape(1.7))
    still = np.tile([1.0, 0, 0, 0], (3, len(skeleton), 1))
    write_bvh(tmp_path / "t.bvh", Motion(skeleton, 60, np.tile([0, 0, 0.9], (3, 1)), still))
    text = (tmp_path / "t.bvh").read_text()
    assert "ROOT hips" in text and text.count("End Site") == 5 and "Frames: 3" in text
    seen, _ = blender_positions(tmp_path / "t.bvh")
    assert (seen["head"][:, 2] > 1.3).all() and (seen["left_foot"][:, 2] < 0.2).all()
    assert (seen["left_hand"][:, 0] > 0.5).all() and (seen["right_hand"][:, 0] < -0.5).all()
    assert (seen["left_toe_end"][:, 1] < seen["left_foot"][:, 1] - 0.1).all(), "in Blender a figure faces -Y"
    toe = [line for line in text.split("\n") if "OFFSET" in line][-1].split()
    assert float(toe[3]) > 0.05, "in the file it faces +Z"


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 999), frames=st.integers(1, 6), spin=st.sampled_from([0.0, 0.5, 3.0, np.pi / 2]))
def test_round_trip(tmp_path_factory, seed, frames, spin):
    motion = make_motion(frames, seed, 30.0, spin)
    path = tmp_path_factory.mktemp("bvh") / "m.bvh"
    write_bvh(path, motion)
    back = read_bvh(path)
    assert set(back.skeleton.names) == set(motion.skeleton.names) and back.fps == pytest.approx(30)
    order = [back.skeleton.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(back.joint_positions_world()[:, order], motion.joint_positions_world(), atol=2e-6)
    np.testing.assert_allclose(back.forward()[:, order], motion.forward(), atol=2e-6)
    np.testing.assert_allclose(back.skeleton.offsets[order], motion.skeleton.offsets, atol=1e-8)
    np.testing.assert_allclose(back.skeleton.tips[order], motion.skeleton.tips, atol=1e-8)
    assert list(path.parent.iterdir()) == [path]


def test_angles_do_not_jump(tmp_path):
    write_bvh(tmp_path / "m.bvh", make_motion(400, 3, spin=3.1))
    rows = (tmp_path / "m.bvh").read_text().split("Frame Time")[1].split("\n")[1:-1]
    angles = np.array([[float(v) for v in row.split()[3:]] for row in rows])
    steps = np.abs(np.diff(angles, axis=0))
    assert np.percentile(steps, 99) < 5 and np.abs(angles).max() > 180


def test_cmu_file():
    if not CMU.is_file():
        pytest.skip("../shared/data is not here")
    motion = read_bvh(CMU, metres_per_unit=0.0254 / 0.45)
    assert len(motion) == 2752 and motion.fps == pytest.approx(120, abs=0.01)
    at = motion.joint_positions_world()
    joint = motion.skeleton.index
    assert at[0, joint("Head"), 2] > 1.3 and at[0, joint("LeftFoot"), 2] < 0.15
    assert at[0, joint("LeftHand"), 0] > at[0, joint("RightHand"), 0] + 1
    for j, parent in enumerate(motion.skeleton.parents[1:], start=1):
        assert np.ptp(np.linalg.norm(at[:, j] - at[:, parent], axis=1)) < 1e-9


GOOD = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT head
  {
    OFFSET 0 1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0.2 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.02
0 1 0 0 0 0 90 0 0
0 1 0 0 0 0 0 90 0
"""


def test_good_small_file_and_its_variants(tmp_path):
    path = tmp_path / "x.bvh"
    spaced = GOOD.replace("JOINT head", "JOINT the head").replace("End Site", "End Site tip")
    for text in (GOOD, GOOD.replace("\n", "\r\n"), GOOD.upper(), spaced, "\ufeff" + GOOD):
        path.write_text(text, newline="")
        motion = read_bvh(path)
        assert motion.fps == 50 and len(motion.skeleton) == 2
        np.testing.assert_allclose(motion.joint_positions_world()[0], [[0, 0, 1], [0, 0, 2]], atol=1e-12)
        np.testing.assert_allclose(motion.forward()[0, 1, :3, :3] @ [0, 0, 1], [-1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (GOOD, "", "ends after line 1"),
        ("HIERARCHY", "PathFileType 4", "line 1: 'PathFileType' found where HIERARCHY is expected"),
        ("OFFSET 0 1 0", "OFFSET 0 one 0", "line 8: 'one'"),
        ("OFFSET 0 1 0", "OFFSET 0 nan 0", "line 8: 'nan'"),
        ("    OFFSET 0 1 0\n", "", "'head' has no OFFSET"),
        ("CHANNELS 3 Zrotation", "CHANNELS 3 Wrotation", "line 9: 'Wrotation'"),
        ("CHANNELS 3 Zrotation", "CHANNELS 2 Zrotation", "line 9: 'Yrotation'"),
        ("CHANNELS 3 Zrotation Xrotation", "CHANNELS 3 Xrotation Xrotation", "line 9"),
        ("CHANNELS 3 ", "CHANNELS -3 ", "line 9"),
        ("\n}\nMOTION", "\nMOTION", "'MOTION' found where"),
        ("MOTION", "MOTIONS", "'MOTIONS' found where MOTION"),
        ("Frames: 2", "Frames: two", "line 17: 'two'"),
        ("Frames: 2", "Frames: 4", "ends after line 20, where frame 3 of 4 must follow"),
        ("0 1 0 0 0 0 90 0 0\n", "0 1 0 0 0 0 90 0 0\n" * 3, "line 22: more follows the 2 frames"),
        ("Time: 0.02", "Time: 0", "line 18: '0'"),
        ("0 1 0 0 0 0 90 0 0", "0 1 0 0 0 0 90 0", "line 19 has 8 numbers"),
        ("0 1 0 0 0 0 90 0 0", "0 1 0 0 0 0 90 x 0", "line 19: 'x'"),
    ],
)
def test_malformed_files_name_the_line(tmp_path, old, new, says):
    assert GOOD.count(old) >= 1
    path = tmp_path / "bad.bvh"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(FormatError, match=says) as raised:
        read_bvh(path)
    assert "bad.bvh" in str(raised.value) and "\n" not in str(raised.value)


def test_sliding_joints_keep_their_places_and_missing_files_are_named(tmp_path):
    path = tmp_path / "s.bvh"
    moved = GOOD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", "CHANNELS 1 Xposition")
    path.write_text(moved.replace("90 0 0", "3").replace("0 90 0", "4"))
    motion = read_bvh(path)
    assert motion.skeleton.sliding == (1,)
    offset = motion.skeleton.offsets[1]
    np.testing.assert_allclose(motion.translations[:, 0], [[3, *offset[1:]], [4, *offset[1:]]])
    write_bvh(tmp_path / "again.bvh", motion)
    back = read_bvh(tmp_path / "again.bvh")
    np.testing.assert_allclose(back.forward(), motion.forward(), atol=2e-6)
    np.testing.assert_allclose(back.skeleton.offsets, motion.skeleton.offsets, atol=1e-8)
    with pytest.raises(FormatError, match="cannot be read"):
        read_bvh(tmp_path / "none.bvh")


def test_positions_of_other_joints_replace_their_offset(tmp_path):
    path = tmp_path / "p.bvh"
    channels = "CHANNELS 6 Xrotation Yposition Zrotation Xposition Yrotation Zposition"
    text = GOOD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", channels)
    text = text.replace("90 0 0\n", "0 2 90 0.5 0 -3\n").replace("0 90 0\n", "90 2 0 0.5 0 -3\n")
    path.write_text(text)
    motion = read_bvh(path)
    np.testing.assert_allclose(motion.skeleton.offsets[1], [0.5, 3, 2])
    np.testing.assert_allclose(motion.joint_positions_world()[1], [[0, 0, 1], [0.5, 3, 3]], atol=1e-12)
    # Rotations are multiplied in the order in which the channels stand, whatever lies between them.
    np.testing.assert_allclose(motion.forward()[0, 1, :3, :3] @ [0, 0, 1], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(motion.forward()[1, 1, :3, :3] @ [0, 0, 1], [0, -1, 0], atol=1e-12)


@pytest.mark.parametrize("order", ["XYZ", "YZX", "ZXY", "ZYX", "XZY", "YXZ", "XYX"])
def test_any_order_of_channels_may_differ_by_joint(tmp_path, order):
    if order == "XYX":
        pytest.raises(FormatError, read_bvh, _with_order(tmp_path, order))
        return
    motion = read_bvh(_with_order(tmp_path, order))
    matrix = np.eye(3)
    for axis, angle in zip(order, (20.0, 40.0, -70.0), strict=True):
        matrix = matrix @ Rotation.from_rotvec(np.radians(angle) * np.eye(3)["XYZ".index(axis)]).as_matrix()
    to_world = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(motion.forward()[0, 1, :3, :3], to_world @ matrix @ to_world.T, atol=1e-12)


def _with_order(tmp_path, order):
    channels = " ".join(f"{axis}rotation" for axis in order)
    text = GOOD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", f"CHANNELS 3 {channels}")
    path = tmp_path / "o.bvh"
    path.write_text(text.replace("90 0 0\n", "20 40 -70\n"))
    return path


def test_end_sites_names_and_centimetres(tmp_path):
    motion = make_motion(3)
    skeleton = replace(motion.skeleton, names=("the hips", *motion.skeleton.names[1:]))
    skeleton.tips[skeleton.index("head")] = np.nan
    skeleton.tips[skeleton.index("left_toe")] = (0, 0, 1e-4)
    motion = replace(motion, skeleton=skeleton)
    write_bvh(tmp_path / "cm.bvh", motion, units="cm")
    back = read_bvh(tmp_path / "cm.bvh", metres_per_unit=0.01)
    assert back.skeleton.names[0] == "the_hips"
    np.testing.assert_allclose(back.forward()[:, 0], motion.forward()[:, 0], atol=2e-6)
    assert back.joint_positions_world().max() == pytest.approx(motion.joint_positions_world().max(), abs=1e-5)
    tips = back.skeleton.tips[np.isfinite(back.skeleton.tips[:, 0])]
    assert len(tips) == 5 and np.linalg.norm(tips, axis=1).min() == pytest.approx(0.01)
    rows = (tmp_path / "cm.bvh").read_text().split("Frame Time")[1].split("\n")[1:-1]
    assert all(len(cell.split(".")[1]) == 6 for row in rows for cell in row.split())


def test_more_frames_than_the_file_can_hold(tmp_path):
    (tmp_path / "x.bvh").write_text(GOOD.replace("Frames: 2", "Frames: 99999999999"))
    with pytest.raises(FormatError, match="announces 99999999999 frames"):
        read_bvh(tmp_path / "x.bvh")


@pytest.mark.parametrize(
    ("text", "fps"),
    [
        ("0.008333", 120), ("0.0083333", 120), ("0.016667", 60), ("0.016666", 60), ("0.004167", 240), ("0.0333", 30),
        ("0.033", 30), ("0.041667", 24), ("0.01", 100), ("0.040000", 25), ("8.333e-03", 120), ("1", 1), ("2", 0.5),
        ("0.016683", 1 / 0.016683), ("0.033367", 1 / 0.033367), ("0.0334", 1 / 0.0334), ("0.03", 1 / 0.03),
    ],
)  # fmt: skip
def test_a_frame_time_is_read_as_the_rate_that_it_was_rounded_from(tmp_path, text, fps):
    write_bvh(tmp_path / "a.bvh", make_motion(3))
    whole = re.sub(r"Frame Time: \S+", f"Frame Time: {text}", (tmp_path / "a.bvh").read_text())
    (tmp_path / "a.bvh").write_text(whole)
    assert read_bvh(tmp_path / "a.bvh").fps == pytest.approx(fps, rel=1e-12)


def test_several_roots(tmp_path):
    first, rest = GOOD.split("MOTION")
    second = first.replace("HIERARCHY\n", "").replace("hips", "box").replace("head", "lid")
    second = second.replace("OFFSET 0 0 0", "OFFSET 5 0 0", 1) if "OFFSET 0 0 0" in second else second
    lines = rest.strip().split("\n")
    rows = [f"{row} {row}" for row in lines[2:]]
    path = tmp_path / "two.bvh"
    path.write_text(first + second + "\n".join(["MOTION", *lines[:2], *rows]) + "\n")
    motion, one = read_bvh(path), None
    (tmp_path / "one.bvh").write_text(GOOD)
    one = read_bvh(tmp_path / "one.bvh")
    count = len(one.skeleton)
    assert motion.skeleton.roots == (0, count) and motion.skeleton.sliding == (count,)
    np.testing.assert_allclose(motion.forward()[:, :count], one.forward(), atol=1e-12)
    np.testing.assert_allclose(motion.forward()[:, count:], one.forward(), atol=1e-12)
    write_bvh(tmp_path / "again.bvh", motion)
    np.testing.assert_allclose(read_bvh(tmp_path / "again.bvh").forward(), motion.forward(), atol=2e-6)


@pytest.mark.parametrize(
    ("announced", "says"), [(1, "announces 1 frames and has 2"), (3, "announces 3 frames and has 2")]
)
def test_one_frame_more_or_less_than_announced_is_read_and_said(tmp_path, announced):
    path = tmp_path / "x.bvh"
    path.write_text(GOOD.replace("Frames: 2", f"Frames: {announced}"))
    take = read_bvh_take(path)
    assert len(take.motion) == 2 and f"announces {announced} frames and has 2" in take.notices[0]


def test_joints_of_one_name_are_told_apart_and_said(tmp_path):
    path = tmp_path / "x.bvh"
    path.write_text(GOOD.replace("JOINT head", "JOINT hips"))
    take = read_bvh_take(path)
    assert take.motion.skeleton.names == ("hips", "hips_2")
    assert take.notices == ("x.bvh: names that appear more than once were made unique: hips_2 for the next hips",)


def test_frame_times_in_milliseconds_are_noticed(tmp_path):
    path = tmp_path / "x.bvh"
    path.write_text(GOOD.replace("Time: 0.02", "Time: 33.3"))
    take = read_bvh_take(path)
    assert take.motion.fps == 30 and "33.3, is taken to be milliseconds" in take.notices[0]


def test_unused_position_channels_keep_the_offsets(tmp_path):
    path = tmp_path / "x.bvh"
    channels = "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
    text = GOOD.replace("CHANNELS 3 Zrotation Xrotation Yrotation", channels)
    text = text.replace("90 0 0\n", "0 0 0 90 0 0\n").replace("0 90 0\n", "0 0 0 0 90 0\n")
    path.write_text(text)
    take = read_bvh_take(path)
    assert any("their OFFSET holds" in n for n in take.notices)
    np.testing.assert_allclose(take.motion.joint_positions_world(), [[[0, 0, 1], [0, 0, 2]]] * 2, atol=1e-12)
    path.write_text(text.replace("0 0 0 0 90 0\n", "0 0.5 0 0 90 0\n"))  # one frame uses them: they are positions
    take = read_bvh_take(path)
    assert not take.notices and take.motion.skeleton.sliding == (1,)


@pytest.mark.parametrize(
    ("case", "given", "tall", "says"),
    [
        ("bvh_decimetres_inches/dance1.bvh", None, 1.593, "taken to be 0.1 m (dm)"),
        ("bvh_decimetres_inches/dance1.bvh", "dm", 1.593, ""),
        ("bvh_decimetres_inches/bvh_test1.bvh", None, 1.626, "taken to be 0.0254 m (in)"),
        ("bvh_decimetres_inches/bvh_test1.bvh", "in", 1.626, ""),
        (
            "bvh_zero_positions/zero_positions.bvh",
            None,
            0.0254 * (3.937 + 15.75 + 4.724 + 16.54 + 16.14),
            "their OFFSET holds",
        ),
    ],
)
def test_files_of_other_units_and_unused_channels(case, given, tall, says):
    path = DATA / "cases" / case
    if not path.exists():
        pytest.skip(f"{path} is absent")
    take = read_file(path, ReadOptions(units=given))
    rest = take.motion.skeleton.rest_positions
    ends = np.concatenate([rest, (rest + take.motion.skeleton.tips)])
    assert np.nanmax(np.ptp(ends[np.isfinite(ends).all(1)], axis=0)) == pytest.approx(tall, abs=2e-3)
    assert says in " ".join(take.notices) and bool(take.notices) == bool(says)
