"""Robots are read as MuJoCo reads them, their parts found whatever they are called, and motion put onto them."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, quat_from_matrix
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.robots import (
    RobotTake,
    find_capsules,
    find_link_roles,
    read_robot,
    retarget_to_robot,
    write_robot_motion,
)
from tests.motion.robots.humanoids import write_small, write_tall
from tests.paths import DATA

G1 = [DATA / "robots" / f"unitree_g1_29dof{suffix}" for suffix in (".xml", ".urdf")]


def walk(frames: int = 150, fps: float = 60.0) -> Motion:
    """Steps on the spot that travel: legs swing against each other, knees bend, arms hang and swing."""
    skeleton = BODY.skeleton(prior_shape(1.75))
    roles = find_roles(skeleton).roles
    time = np.arange(frames) / fps
    turns = np.tile(np.eye(3), (frames, len(skeleton), 1, 1))
    x, y = np.eye(3)[0], np.eye(3)[1]
    for side, sign in (("left", 1), ("right", -1)):
        phase = 2 * np.pi * 0.8 * time + (0 if sign > 0 else np.pi)
        swing, bend = -0.35 * np.sin(phase), 0.7 * np.clip(np.cos(phase), 0, None) ** 2
        for role, angle in (("thigh", swing - bend / 2), ("shin", bend), ("foot", -swing - bend / 2)):
            turns[:, roles[f"{side}_{role}"]] = exp_so3(angle[:, None] * x)
        down = exp_so3(np.array(1.3 * sign) * y)
        turns[:, roles[f"{side}_upper_arm"]] = exp_so3(0.3 * np.sin(phase)[:, None] * x) @ down
    motion = Motion(skeleton, fps, np.zeros((frames, 3)), continuous_quat(quat_from_matrix(turns)))
    feet = motion.joint_positions_world()[:, [roles["left_foot"], roles["right_foot"]]]
    low = feet[..., 2].min(axis=1)
    stands = np.argmin(feet[..., 2], axis=1)
    step = np.diff(feet[..., 1], axis=0)[np.arange(frames - 1), stands[:-1]]
    root = np.stack([np.zeros(frames), -np.concatenate([[0], np.cumsum(step)]), 0.09 - low], axis=1)
    return replace(motion, root_positions_world=root)


@pytest.fixture(scope="module")
def human() -> tuple[Motion, dict[str, int]]:
    motion = walk()
    return motion, find_roles(motion.skeleton).roles


@pytest.fixture(scope="module", params=["tall", "small"])
def take(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory,
         human: tuple[Motion, dict[str, int]]) -> RobotTake:  # fmt: skip
    write = {"tall": write_tall, "small": write_small}[request.param]
    return retarget_to_robot(*human, read_robot(write(tmp_path_factory.mktemp("robot"))))


def without_meshes(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".xml":
        return re.sub(r"<geom[^>]*mesh=[^>]*/>|<asset>.*?</asset>", "", text, flags=re.S)
    text = re.sub(r"<(visual|collision)[^>]*>.*?</\1>", "", text, flags=re.S)
    return re.sub(r"(<robot [^>]*>)", r'\1<mujoco><compiler fusestatic="false"/></mujoco>', text, count=1)


@pytest.mark.parametrize("which", ["tall", "small", "g1_mjcf", "g1_urdf"])
def test_forward_kinematics_is_that_of_mujoco(which: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = (
        {"tall": write_tall, "small": write_small}[which](tmp_path) if "_" not in which else G1[which.endswith("urdf")]
    )
    if not path.is_file():
        pytest.skip(f"../shared/data/robots/{path.name} is not here")
    robot, rng = read_robot(path), np.random.default_rng(0)
    model = (mujoco.MjModel.from_xml_path(str(path)) if which == "tall"
             else mujoco.MjModel.from_xml_string(without_meshes(path)))  # fmt: skip
    data = mujoco.MjData(model)
    free, compared = model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE, 0
    for _ in range(5):
        root, turn = (
            (rng.normal(size=(1, 3)), exp_so3(rng.normal(size=(1, 3)))) if free else (np.zeros((1, 3)), np.eye(3)[None])
        )
        joints = robot.all_joints(rng.uniform(-1, 1, (1, len(robot.free))))
        if free:
            data.qpos[:3], data.qpos[3:7] = root[0], quat_from_matrix(turn)[0]
        for joint, value in zip(robot.joints, joints[0], strict=True):
            data.qpos[model.joint(joint.name).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        turns, places = robot.forward(root, turn, joints)
        for link, name in enumerate(robot.links):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
            if body > 0:
                compared += 1
                np.testing.assert_allclose(places[0, link], data.xpos[body], atol=1e-6)
                np.testing.assert_allclose(turns[0, link], data.xmat[body].reshape(3, 3), atol=1e-6)
    assert compared >= 5 * (len(robot.joints) - 1)
    limits = {model.joint(i).name: model.jnt_range[i] for i in range(model.njnt) if model.jnt_limited[i]}
    for joint in robot.joints:
        np.testing.assert_allclose([joint.lower, joint.upper], limits[joint.name], atol=1e-9)


def test_a_chain_of_frames_written_in_every_way_of_mjcf(tmp_path: Path) -> None:
    half = np.sqrt(0.5)
    path = tmp_path / "frames.xml"
    path.write_text(f"""<mujoco><compiler angle="degree" eulerseq="zyx" autolimits="false"/><worldbody>
      <body name="a" quat="{half} 0 0 {half}"><freejoint/>
      <body name="b" pos="1 0 0" euler="90 0 0"><joint name="j" pos="0 0.5 0" axis="0 0 2" range="-9 9"/>
      <body name="c" pos="1 0 0" axisangle="0 0 2 90"><body name="d" pos="1 0 0" xyaxes="0 1 0 -1 0 0">
      <body name="e" pos="1 0 0" zaxis="1 0 0"><joint name="k" type="slide" axis="0 0 1" limited="true" range="-1 2"/>
      </body></body></body></body></body></worldbody></mujoco>""", encoding="utf-8")  # fmt: skip
    robot = read_robot(path)
    assert robot.joints[0].upper == np.inf and robot.joints[1].upper == 2.0
    quarter = exp_so3(np.array([0, 0, np.pi / 2]))
    turns, places = robot.forward(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 2)))
    np.testing.assert_allclose(turns[0, 1], quarter, atol=1e-12)
    np.testing.assert_allclose(places[0, 2:], [[1, 1, 0], [0, 1, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(turns[0, 4] @ [0, 0, 1], turns[0, 3] @ [1, 0, 0], atol=1e-12)
    _, moved = robot.forward(np.zeros((1, 3)), np.eye(3)[None], np.array([[np.pi, 0.25]]))
    np.testing.assert_allclose(moved[0, 1], [0, 0, 0], atol=1e-12)  # about a point half a metre beside it
    step = moved[0, 4] - robot.forward(np.zeros((1, 3)), np.eye(3)[None], np.array([[np.pi, 0.0]]))[1][0, 4]
    np.testing.assert_allclose(np.linalg.norm(step), 0.25, atol=1e-12)


def test_parts_are_found_whatever_they_are_called(tmp_path: Path) -> None:
    tall = read_robot(write_tall(tmp_path))
    parts = find_link_roles(tall)
    assert parts.table(tall) == {
        "hips": "base", "chest": "trunk",
        **{f"{side}_{role}": f"{side}_{link}" for side in ("left", "right") for role, link in {
            "thigh": "hip_a", "shin": "shank", "foot": "sole", "upper_arm": "arm_a", "forearm": "forearm"}.items()},
    }  # fmt: skip
    np.testing.assert_allclose(parts.axes[:, 1], [-1, 0, 0], atol=1e-9)
    small = read_robot(write_small(tmp_path, "right", "left"))  # names that lie
    parts = find_link_roles(small)
    np.testing.assert_allclose(parts.axes[:, 0], [1, 0, 0], atol=1e-9)
    table = parts.table(small)
    assert table["left_shin"] == "right_l3" and table["right_forearm"] == "left_a3" and table["head"] == "skull"
    # Its fingers are no part of the arm.
    assert small.links[parts.limbs["left_arm"].end] == "right_a3" and "left_hand" not in table


def test_a_map_replaces_what_is_found(tmp_path: Path) -> None:
    robot = read_robot(write_tall(tmp_path))
    table = find_link_roles(robot).table(robot)
    mapped = find_link_roles(robot, table)
    assert mapped.table(robot) == table and mapped.how == "map"
    with pytest.raises(MuybridgeError, match="no link 'nose'"):
        find_link_roles(robot, table | {"left_foot": "nose"})
    with pytest.raises(MuybridgeError, match="not between"):
        find_link_roles(robot, table | {"left_shin": "right_shank"})
    with pytest.raises(MuybridgeError, match="right_forearm"):
        find_link_roles(robot, {k: v for k, v in table.items() if k != "right_forearm"})


def test_a_take_on_robots_of_other_makes_holds_their_limits(take: RobotTake) -> None:
    quality, robot, motion = take.quality, take.motion.robot, take.motion
    assert quality.beyond_limits == 0 and quality.inside_frames == 0
    assert take.contact.any(axis=(0, 2)).all() and quality.sliding <= 0.02
    assert quality.under_floor_m < 0.005
    height = robot.at_rest()[1][:, 2].max() - robot.at_rest()[1][:, 2].min()
    assert quality.tracking_m < 0.03 * height
    for k, joint in enumerate(robot.joints):
        values = motion.joints[:, k]
        assert values.min() >= joint.lower - 1e-9 and values.max() <= joint.upper + 1e-9
        assert np.abs(np.diff(values)).max() * motion.fps <= joint.velocity * (1 + 1e-9)
        if joint.mimic is not None:
            other = [each.name for each in robot.joints].index(joint.mimic.joint)
            np.testing.assert_allclose(values, joint.mimic.gain * motion.joints[:, other] + joint.mimic.offset)


def test_legs_go_where_the_persons_do(take: RobotTake, human: tuple[Motion, dict[str, int]]) -> None:
    motion, roles = human
    robot, limb = take.motion.robot, take.parts.limbs["left_leg"]
    turns, places = robot.forward(take.motion.root, exp_so3(_rotvec(take.motion.quat_wxyz)), take.motion.joints)
    # A thigh as the person's: the angle between the hip-knee line and the vertical, over time.
    person = motion.joint_positions_world()
    mine = _tilt(places[:, limb.middle] - (places[:, limb.base] + turns[:, limb.base] @ _local(take)))
    theirs = _tilt(person[:, roles["left_shin"]] - person[:, roles["left_thigh"]])
    assert np.degrees(np.abs(mine - theirs)).mean() < 6
    assert np.corrcoef(mine, theirs)[0, 1] > 0.95
    yaw = take.parts.axes
    ahead = turns[:, take.parts.hips] @ (robot.at_rest()[0][take.parts.hips].T @ -yaw[:, 1])
    assert (ahead[:, 1] < -0.9).all()  # as the person, who faces -Y


def _rotvec(quat: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(np.roll(quat, -1, axis=-1)).as_rotvec())


def _local(take: RobotTake) -> FloatArray:
    turns, places = take.motion.robot.at_rest()
    base = take.parts.limbs["left_leg"].base
    return np.asarray(turns[base].T @ (take.parts.limbs["left_leg"].points[0] - places[base]))


def _tilt(way: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(-way[:, 1], -way[:, 2]))


def test_feet_are_flat_where_the_persons_are(take: RobotTake) -> None:
    robot = take.motion.robot
    turns, _ = robot.forward(take.motion.root, exp_so3(_rotvec(take.motion.quat_wxyz)), take.motion.joints)
    rest = robot.at_rest()[0]
    for k, side in enumerate(("left", "right")):
        foot = take.parts.limbs[f"{side}_leg"].end
        up = (turns[:, foot] @ rest[foot].T)[:, :, 2]
        flat = take.contact[:, k].all(axis=-1)
        assert flat.sum() > 20 and np.degrees(np.arccos(np.clip(up[flat, 2], -1, 1))).max() < 2


def test_the_first_frame_means_nothing(tmp_path: Path, human: tuple[Motion, dict[str, int]]) -> None:
    motion, roles = human
    robot = read_robot(write_tall(tmp_path))
    whole = retarget_to_robot(motion, roles, robot).motion.joints
    part = retarget_to_robot(motion.select(slice(40, None)), roles, robot).motion.joints
    assert np.degrees(np.abs(whole[60:-1] - part[20:-1])).max() < 2


def test_slow_joints_are_not_driven_faster(tmp_path: Path, human: tuple[Motion, dict[str, int]]) -> None:
    motion, roles = human
    robot = read_robot(write_small(tmp_path))
    slow = replace(robot, joints=tuple(replace(joint, velocity=1.5) for joint in robot.joints))
    take = retarget_to_robot(motion, roles, slow)
    assert np.abs(np.diff(take.motion.joints, axis=0)).max() * motion.fps <= 1.5 * (1 + 1e-9)
    assert take.quality.beyond_limits == 0


def test_links_are_kept_apart(tmp_path: Path, human: tuple[Motion, dict[str, int]]) -> None:
    motion, roles = human
    quat = motion.quat_wxyz.copy()
    down = np.array([np.cos(0.85), 0, np.sin(0.85), 0])
    for side, sign in (("left", 1), ("right", -1)):  # arms through the trunk
        quat[:, roles[f"{side}_upper_arm"]] = down * [1, 1, sign, 1]
    take = retarget_to_robot(replace(motion, quat_wxyz=quat), roles, read_robot(write_tall(tmp_path)))
    assert take.quality.inside_frames == 0 and len(take.capsules.pairs) > 20
    assert take.quality.tracking_m > 0.005  # the targets are where links may not be


def test_capsules_cover_what_the_file_has(tmp_path: Path) -> None:
    robot = read_robot(write_tall(tmp_path))
    capsules = find_capsules(robot)
    thigh = capsules.link == robot.links.index("left_thigh")
    np.testing.assert_allclose(capsules.radius[thigh], 0.055)
    ends = np.sort(np.concatenate([capsules.start[thigh], capsules.stop[thigh]])[:, 2])
    np.testing.assert_allclose(ends, [-0.34, -0.06], atol=1e-12)
    turns, places = (each[None] for each in robot.at_rest())
    assert capsules.distances(turns, places).min() > 0


def test_files_hold_the_joints_in_the_order_of_the_robots_file(take: RobotTake, tmp_path: Path) -> None:
    motion = take.motion
    for suffix in (".csv", ".npz", ".pkl"):
        write_robot_motion(tmp_path / f"out{suffix}", motion)
    table = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)
    names = [joint.name for joint in motion.robot.joints]
    assert list(table.dtype.names or ())[8:] == names
    np.testing.assert_allclose(np.stack([table[name] for name in names], axis=1), motion.joints, atol=1e-9)
    np.testing.assert_allclose(np.diff(table["time"]), 1 / motion.fps, atol=1e-8)
    arrays = np.load(tmp_path / "out.npz")
    assert arrays["joint_names"].tolist() == names and arrays["fps"] == motion.fps
    np.testing.assert_array_equal(arrays["root_quat_wxyz"], motion.quat_wxyz)
    content = pickle.loads((tmp_path / "out.pkl").read_bytes())
    assert set(content) == {"fps", "root_pos", "root_rot", "dof_pos", "local_body_pos", "link_body_list"}
    np.testing.assert_array_equal(content["root_rot"][:, [3, 0, 1, 2]], motion.quat_wxyz)
    np.testing.assert_array_equal(content["dof_pos"], motion.joints)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.xml", "<mujoco><worldbody/></mujoco>", "no body"),
        ("a.xml", "<html/>", "<html>"),
        ("a.xml", "<mujoco>", "MJCF"),
        ("a.xml", '<mujoco><include file="a.xml"/></mujoco>', "included twice"),
        ("a.xml", '<mujoco><worldbody><body><joint type="ball"/></body></worldbody></mujoco>', "'ball'"),
        ("a.xml", '<mujoco><worldbody><body pos="0 0 nan"/></worldbody></mujoco>', "not finite"),
        ("a.urdf", '<robot><link name="a"/></robot>', "no joint that moves"),
        ("a.urdf", '<robot><link name="a"/><link name="b"/>'
         '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
         '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>', "circle"),
        ("a.urdf", '<robot><link name="a"/><joint name="j" type="fixed"><parent link="a"/>'
         '<child link="c"/></joint></robot>',
         "no child"),
        ("a.txt", "", "described by"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_in_one_line(name: str, text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FormatError) as caught:
        read_robot(path)
    assert message in str(caught.value) and name in str(caught.value) and "\n" not in str(caught.value)


def test_a_robot_on_four_legs_is_refused(tmp_path: Path) -> None:
    legs = ""
    for x in (0.3, -0.3):
        for y in (0.1, -0.1):
            legs += (f'<body name="a{x}{y}" pos="{x} {y} 0"><joint name="a{x}{y}" axis="1 0 0"/><body name="b{x}{y}">'
                     f'<joint name="b{x}{y}" axis="0 1 0"/><body name="c{x}{y}" pos="0 0 -0.2">'
                     f'<joint name="c{x}{y}" axis="0 1 0"/>'
                     '<geom size="0.02" pos="0 0 -0.2"/></body></body></body>')  # fmt: skip
    path = tmp_path / "dog.xml"
    path.write_text(
        f'<mujoco><worldbody><body name="d"><freejoint/>{legs}</body></worldbody></mujoco>', encoding="utf-8"
    )
    with pytest.raises(MuybridgeError, match="four legs"):
        find_link_roles(read_robot(path))


@pytest.mark.parametrize("path", G1, ids=["mjcf", "urdf"])
def test_a_real_robot(path: Path, human: tuple[Motion, dict[str, int]]) -> None:
    if not path.is_file():
        pytest.skip(f"../shared/data/robots/{path.name} is not here")
    robot = read_robot(path)
    assert len(robot.joints) == 29
    take = retarget_to_robot(*human, robot)
    assert take.quality.beyond_limits == 0 and take.quality.inside_frames == 0 and take.quality.sliding <= 0.02
