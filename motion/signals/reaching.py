"""Key poses from goals: a hand or a foot at a place at a time.

An arm or a leg reaches by its two bones where it can, so that nothing else changes; farther away, the joints of the
trunk help by inverse kinematics. With a style the whole body does what those it was learned from would do, with its
hips and feet where they are. How the change comes and goes is `warping`'s.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.ik.solver import solve_ik
from muybridge.geometry.ik.tree import Goal, KinematicTree
from muybridge.geometry.ik.two_bone import move_two_bone
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat, quat_from_matrix
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.signals.warping import KeyPoses, key_frames, warp_to_keys
from muybridge.motion.style.model import Style
from muybridge.motion.style.posing import solve_pose

ENDS = ("left_hand", "right_hand", "left_foot", "right_foot")
_CHAINS = {"hand": ("upper_arm", "forearm", "hand"), "foot": ("thigh", "shin", "foot")}
_LEGS = ("left_foot", "right_foot", "left_thigh", "right_thigh")
_TRUNK = ("spine", "chest", "upper_chest", "clavicle")
_STRAIGHT = 0.985  # share of a limb's length that the trunk brings a goal within
_LEAN = np.radians(40)  # that a joint of the trunk may turn about an axis to reach
_NEAR_M = 1e-3  # by which a goal may be out of reach


def reach(
    motion: Motion, end: str, time: float, place: FloatArray, blend: float = 0.5,
    roles: Mapping[str, int] | None = None, style: Style | None = None,
) -> Motion:  # fmt: skip
    """The motion with a hand or a foot at a place at a time.

    Args:
        motion: Z up.
        end: one of ENDS; the wrist or ankle is what gets there.
        time: seconds; the nearest frame is the one that has the goal.
        place: (3,) metres in the world.
        blend: seconds before and behind over which the change fades.
        roles: role -> joint; None finds them.
        style: of the motion's skeleton, which what the goal leaves open is given to; None changes as little as it can.

    Raises:
        MuybridgeError: an end that is none, joints that are not known, a time outside of the clip, a place out of
            reach, or a style of another skeleton.
    """
    key = reach_key(motion, end, time, place, roles, style)
    return warp_to_keys(motion, key, blend=blend)


def reach_key(
    motion: Motion, end: str, time: float, place: FloatArray, roles: Mapping[str, int] | None = None,
    style: Style | None = None,
) -> KeyPoses:  # fmt: skip
    """The key pose of `reach`, which keys the joints of the limb and, where they help, of the trunk; with a style, all
    that the style knows."""
    check_editable(motion)
    if end not in ENDS:
        raise MuybridgeError(f"{end!r} cannot reach; choose one of {', '.join(ENDS)}")
    if style is not None:
        return _styled_key(motion, end, time, np.asarray(place, dtype=np.float64), style)
    joints, trunk = chain_of(motion, end, roles)
    frames = key_frames([time], motion)
    pose = motion.select(frames)
    goal = np.asarray(place, dtype=np.float64)
    leant = _lean(pose, trunk, joints, goal)
    moved, short = _bend(leant, joints, goal)
    if short > _NEAR_M:
        helped = ", even with the trunk's help" if trunk else ""
        raise MuybridgeError(f"{end} cannot reach {goal[0]:g}, {goal[1]:g}, {goal[2]:g} at {time:g} s: it is "
                             f"{short:.2f} m too far away{helped}")  # fmt: skip
    if short < -_NEAR_M:
        raise MuybridgeError(f"{end} cannot reach {goal[0]:g}, {goal[1]:g}, {goal[2]:g} at {time:g} s: it is too near "
                             f"to the {'shoulder' if 'hand' in end else 'hip'}")  # fmt: skip
    keyed = np.zeros(len(motion.skeleton), np.bool_)
    keyed[list(joints)] = True
    keyed[trunk] = leant is not pose
    return KeyPoses(frames, moved.quat_wxyz, keyed)


def _styled_key(motion: Motion, end: str, time: float, place: FloatArray, style: Style) -> KeyPoses:
    """The key pose in a style, with hips and feet where they are."""
    frames = key_frames([time], motion)
    pose = motion.select(frames)
    style.check_skeleton(motion.skeleton)
    if lost := [role for role in (end, *_LEGS) if role not in style.roles]:
        raise MuybridgeError(f"the style knows no joint to be {', '.join(lost)}", remedy="learn_style")
    world = pose.forward()[0]
    goals: dict[str, FloatArray] = {}
    for foot in ENDS[2:]:
        joint = style.roles[foot]
        # A foot that never turns against its shin in the takes cannot keep its orientation.
        goals[foot] = world[joint] if (style.hinge_joints == joint).any() else world[joint, :3, 3]
    goals[end] = place
    solved = solve_pose(style, pose, goals)
    worst = max(solved.errors, key=lambda name: solved.errors[name])
    if (short := solved.errors[worst]) > _NEAR_M:
        raise MuybridgeError(f"{end} cannot reach {place[0]:g}, {place[1]:g}, {place[2]:g} at {time:g} s with hips and "
                             f"feet where they are: {worst} is {short:.2f} m off at best")  # fmt: skip
    keyed = np.zeros(len(motion.skeleton), np.bool_)
    keyed[style.hinge_joints] = True
    for foot, thigh in zip(_LEGS[:2], _LEGS[2:], strict=True):
        if foot != end:  # it stands, or swings on, as it did: all that could change is where its knee points
            keyed[motion.skeleton.is_ancestor[style.roles[thigh]]] = False
    return KeyPoses(frames, solved.motion.quat_wxyz, keyed)


def chain_of(
    motion: Motion, end: str, roles: Mapping[str, int] | None = None
) -> tuple[tuple[int, int, int], list[int]]:
    """The three joints of a limb, from the trunk, and the joints of the trunk above it that may help, top first.

    Raises:
        MuybridgeError: one of the limb's is not known; the message names the role.
    """
    roles = find_motion_roles(motion).roles if roles is None else roles
    side, part = end.split("_")
    wanted = [f"{side}_{p}" for p in _CHAINS[part]]
    if lost := [role for role in wanted if role not in roles]:
        raise MuybridgeError(f"no joint is known to be {', '.join(lost)}", remedy="no_human_body")
    first, middle, last = (roles[role] for role in wanted)
    helpers = [] if part == "foot" else [roles[r] for p in _TRUNK for r in (p, f"{side}_{p}") if r in roles]
    above = motion.skeleton.is_ancestor[:, first]
    return (first, middle, last), [j for j in helpers if above[j]]


def _bend(pose: Motion, joints: tuple[int, int, int], goal: FloatArray) -> tuple[Motion, float]:
    """The pose with the limb's end at its goal, and metres by which it is out of reach."""
    a, b, c = joints
    world = pose.forward()
    places = world[:, a, :3, 3], world[:, b, :3, 3], world[:, c, :3, 3]
    ahead = np.cross(places[2] - places[0], np.array([1.0, 0.0, 0.0]))  # matters to a straight limb alone
    if np.linalg.norm(ahead) < 1e-6:
        ahead = np.array([[0.0, -1.0, 0.0]])
    ahead = ahead / np.linalg.norm(ahead)
    upper, lower, short = move_two_bone(places, places[0], goal[None], ahead)
    turns, parents = matrix_from_quat(pose.quat_wxyz), pose.skeleton.parents
    for j, turn, before in ((a, upper, np.eye(3)), (b, lower, upper)):
        above = before @ world[:, parents[j], :3, :3] if parents[j] >= 0 else np.eye(3)
        turns[:, j] = np.swapaxes(above, -1, -2) @ turn @ world[:, j, :3, :3]
    # The hand or foot keeps its orientation in the world.
    above = lower @ world[:, parents[c], :3, :3]
    turns[:, c] = np.swapaxes(above, -1, -2) @ world[:, c, :3, :3]
    return replace(pose, quat_wxyz=quat_from_matrix(turns)), float(short[0])


def _lean(pose: Motion, trunk: list[int], joints: tuple[int, int, int], goal: FloatArray) -> Motion:
    """The pose with its trunk turned so far that the limb reaches its goal; the pose itself where it does."""
    world = pose.forward()[0]
    shoulder, elbow, wrist = (world[j, :3, 3] for j in joints)
    length = float(np.linalg.norm(elbow - shoulder) + np.linalg.norm(wrist - elbow))
    away = shoulder - goal
    far = float(np.linalg.norm(away))
    if far <= length or not trunk:
        return pose
    tree = _balls(world, trunk)
    near = goal + away / far * _STRAIGHT * length
    top = world[trunk[-1], :3, 3]
    result = solve_ik(tree, [Goal(len(tree) - 1, shoulder - top, near - world[trunk[0], :3, 3])], method="null_space")
    turns = matrix_from_quat(pose.quat_wxyz)
    before = np.eye(3)
    for k, j in enumerate(trunk):
        step = np.eye(3)
        for axis in range(3):
            step = step @ exp_so3(np.eye(3)[axis] * result.theta[3 * k + axis])
        # In the world a joint gets what those above it got, then its own turn about its own place.
        above = world[pose.skeleton.parents[j], :3, :3]
        turns[0, j] = (before @ above).T @ (before @ step) @ world[j, :3, :3]
        before = before @ step
    return replace(pose, quat_wxyz=quat_from_matrix(turns))


def _balls(world: FloatArray, joints: list[int]) -> KinematicTree:
    """Ball joints at the joints' places, in the world's axes, which may each turn a little from how they are."""
    n = 3 * len(joints)
    offsets = np.zeros((n, 3))
    for k in range(1, len(joints)):
        offsets[3 * k] = world[joints[k], :3, 3] - world[joints[k - 1], :3, 3]
    names = tuple(f"{j}.{axis}" for j in joints for axis in "xyz")
    axes: FloatArray = np.tile(np.eye(3), (len(joints), 1))
    parents: IndexArray = np.arange(-1, n - 1)
    return KinematicTree(names, tuple(parents.tolist()), offsets, axes, np.full(n, -_LEAN), np.full(n, _LEAN),
                         np.zeros(n))  # fmt: skip
