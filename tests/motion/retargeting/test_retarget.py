"""Takes on other skeletons: directions, spines of other lengths, rest poses, feet."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character import Character, read_character
from muybridge.motion.formats.registry import read_file
from muybridge.motion.retargeting import RetargetOptions, retarget
from tests.geometry.roles.bodies import HABITS, human, lower_arms

BONES = (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
PLAIN = RetargetOptions(plant=False, touch=False)


def moving(skeleton, seed=0, frames=40, fps=30.0, size=0.5):
    """A motion of every joint about every axis."""
    rng = np.random.default_rng(seed)
    angles = gaussian_filter1d(rng.normal(size=(frames, len(skeleton), 3)), 4, axis=0) * 3 * size
    turns = Rotation.from_rotvec(angles.reshape(-1, 3)).as_matrix().reshape(frames, -1, 3, 3)
    root = gaussian_filter1d(rng.normal(size=(frames, 3)), 5, axis=0) + [0, 0, 1]
    return Motion(skeleton, fps, root, continuous_quat(quat_from_matrix(turns)))


def character(body, turn=None, scale=1.0, seed=None):
    """A character without meshes, and its roles."""
    rng = None if seed is None else np.random.default_rng(seed)
    skeleton, roles = body.build(turn, scale, rng)
    first = next(n for n, p in zip(body.names, body.parents, strict=True) if not p)
    start = body.at(first) * scale
    start = start if turn is None else turn.as_matrix() @ start
    motion = Motion(skeleton, 30.0, start[None], np.tile([1.0, 0, 0, 0], (1, len(skeleton), 1)))
    return Character(Path("hero.glb"), skeleton, start, motion), roles


def directions(motion, roles):
    at = motion.joint_positions_world()
    bones = np.stack([at[:, roles[f"{side}_{b}"]] - at[:, roles[f"{side}_{a}"]]
                      for side in ("left", "right") for a, b in BONES], 1)  # fmt: skip
    return bones / np.linalg.norm(bones, axis=-1, keepdims=True)


def source(seed=0, **options):
    skeleton, roles = human(np.random.default_rng(seed), **options).build()
    return moving(skeleton, seed), roles


def turn_between(a, b):
    """Degrees between rotations (..., 3, 3)."""
    gap = (np.swapaxes(a, -1, -2) @ b).reshape(-1, 3, 3)
    return np.degrees(np.linalg.norm(Rotation.from_matrix(gap).as_rotvec(), axis=1))


@pytest.mark.parametrize("habit", HABITS)
def test_limbs_have_the_directions_of_the_take(habit):
    motion, roles = source(fingers=5)
    hero, hero_roles = character(human(np.random.default_rng(1), **HABITS[habit]), seed=1)
    done = retarget(motion, roles, hero, hero_roles, PLAIN)
    gap = np.abs(directions(done.motion, hero_roles) - directions(motion, roles)).max()
    assert gap < 1e-6
    assert done.motion.skeleton.names == hero.skeleton.names and done.motion.skeleton.parents == hero.skeleton.parents


def test_a_body_on_its_own_skeleton_moves_as_it_did():
    skeleton, roles = human(np.random.default_rng(0), fingers=5, spine=3).build()
    motion = moving(skeleton)
    hero = Character(Path("hero.glb"), skeleton, np.array([0, 0, 0.95]), motion)
    done = retarget(motion, roles, hero, roles, PLAIN)
    core = [j for role, j in roles.items() if role != "head"]
    assert turn_between(motion.forward()[:, core, :3, :3], done.motion.forward()[:, core, :3, :3]).max() < 1e-5
    assert done.scale == pytest.approx(1.0)


@pytest.mark.parametrize(("axis", "angle"), [("z", 120), ("x", -90)])
def test_where_a_character_faces_at_rest_and_which_axis_is_up_do_not_matter(axis, angle):
    turn = Rotation.from_euler(axis, angle, degrees=True)
    motion, roles = source()
    body = human(np.random.default_rng(2), root=True, spine=4, fingers=4)
    straight, names = character(body)
    turned, _ = character(body, turn)
    one, other = (retarget(motion, roles, hero, names, PLAIN).motion for hero in (straight, turned))
    assert np.abs(one.joint_positions_world()[:, 1:] - other.joint_positions_world()[:, 1:]).max() < 1e-9


@pytest.mark.parametrize("fingers", [0, 5])
def test_t_pose_and_a_pose_copies_of_a_character_agree(fingers):
    motion, roles = source(fingers=5)
    rng = np.random.default_rng
    straight, names = character(human(rng(2), fingers=fingers))
    lowered, _ = character(lower_arms(human(rng(2), fingers=fingers), 50))
    one, other = (retarget(motion, roles, hero, names, PLAIN).motion for hero in (straight, lowered))
    assert np.abs(one.joint_positions_world() - other.joint_positions_world()).max() < 1e-6
    hands = [names["left_hand"], names["right_upper_arm"]]
    for j, angle in zip(hands, (50, -50), strict=True):
        back = Rotation.from_euler("y", angle, degrees=True).as_matrix()
        assert turn_between(one.forward()[:, j, :3, :3], other.forward()[:, j, :3, :3] @ back).max() < 0.5


def test_spines_of_other_lengths_end_as_the_take_does():
    motion, roles = source(spine=3, neck=1)
    chest = motion.forward()[:, motion.skeleton.index("b3"), :3, :3]
    for count in (1, 2, 5):
        body = human(np.random.default_rng(0), spine=count, neck=2)
        hero, names = character(body)
        world = retarget(motion, roles, hero, names, PLAIN).motion.forward()[..., :3, :3]
        last = body.names.index(f"spine{count - 1}")
        assert turn_between(chest, world[:, last]).max() < 1e-5
        assert turn_between(motion.forward()[:, roles["head"], :3, :3], world[:, names["head"]]).max() < 1e-5


def test_a_spine_of_five_bends_little_by_little():
    motion, roles = source(spine=1, neck=1)
    hero, names = character(human(np.random.default_rng(0), spine=5))
    world = retarget(motion, roles, hero, names, PLAIN).motion.forward()[..., :3, :3]
    joints = [names["hips"], *(names["hips"] + k for k in range(1, 6))]
    bends = np.array([turn_between(world[:, a], world[:, b]) for a, b in zip(joints, joints[1:], strict=False)])
    whole = turn_between(world[:, joints[0]], world[:, joints[-1]])
    assert np.abs(bends.sum(axis=0) - whole).max() < 1e-4 and (bends.max(axis=0) < 0.5 * whole + 1e-6).all()


def test_a_foot_of_a_control_bone_stays_at_the_end_of_its_shin():
    motion, roles = source()
    hero, names = character(human(np.random.default_rng(0), **HABITS["quaternius"]), seed=3)
    done = retarget(motion, roles, hero, names, PLAIN)
    at = done.motion.joint_positions_world()
    shin, foot = names["left_shin"], names["left_foot"]
    rest = hero.skeleton.rest_positions
    length = np.linalg.norm(at[:, foot] - at[:, shin], axis=1)
    assert np.abs(length - np.linalg.norm(rest[foot] - rest[shin])).max() < 1e-9
    assert foot in done.motion.skeleton.sliding


def test_units_of_the_take_do_not_matter():
    motion, roles = source()
    hero, names = character(human(np.random.default_rng(3), legs=0.6))
    big = replace(motion, skeleton=replace(motion.skeleton, offsets=motion.skeleton.offsets * 100),
                  root_positions_world=motion.root_positions_world * 100)  # fmt: skip
    one, other = (retarget(m, roles, hero, names) for m in (motion, big))
    assert np.abs(one.motion.quat_wxyz - other.motion.quat_wxyz).max() < 1e-6
    assert np.abs(one.motion.root_positions_world - other.motion.root_positions_world).max() < 1e-6


def test_a_take_without_frames_is_refused():
    motion, roles = source()
    hero, names = character(human(np.random.default_rng(3)))
    with pytest.raises(ValueError, match="without frames"):
        retarget(motion.select(slice(0, 0)), roles, hero, names)


@pytest.mark.parametrize("name", ["kaykit_knight.glb", "mesh2motion_female.glb"])
def test_feet_of_real_characters_stand_still_on_their_soles(real_data, name):
    from scripts.benchmarks.motion.retarget import cut_difference_deg, first_frame_difference_deg, score

    motion = read_file(real_data / "motion" / "02_01.amc").motion
    roles = find_roles(motion.skeleton).roles
    hero = read_character(real_data / "characters" / name)
    names = find_roles(hero.skeleton).roles
    result = score(motion, roles, hero, names)
    assert result.direction_deg < 0.5 and result.drift_mm < 3
    assert result.sole_mm[0] > -5 and result.sole_mm[2] < 5
    assert first_frame_difference_deg(hero, motion, roles, names) < 0.1
    assert cut_difference_deg(hero, motion, roles, names, 3) < 0.1
    assert result.inside[1] <= 0.5 * result.inside[0]
