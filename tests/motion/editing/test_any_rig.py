"""Every step on rigs whose joints have names of no program: roles come from the shape or from the file's own table."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.motion.contacts.feet import find_legs
from muybridge.motion.contacts.planting import plant_feet
from muybridge.motion.editing import STEPS, edit_take, find_sides, mirror, parse_steps, rename_joints
from muybridge.motion.formats import write_file
from muybridge.motion.take import Take
from tests.geometry.roles.bodies import HABITS, four_legged, human
from tests.motion.editing.clips import walk
from tests.motion.retargeting.test_retarget import character, moving

STRANGE = ("unreal", "blender", "cartoon", "quaternius", "mmd", "wings")
WORDS = {
    "trim": "0.1",
    "resample": "50",
    "turn": "30",
    "move": "1 0 0",
    "rename": "mixamo",
    "scale": "1.1",
    "bands": "1 1 1.2 keep",
    "timewarp": "0.2=0.3",
}


def strange(habit, turn=None, frames=40):
    """A motion of a body with joints in any order, named by numbers."""
    rng = np.random.default_rng(3)
    skeleton, roles = human(rng, **HABITS[habit]).build(turn, 1.0, rng)
    return moving(skeleton, 3, frames, size=0.1), roles


def scrambled_walk():
    motion = walk(60)
    names = tuple(f"bone {k}" for k in np.random.default_rng(0).permutation(len(motion.skeleton)))
    return replace(motion, skeleton=replace(motion.skeleton, names=names))


@pytest.mark.parametrize("habit", STRANGE)
def test_every_step_works_on_a_rig_without_known_names(habit, tmp_path):
    motion, roles = strange(habit)
    write_file(tmp_path / "pose.glb", Take(motion=motion.select([3])))
    hand = motion.joint_positions_world()[6, roles["left_hand"]]
    words = {**WORDS, "warp": f"{tmp_path / 'pose.glb'} 3f",
             "reach": "left_hand 6f " + " ".join(f"{v:.3f}" for v in hand)}  # fmt: skip
    for name in STEPS:
        out, notes = edit_take(Take(motion=motion), parse_steps([name, *words.get(name, "").split()]))
        assert out.motion is not None and np.isfinite(out.motion.quat_wxyz).all() and len(notes) == 1


@pytest.mark.parametrize("habit", STRANGE)
def test_rename_and_mirror_take_the_sides_that_the_shape_shows(habit):
    motion, roles = strange(habit)
    names = rename_joints(motion, "mixamo").skeleton.names
    sides = find_sides(motion.skeleton)
    for role, joint in roles.items():
        if role != "spine" and role in PROFILES["mixamo"]:
            assert names[joint] == PROFILES["mixamo"][role]
        if role.startswith("left_"):
            assert sides.partner[joint] == roles["right_" + role[5:]]


def test_mirrored_twice_a_rig_without_known_names_is_as_it_was():
    motion, _ = strange("unreal")
    again = mirror(mirror(motion))
    assert np.abs(again.joint_positions_world() - motion.joint_positions_world()).max() < 1e-9


def test_a_walk_without_names_is_edited_as_the_one_with_names():
    for words in (["mirror"], ["in-place"], ["plant"], ["turn", "40"], ["root-motion"], ["loop"]):
        one, other = (edit_take(Take(motion=m), parse_steps(words))[0].motion for m in (walk(60), scrambled_walk()))
        assert np.abs(one.joint_positions_world() - other.joint_positions_world()).max() < 1e-6, words


@pytest.mark.parametrize(("axis", "angle"), [("z", 120), ("x", -90), ("x", 90)])
def test_planting_does_not_depend_on_how_a_rig_faces_at_rest(axis, angle):
    turn = Rotation.from_euler(axis, angle, degrees=True)
    body = human(np.random.default_rng(1), root=True, fingers=5)
    straight, roles = character(body)
    turned, _ = character(body, turn)
    quat = moving(straight.skeleton, 1, 30, size=0.05).quat_wxyz
    root = np.zeros((30, 3))
    places = []
    for hero, back in ((straight, np.eye(3)), (turned, turn.as_matrix().T)):
        local = Rotation.from_quat(quat.reshape(-1, 4)[:, [1, 2, 3, 0]]).as_matrix().reshape(30, -1, 3, 3)
        local = back.T @ local @ back
        local[:, 0] = back @ local[:, 0]
        turns = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]].reshape(30, -1, 4)
        motion = replace(hero.motion, root_positions_world=root, quat_wxyz=turns)
        legs = find_legs(motion.skeleton, roles, motion)
        assert np.abs(back.T @ find_legs(straight.skeleton, roles)[0].heel - legs[0].heel).max() < 1e-9
        places.append(plant_feet(motion, roles=roles).motion.joint_positions_world())
    assert np.abs(places[0] - places[1]).max() < 1e-6


def test_feet_of_control_bones_are_planted_at_the_ends_of_their_shins():
    motion, roles = strange("quaternius", frames=60)
    at = motion.joint_positions_world()
    gap = np.linalg.norm(at[:, roles["left_foot"]] - at[:, roles["left_shin"]], axis=1)
    # The feet follow the shins, as the exporter of such a rig bakes them.
    done = plant_feet(with_feet_at_shins(motion, roles), roles=roles)
    after = done.motion.joint_positions_world()
    kept = np.linalg.norm(after[:, roles["left_foot"]] - after[:, roles["left_shin"]], axis=1)
    assert np.ptp(gap) > 1e-3 and np.ptp(kept) < 1e-6 and done.moved_feet_m > 0


def with_feet_at_shins(motion, roles):
    """The motion with each foot where it was at rest, as seen from its shin."""
    skeleton = motion.skeleton
    feet = tuple(sorted(roles[f"{side}_foot"] for side in ("left", "right")))
    world, rest = motion.forward(), skeleton.rest_positions
    slides = np.zeros((len(motion), 2, 3))
    for k, foot in enumerate(feet):
        side = "left" if foot == roles["left_foot"] else "right"
        shin, parent = roles[f"{side}_shin"], skeleton.parents[foot]
        at = world[:, shin, :3, 3] + world[:, shin, :3, :3] @ (rest[foot] - rest[shin])
        gap = at - world[:, parent, :3, 3]
        slides[:, k] = (np.swapaxes(world[:, parent, :3, :3], -1, -2) @ gap[..., None])[..., 0]
    return replace(motion, skeleton=replace(skeleton, sliding=feet), translations=slides)


def test_the_table_of_a_vrm_file_counts_before_its_names():
    motion, roles = strange("plain")
    table = {PROFILES["vrm"][role]: j for role, j in roles.items() if role in PROFILES["vrm"]}
    table["leftUpperArm"], table["rightUpperArm"] = table["rightUpperArm"], table["leftUpperArm"]
    table["leftLowerArm"], table["rightLowerArm"] = table["rightLowerArm"], table["leftLowerArm"]
    table["leftHand"], table["rightHand"] = table["rightHand"], table["leftHand"]
    out, _ = edit_take(Take(motion=motion, humanoid=table), parse_steps(["root-motion", "rename", "mixamo"]))
    assert out.motion.skeleton.names[roles["right_hand"] + 1] == PROFILES["mixamo"]["left_hand"]


def test_what_has_no_human_body_is_edited_but_where_roles_are_needed():
    rng = np.random.default_rng(0)
    motion = moving(four_legged(rng).build(None, 1.0, rng)[0], size=0.1)
    assert not find_motion_roles(motion).roles
    assert find_sides(motion.skeleton).how["places"] > 5
    for name in ("plant", "rename mixamo"):
        with pytest.raises(MuybridgeError, match=f"step 1, {name}: .* animal on four legs") as refused:
            edit_take(Take(motion=motion), parse_steps(name.split()))
        assert refused.value.remedy == "no_human_body"
