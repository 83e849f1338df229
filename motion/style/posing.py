"""A pose from a few goals: of all poses that meet them, the likeliest one of a style."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.ik.solver import IkOptions, solve_ik
from muybridge.geometry.ik.tree import Goal
from muybridge.geometry.numerics.rotations import matrix_from_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.style.model import Style


@dataclass(frozen=True, eq=False)
class StyledPose:
    """A pose, and how well it meets its goals.

    Attributes:
        motion: one frame; its root is that of the pose that was given.
        errors: metres by which each goal's joint is off, by the name it was given.
        log_density: of the pose in the style; the more, the likelier.
    """

    motion: Motion
    errors: Mapping[str, float]
    log_density: float


def solve_pose(
    style: Style, pose: Motion, goals: Mapping[str, FloatArray], options: IkOptions | None = None
) -> StyledPose:
    """The likeliest pose of a style in which joints are where they should be.

    Args:
        style: of the pose's skeleton.
        pose: its first frame says where the root is and how it is turned, its skeleton how long the bones are. How its
            other joints are turned does not count.
        goals: role or name of a joint -> (3,) metres in the world, or (4, 4) world from joint, which also asks for the
            joint's orientation.
        options: tolerances and iterations.

    Raises:
        MuybridgeError: another skeleton, no goal, a joint that is not known or that no angle moves, or a goal of
            another shape.
    """
    style.check_skeleton(pose.skeleton)
    if not goals:
        raise MuybridgeError("a pose needs at least one goal")
    try:
        pose = pose.select(slice(0, 1)).with_rigid_bones(np.inf)
    except ValueError as error:
        raise MuybridgeError(str(error)) from error
    world_from_root = pose.forward()[0, 0]
    tree, last, away = style.tree(pose.skeleton)
    mean_from = _mean_orientations(style, pose)
    wanted = []
    for name, value in goals.items():
        j = joint_named(style, name)
        place, turn = _goal(name, value, world_from_root)
        # What moves a joint's place are the hinges above it; its own turn it alone.
        carrier = last[j] if turn is not None else last[style.parents[j]] if j else -1
        if carrier < 0:
            raise MuybridgeError(f"{name}: nothing that moves it turns in the style's takes; it can be no goal")
        offset = away[j] if carrier == last[j] else away[style.parents[j]] + mean_from[style.parents[j]] @ (
            pose.skeleton.offsets[j])  # fmt: skip
        orientation = None if turn is None else turn @ mean_from[j].T
        wanted.append(Goal(int(carrier), offset, place, orientation))
    result = solve_ik(tree, wanted, method="gmm_prior", prior=style.prior, options=options)
    if not result.success:
        # Goals that are far from anything in the takes: what is left is closed with as little change as it takes.
        closer = solve_ik(tree, wanted, result.theta, "damped", options)
        result = min(result, closer, key=lambda r: float(r.position_error.max()))
    turns = style.rotations(result.theta[None])
    turns[:, 0] = matrix_from_quat(pose.quat_wxyz[:, 0])
    out = replace(pose, quat_wxyz=quat_from_matrix(turns))
    places = out.joint_positions_world()[0]
    errors = {n: float(np.linalg.norm(places[joint_named(style, n)] - _goal_place(g))) for n, g in goals.items()}
    return StyledPose(out, errors, float(style.prior.log_density(result.theta[None])[0]))


def joint_named(style: Style, name: str) -> int:
    """The joint of a role or of a name.

    Raises:
        MuybridgeError: there is none.
    """
    if name in style.roles:
        return int(style.roles[name])
    if name in style.joints:
        return style.joints.index(name)
    known = ", ".join([*style.roles][:12] or style.joints[:12])
    raise MuybridgeError(f"the style knows no joint {name!r}; it knows {known}, ...")


def _goal_place(value: FloatArray) -> FloatArray:
    return value[:3, 3] if np.shape(value) == (4, 4) else np.asarray(value, dtype=np.float64)


def _goal(name: str, value: FloatArray, world_from_root: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    """Place and orientation in the root's axes."""
    if np.shape(value) not in ((3,), (4, 4)) or not np.isfinite(value).all():
        raise MuybridgeError(f"{name}: a goal is a place (3,) or a transform (4, 4) of finite numbers, not "
                             f"of the shape {np.shape(value)}")  # fmt: skip
    root = world_from_root[:3, :3]
    place = root.T @ (_goal_place(value) - world_from_root[:3, 3])
    return place, root.T @ value[:3, :3] if np.shape(value) == (4, 4) else None


def _mean_orientations(style: Style, pose: Motion) -> FloatArray:
    """(J, 3, 3) root from joint in the style's mean pose."""
    turns = matrix_from_quat(style.mean_wxyz)
    turns[0] = np.eye(3)
    return np.asarray(pose.skeleton.forward(np.zeros((1, 3)), turns[None])[0][0])
