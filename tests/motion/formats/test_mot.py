"""OpenSim's joint angles: what they mean, round trips, malformed files."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.amc import read_amc
from muybridge.motion.formats.skeletal.mot import read_mot, write_mot
from muybridge.motion.formats.skeletal.opensim import coordinates_of, motion_of
from tests.paths import SHARED

DATA = SHARED / "data" / "motion"
SKELETON = BODY.skeleton(prior_shape(1.75))
ARMS_DOWN = {"left_upper_arm": (0, 90, 0), "right_upper_arm": (0, -90, 0)}


def pose(**turns_deg: tuple[float, float, float]) -> Motion:
    """One frame; rotation vectors in degrees about the rest pose's axes, arms at the sides."""
    vectors = np.zeros((1, len(SKELETON), 3))
    for joint, turn in (ARMS_DOWN | turns_deg).items():
        vectors[0, SKELETON.index(joint)] = np.radians(turn)
    return Motion(SKELETON, 60.0, np.array([[0.0, 0.0, 0.95]]), quat_from_matrix(exp_so3(vectors)))


def angles(motion: Motion) -> dict[str, float]:
    found = coordinates_of(motion)
    return {n: np.degrees(v) for n, v in zip(found.names, found.values[0], strict=True) if "_t" not in n[-3:]}


@pytest.mark.parametrize(
    ("joint", "turn", "name", "value"),
    [
        ("left_thigh", (-30, 0, 0), "hip_flexion_l", 30),
        ("right_thigh", (-30, 0, 0), "hip_flexion_r", 30),
        ("left_thigh", (0, -20, 0), "hip_adduction_l", -20),  # the leg goes out to its side
        ("right_thigh", (0, 20, 0), "hip_adduction_r", -20),
        ("left_thigh", (0, 0, 15), "hip_rotation_l", -15),  # the toes go out
        ("right_thigh", (0, 0, -15), "hip_rotation_r", -15),
        ("left_shin", (70, 0, 0), "knee_angle_l", 70),
        ("right_shin", (70, 0, 0), "knee_angle_r", 70),
        ("left_foot", (-12, 0, 0), "ankle_angle_l", 12),  # the toes rise
        ("spine", (25, 0, 0), "lumbar_extension", -25),
        ("spine", (0, 10, 0), "lumbar_bending", -10),  # to the left, as +X is
        ("chest", (0, 0, 10), "lumbar_rotation", 10),
        ("left_forearm", (0, 0, -80), "elbow_flex_l", 80),
        ("right_forearm", (0, 0, 80), "elbow_flex_r", 80),
    ],
)
def test_each_angle_has_its_name_and_sign(joint, turn, name, value):
    found = angles(pose(**{joint: turn}))
    assert found[name] == pytest.approx(value, abs=1e-6)
    others = {n: v for n, v in found.items() if n != name and abs(v) > 1e-6 and n != "pelvis_rotation"}
    assert not others
    assert abs(found["pelvis_rotation"]) == pytest.approx(180), "our rest faces -Y of the world: -X of ground"


def test_pelvis_of_one_who_faces_along_ground_x():
    facing = Rotation.from_rotvec([0, 0, np.pi])
    for lean, name in (((10, 0, 0), "pelvis_tilt"), ((0, 10, 0), "pelvis_list")):
        turn = (facing * Rotation.from_rotvec(np.radians(lean))).as_rotvec(degrees=True)
        found = angles(pose(hips=tuple(turn)))
        assert found[name] == pytest.approx(-10, abs=1e-6) and abs(found["pelvis_rotation"]) < 1e-6


def test_arms_forward_and_out():
    forward = Rotation.from_rotvec([-np.pi / 2, 0, 0])  # of the hanging arm, about the left-right axis
    for side, down in (("left", 90), ("right", -90)):
        turn = (forward * Rotation.from_rotvec([0, np.radians(down), 0])).as_rotvec(degrees=True)
        found = angles(pose(**{f"{side}_upper_arm": tuple(turn)}))
        assert found[f"arm_flex_{side[0]}"] == pytest.approx(90, abs=1e-6)
        out = angles(pose(**{f"{side}_upper_arm": (0, down / 90 * 60, 0)}))
        assert out[f"arm_add_{side[0]}"] == pytest.approx(-30, abs=1e-6)


def make_motion(frames: int = 30, seed: int = 0) -> Motion:
    """Any motion that the model's coordinates can tell."""
    rng = np.random.default_rng(seed)
    vectors = np.zeros((frames, len(SKELETON), 3))
    for joint in ("hips", "spine", "left_thigh", "right_thigh", "left_upper_arm", "right_upper_arm"):
        start, end = rng.normal(0, 0.6, (2, 3))
        vectors[:, SKELETON.index(joint)] = start + np.linspace(0, 1, frames)[:, None] * (end - start)
    hinges = (("left_shin", 0, 1), ("right_shin", 0, 1), ("left_forearm", 2, -1), ("right_forearm", 2, 1))
    for joint, axis, sign in (*hinges, ("left_foot", 0, 1)):
        vectors[:, SKELETON.index(joint), axis] = sign * np.linspace(0.1, 1.4, frames)
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(SKELETON, 100.0, root, quat_from_matrix(exp_so3(vectors)))


def test_round_trip(tmp_path):
    motion = make_motion()
    write_mot(tmp_path / "m.mot", motion)
    found = read_mot(tmp_path / "m.mot")
    wanted = coordinates_of(motion)
    assert found.names == wanted.names
    np.testing.assert_allclose(found.values, wanted.values, atol=1e-8)
    np.testing.assert_allclose(found.times, np.arange(30) / 100, atol=1e-8)
    back = motion_of(found, SKELETON)
    np.testing.assert_allclose(back.joint_positions_world(), motion.joint_positions_world(), atol=1e-6)
    assert back.fps == pytest.approx(100)
    assert np.abs(np.diff(found.values, axis=0)).max() < 0.5, "no jumps"


def test_file_is_what_opensim_accepts(tmp_path):
    write_mot(tmp_path / "m.mot", make_motion(5))
    lines = (tmp_path / "m.mot").read_text().split("\n")
    end = lines.index("endheader")
    assert lines[0] == "Coordinates" and "nRows=5" in lines[:end] and "inDegrees=yes" in lines[:end]
    columns = lines[end + 1].split("\t")
    assert f"nColumns={len(columns)}" in lines[:end] and columns[0] == "time"
    assert all(len(line.split("\t")) == len(columns) for line in lines[end + 2 : -1]) and len(lines) == end + 2 + 5 + 1
    assert {"pelvis_tx", "knee_angle_r", "ankle_angle_l", "arm_flex_r", "lumbar_extension"} <= set(columns)


def test_other_skeletons_walk_the_same(tmp_path):
    if not DATA.is_dir():
        pytest.skip("../shared/data is not here")
    motion = read_amc(DATA / "01_01.amc")
    motion = replace(motion, root_positions_world=motion.root_positions_world[:400], quat_wxyz=motion.quat_wxyz[:400])
    found = coordinates_of(motion)
    at = {n: np.degrees(found.values[:, i]) for i, n in enumerate(found.names)}
    # A man who walks and jumps forward: knees and elbows bend one way only, hips stay under the trunk.
    assert at["knee_angle_r"].min() > -10 and 20 < at["knee_angle_r"].max() < 160
    assert at["elbow_flex_l"].min() > -15 and abs(at["pelvis_tilt"]).max() < 60
    assert abs(np.median(at["hip_adduction_r"])) < 20 and abs(np.median(at["hip_adduction_l"])) < 20


def test_unknown_joints_get_three_angles_each(tmp_path):
    motion = make_motion(6)
    strange = replace(motion, skeleton=replace(SKELETON, names=tuple(f"bone {k}" for k in range(len(SKELETON)))))
    write_mot(tmp_path / "m.mot", strange)
    found = read_mot(tmp_path / "m.mot")
    assert len(found.names) == 3 + 3 * len(SKELETON)
    assert found.names[:4] == ("bone_0_tx", "bone_0_ty", "bone_0_tz", "bone_0_rz")


GOOD = "Coordinates\nversion=1\nnRows=2\nnColumns=3\ninDegrees=yes\nendheader\ntime\ta\tb_tx\n0\t90\t1\n0.1\t180\t2\n"


def test_small_file_and_its_variants(tmp_path):
    path = tmp_path / "x.mot"
    for text in (GOOD, GOOD.replace("\n", "\r\n"), GOOD.replace("\t", "   ")):
        path.write_text(text, newline="")
        np.testing.assert_allclose(read_mot(path).values, [[np.pi / 2, 1], [np.pi, 2]])
    path.write_text(GOOD.replace("inDegrees=yes", "inDegrees=no"))
    np.testing.assert_allclose(read_mot(path).values, [[90, 1], [180, 2]])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("endheader\n", "", "no line `endheader`"),
        ("time\ta", "t\ta", "line 7 must name the columns"),
        ("time\ta\tb_tx", "time\ta\ta", "line 7 names a column twice"),
        ("0.1\t180\t2", "0.1\t180", "line 9 must have 3"),
        ("0.1\t180\t2", "0.1\tx\t2", "line 9 must have 3"),
        ("0.1\t180\t2", "0.1\tnan\t2", "line 9 must have 3"),
        ("0.1\t180\t2\n", "", "announces 2 rows and has 1"),
        ("0.1\t180\t2", "0\t180\t2", "times do not rise"),
    ],
)
def test_malformed(tmp_path, old, new, says):
    assert old in GOOD
    (tmp_path / "bad.mot").write_text(GOOD.replace(old, new, 1))
    with pytest.raises(FormatError, match=says) as raised:
        read_mot(tmp_path / "bad.mot")
    assert "bad.mot" in str(raised.value) and "\n" not in str(raised.value)
