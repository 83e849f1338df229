"""The way that a body goes over the ground, taken out of a motion, or given to a root bone."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    matrix_from_quat,
    multiply_quat,
    quat_from_matrix,
    quat_from_rotvec,
)
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import body_joint, check_editable, placed

_SMOOTHING = 0.3
_OTHER_NAMES = ("root_motion", *(f"root_motion_{k}" for k in range(2, 100)))
_CLEAR = 0.05  # of the quaternion's norm: less of it about the vertical says nothing about the heading


@dataclass(frozen=True, eq=False)
class GroundPath:
    """Where a body is over the ground and where it faces.

    Attributes:
        places: (T, 2) metres, of the point on the ground under the body.
        yaw: (T,) radians about the world's Z axis from the heading of the rest pose, without jumps.
    """

    places: FloatArray
    yaw: FloatArray


def ground_path(
    motion: Motion, smoothing: float = _SMOOTHING, turning: bool = True, roles: Mapping[str, int] | None = None
) -> GroundPath:
    """The path of the hips over the ground (of the first joint that moves, where no hips are known).

    Args:
        motion: Z up.
        smoothing: seconds, standard deviation of a Gaussian: what the hips do faster, such as swaying with each step,
            is not part of the path. Zero follows the hips exactly.
        turning: whether the path turns with the body; else its heading is zero.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: the smoothing is below zero or not a number, or the clip is empty.
    """
    check_editable(motion)
    if not 0 <= smoothing < np.inf:
        raise MuybridgeError(f"the smoothing must be zero or more seconds, not {smoothing:g}")
    world = motion.forward()[:, body_joint(motion, roles)]
    sigma = smoothing * motion.fps
    yaw = _smooth(_yaw(world[:, :3, :3]), sigma) if turning else np.zeros(len(motion))
    return GroundPath(_smooth(world[:, :2, 3], sigma), yaw)


def _yaw(turns: FloatArray) -> FloatArray:
    """(T,) radians: the twist about Z of (T, 3, 3) rotations from the rest pose; interpolated where the body lies on
    its head, which has no heading."""
    quat = quat_from_matrix(turns)
    clear = np.hypot(quat[:, 0], quat[:, 3]) > _CLEAR
    if not clear.any():
        return np.zeros(len(turns))
    frames = np.arange(len(turns))
    yaw = np.unwrap(2 * np.arctan2(quat[clear, 3], quat[clear, 0]))
    return np.asarray(np.interp(frames, frames[clear], yaw))


def _smooth(values: FloatArray, sigma: float) -> FloatArray:
    """Gaussian over time; a straight path stays straight to its ends."""
    if sigma <= 0 or len(values) < 2:
        return values
    pad = int(np.ceil(4 * sigma))
    wide = np.pad(values, ((pad, pad), *[(0, 0)] * (values.ndim - 1)), mode="reflect", reflect_type="odd")
    return np.asarray(gaussian_filter1d(wide, sigma, axis=0, mode="nearest")[pad : pad + len(values)])


def without_path(motion: Motion, path: GroundPath) -> Motion:
    """The motion relative to a path: the body stays over the origin."""
    c, s = np.cos(-path.yaw), np.sin(-path.yaw)
    x, y = path.places.T
    return placed(motion, -path.yaw, -np.stack([c * x - s * y, s * x + c * y, np.zeros(len(x))], axis=1))


def with_path(motion: Motion, path: GroundPath) -> Motion:
    """The inverse of `without_path`."""
    return placed(motion, path.yaw, np.column_stack([path.places, np.zeros(len(path.yaw))]))


def in_place(
    motion: Motion, smoothing: float = _SMOOTHING, turning: bool = False, roles: Mapping[str, int] | None = None
) -> Motion:
    """The motion on the spot, over the origin, as if on a treadmill.

    Args:
        motion: Z up.
        smoothing: seconds; see `ground_path`.
        turning: whether turning is taken out too, so that the body always faces one way.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: as `ground_path`.
    """
    return without_path(motion, ground_path(motion, smoothing, turning, roles))


def extract_root_motion(
    motion: Motion, name: str | None = None, smoothing: float = _SMOOTHING, turning: bool = True,
    roles: Mapping[str, int] | None = None,
) -> Motion:  # fmt: skip
    """Give the path over the ground to a root bone, which game engines move a character by.

    A bone that is above the hips already becomes it; otherwise a new bone is put above every root. All joints stay
    where they are in the world.

    Args:
        motion: Z up.
        name: of a new bone; None: "root", or "root_motion" where a joint has that name.
        smoothing: seconds; see `ground_path`.
        turning: whether the bone turns with the body.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: a joint has the name already, or as `ground_path`.
    """
    roles = find_motion_roles(motion).roles if roles is None else roles
    path = ground_path(motion, smoothing, turning, roles)
    skeleton, body = motion.skeleton, body_joint(motion, roles)
    has_bone = body != 0 and bool(skeleton.is_ancestor[0, body]) and len(skeleton.roots) == 1
    name = name or next(n for n in ("root", *_OTHER_NAMES) if n not in skeleton.names)
    if not has_bone and name in skeleton.names:
        raise MuybridgeError(f"there is a joint {name!r} already; choose another name for the root bone")
    shift = 0 if has_bone else 1
    carried = [j for j, parent in enumerate(skeleton.parents) if parent == 0] if has_bone else list(skeleton.roots)
    target = skeleton if has_bone else _with_bone(skeleton, name)
    target = replace(target, sliding=tuple(sorted({*target.sliding, *(j + shift for j in carried)})))

    world = motion.forward()
    bone = quat_from_rotvec(path.yaw[:, None] * np.array([0.0, 0.0, 1.0]))
    foot = np.column_stack([path.places, np.zeros(len(motion))])
    back = np.swapaxes(matrix_from_quat(bone), 1, 2)
    quat = np.empty((len(motion), len(target), 4))
    quat[:, shift:] = motion.quat_wxyz
    quat[:, 0] = bone
    slides = np.empty((len(motion), len(target.sliding), 3))
    for k, j in enumerate(j - shift for j in target.sliding):
        if j in carried:
            slides[:, k] = (back @ (world[:, j, :3, 3] - foot)[..., None])[..., 0]
        else:
            assert motion.translations is not None
            slides[:, k] = motion.translations[:, skeleton.sliding.index(j)]
    for j in carried:
        turned = motion.quat_wxyz[:, j] if shift else multiply_quat(motion.quat_wxyz[:, 0], motion.quat_wxyz[:, j])
        quat[:, j + shift] = multiply_quat(conjugate_quat(bone), turned)
    return Motion(target, motion.fps, foot, continuous_quat(quat), slides)


def _with_bone(skeleton: Skeleton, name: str) -> Skeleton:
    """The skeleton under a new bone that stands on the ground at rest."""
    ends = skeleton.rest_positions + np.where(np.isfinite(skeleton.tips), skeleton.tips, 0.0)
    up = -min(float(ends[:, 2].min()), float(skeleton.rest_positions[:, 2].min()))
    offsets = skeleton.offsets.copy()
    offsets[list(skeleton.roots)] += (0.0, 0.0, up)
    return Skeleton(
        names=(name, *skeleton.names),
        parents=(-1, *(parent + 1 for parent in skeleton.parents)),
        offsets=np.concatenate([np.zeros((1, 3)), offsets]),
        tips=np.concatenate([np.full((1, 3), np.nan), skeleton.tips]),
        twist_axis=(2, *skeleton.twist_axis),
        lower=np.concatenate([np.full((1, 3), -np.inf), skeleton.lower]),
        upper=np.concatenate([np.full((1, 3), np.inf), skeleton.upper]),
        axes=None if skeleton.axes is None else np.concatenate([np.eye(3)[None], skeleton.axes]),
        sliding=tuple(j + 1 for j in skeleton.sliding),
    )
