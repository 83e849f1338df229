"""What all edits share: the check of their input, and changes of every frame or of the place of a whole take."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.rotations import matrix_from_quat, multiply_quat, quat_from_rotvec
from muybridge.geometry.roles import RoleMap, find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.take import Take

Editable = Motion | Points3D
T = TypeVar("T", Motion, Points3D)


def check_editable(thing: Editable) -> None:
    """Check that there is something to edit: frames, a frame rate and, of a motion, only numbers.

    Raises:
        MuybridgeError: it is empty, its frame rate is not above zero, or a value of a motion is NaN or infinite.
    """
    if not frame_count(thing):
        raise MuybridgeError("the clip is empty: it has no frames")
    if not 0 < thing.fps < np.inf:
        raise MuybridgeError(f"the clip has a frame rate of {thing.fps:g}; it must be above zero")
    if isinstance(thing, Points3D):
        if not np.isfinite(thing.points_world).any():
            raise MuybridgeError("every point of the clip is missing")
        return
    slides = () if thing.translations is None else (thing.translations,)
    for values in (thing.root_positions_world, thing.quat_wxyz, *slides):
        bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if bad.any():
            raise MuybridgeError(f"the motion is not a number (NaN) in frame {int(np.argmax(bad)) + 1}")
    if not np.isfinite(thing.skeleton.offsets).all():
        raise MuybridgeError("an offset of the skeleton is not a number (NaN)")


def frame_count(thing: Editable) -> int:
    """Frames of a motion or of points."""
    return len(thing) if isinstance(thing, Motion) else len(thing.points_world)


def duration(thing: Editable) -> float:
    """Seconds of a clip; each frame lasts 1 / fps."""
    return frame_count(thing) / thing.fps


def select_frames(thing: T, frames: Any) -> T:
    """Some frames: whatever indexes an array's first axis and keeps it (a slice, a mask, indices)."""
    if isinstance(thing, Motion):
        return cast(T, thing.select(frames))  # type: ignore[redundant-cast]
    return replace(
        thing,
        points_world=thing.points_world[frames],
        covariance_world=thing.covariance_world[frames],
        residual_px=thing.residual_px[:, frames],
        inlier=thing.inlier[:, frames],
    )


def roots_of(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Positions (T, R, 3) and rotations (T, R, 4) wxyz of all roots in the world."""
    skeleton = motion.skeleton
    places = [motion.root_positions_world]
    for root in skeleton.roots[1:]:
        assert motion.translations is not None
        places.append(motion.translations[:, skeleton.sliding.index(root)])
    return np.stack(places, axis=1), motion.quat_wxyz[:, list(skeleton.roots)]


def with_roots(motion: Motion, places: FloatArray, quat_wxyz: FloatArray) -> Motion:
    """The motion with other positions (T, R, 3) and rotations (T, R, 4) of its roots."""
    skeleton = motion.skeleton
    quat = motion.quat_wxyz.copy()
    quat[:, list(skeleton.roots)] = quat_wxyz
    slides = None if motion.translations is None else motion.translations.copy()
    for k, root in enumerate(skeleton.roots[1:], start=1):
        assert slides is not None
        slides[:, skeleton.sliding.index(root)] = places[:, k]
    return replace(motion, root_positions_world=places[:, 0], quat_wxyz=quat, translations=slides)


def placed(thing: T, yaw: FloatArray | float, shift: FloatArray) -> T:
    """Everything turned about the world's Z axis, then shifted.

    Args:
        thing: a motion or points.
        yaw: radians, counter-clockwise seen from above; one for all frames or (T,).
        shift: (3,) or (T, 3) metres.
    """
    turn = quat_from_rotvec(np.asarray(yaw, dtype=np.float64)[..., None] * np.array([0.0, 0.0, 1.0]))  # (4,) or (T, 4)
    matrix, shift = matrix_from_quat(turn)[..., None, :, :], np.asarray(shift)[..., None, :]
    if isinstance(thing, Motion):
        places, quat = roots_of(thing)
        moved = (matrix @ places[..., None])[..., 0] + shift
        return cast(T, with_roots(thing, moved, multiply_quat(turn[..., None, :], quat)))  # type: ignore[redundant-cast]
    return replace(
        thing,
        points_world=(matrix @ thing.points_world[..., None])[..., 0] + shift,
        covariance_world=matrix @ thing.covariance_world @ np.swapaxes(matrix, -1, -2),
    )


def per_channel(motion: Motion, positions: Callable[[FloatArray], FloatArray],
                rotations: Callable[[FloatArray], FloatArray]) -> Motion:  # fmt: skip
    """The motion with one function over the positions and slides (T, ..., 3), another over the quaternions."""
    return replace(
        motion,
        root_positions_world=positions(motion.root_positions_world),
        quat_wxyz=rotations(motion.quat_wxyz),
        translations=None if motion.translations is None else positions(motion.translations),
    )


def body_joint(motion: Motion, roles: Mapping[str, int] | None = None) -> int:
    """The joint that goes where the body goes: the hips, or the first joint that moves; `roles` None finds them."""
    skeleton = motion.skeleton
    hips = (find_motion_roles(motion).roles if roles is None else roles).get("hips")
    if hips is not None:
        return hips
    still = np.ptp(motion.root_positions_world, axis=0).max() < 1e-4 if len(motion) else False
    if motion.translations is not None and still:
        moves = np.ptp(motion.translations, axis=0).max(axis=1) > 1e-2
        below = [j for j, moving in zip(skeleton.sliding, moves, strict=True) if moving and skeleton.parents[j] == 0]
        if below:  # the one that carries most, rather than a handle
            return max(below, key=lambda j: int(skeleton.is_ancestor[j].sum()))
    return 0


def role_map(take: Take) -> RoleMap:
    """Roles of a motion's joints as the file states them, else by names, else by geometry."""
    assert take.motion is not None  # steps that need roles are refused for points
    table = {bone: take.motion.skeleton.names[j] for bone, j in take.humanoid.items()}
    return find_motion_roles(take.motion, table)


def body_roles(take: Take) -> dict[str, int]:
    """Role -> joint of a human body.

    Raises:
        MuybridgeError: the skeleton is of something else.
    """
    found = role_map(take)
    if found.body and not found.roles:
        raise MuybridgeError(f"needs a human body, and the skeleton {found.body}", remedy="no_human_body")
    return found.roles


def start_place(thing: Editable) -> FloatArray:
    """(3,) metres: where the body, or the middle of the points, is at the start."""
    if isinstance(thing, Motion):
        return np.asarray(thing.select(slice(0, 1)).joint_positions_world()[0, body_joint(thing)])
    known = np.asarray(np.isfinite(thing.points_world).all(axis=-1))
    first = int(np.argmax(known.any(axis=1)))
    return np.asarray(thing.points_world[first, known[first]].mean(axis=0))
