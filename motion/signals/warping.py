"""Warps of a movement through key poses, with its details kept.

After A. Witkin, Z. Popovic, "Motion warping", 1995: theta'(t) = a(t) theta(t) + b(t), with a and b smooth curves
through what the keys ask for. Angles are rotations here: b is a rotation behind that of the joint, and a scales the
logarithm relative to the joint's running mean.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
)
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.signals.charts import chart_of

Method = Literal["add", "multiply"]
_LEAST_ANGLE = 0.05  # radians from the mean above which an angle can be scaled to another one
_MOST_SCALE = 3.0


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """What a movement shall be in some frames.

    Attributes:
        frames: (K,) ascending.
        quat_wxyz: (K, J, 4) rotations of the joints.
        keyed: (J,) joints that the keys are for; others stay as they are.
        root_positions: (K, 3) metres, of the first root; None leaves it.
        translations: (K, S, 3) metres, of sliding joints that are keyed; None leaves them.
    """

    frames: IndexArray
    quat_wxyz: FloatArray
    keyed: BoolArray
    root_positions: FloatArray | None = None
    translations: FloatArray | None = None


def warp_to_keys(motion: Motion, keys: KeyPoses, method: Method = "add", blend: float = 0.5) -> Motion:
    """The motion bent so that it passes through key poses, smoothly and with its details.

    Args:
        motion: of any skeleton.
        keys: of the same skeleton.
        method: "add" adds a smooth course to the movement, so that swings keep their size; "multiply" makes swings
            larger or smaller by a smooth factor, about each joint's mean, where that leads to the key, and adds what
            is missing.
        blend: seconds before the first and behind the last key over which the change fades.

    Raises:
        MuybridgeError: no keys, a frame that the clip does not have, or frames that do not ascend.
    """
    check_editable(motion)
    _check_frames(keys.frames, len(motion))
    reach = max(blend * motion.fps, 1.0)
    at = np.arange(len(motion), dtype=np.float64)
    joints = np.flatnonzero(keys.keyed)
    quat, wanted = motion.quat_wxyz.copy(), keys.quat_wxyz[:, joints]
    moved = quat[:, joints]
    if method == "multiply":
        moved = _scaled(moved, wanted, keys.frames, reach, at)
    missing = rotvec_from_quat(multiply_quat(conjugate_quat(moved[keys.frames]), wanted))
    change = correction(keys.frames, missing, reach)(at)
    quat[:, joints] = multiply_quat(moved, quat_from_rotvec(change))
    out = replace(motion, quat_wxyz=continuous_quat(quat))
    if keys.root_positions is not None:
        root = motion.root_positions_world
        away = correction(keys.frames, keys.root_positions - root[keys.frames], reach)(at)
        out = replace(out, root_positions_world=root + away)
    if keys.translations is not None and motion.translations is not None:
        mine = keys.keyed[list(motion.skeleton.sliding)][:, None]
        away = (keys.translations - motion.translations[keys.frames]) * mine
        out = replace(out, translations=motion.translations + correction(keys.frames, away, reach)(at))
    return out


def correction(frames: IndexArray, values: FloatArray, reach: float, rest: float = 0.0) -> PchipInterpolator:
    """A course with a continuous slope through values at keys, which fades beside them and never swings over.

    Args:
        frames: (K,) ascending.
        values: (K, ...) at these frames.
        reach: frames beside the first and the last key over which it fades.
        rest: what it is beyond.

    Returns:
        A function of frames.
    """
    around = reach * np.array([-2.0, -1.0, 1.0, 2.0])
    first, last = np.full((2, *values.shape[1:]), rest), np.full((2, *values.shape[1:]), rest)
    knots = np.concatenate([frames[0] + around[:2], frames, frames[-1] + around[2:]])
    # The outermost intervals are flat, and so is the course beyond them, which the interpolator carries on.
    return PchipInterpolator(knots, np.concatenate([first, values, last]), axis=0)


def _scaled(quat: FloatArray, wanted: FloatArray, frames: IndexArray, reach: float, at: FloatArray) -> FloatArray:
    """(T, K, 4) rotations whose angles about the mean are scaled towards those of the keys."""
    chart = chart_of(quat)
    here = chart.vectors[frames]
    there = rotvec_from_quat(multiply_quat(conjugate_quat(chart.mean_wxyz[frames]), wanted))
    able = np.abs(here) > _LEAST_ANGLE
    factor = np.clip(there / np.where(able, here, 1.0), 0.0, _MOST_SCALE)
    factor = np.where(able, factor, 1.0)
    return chart.rotations(chart.vectors * correction(frames, factor, reach, rest=1.0)(at))


def _check_frames(frames: IndexArray, count: int) -> None:
    if not len(frames):
        raise MuybridgeError("there are no keys")
    if len(frames) > 1 and np.diff(frames).min() <= 0:
        k = int(np.argmax(np.diff(frames) <= 0))
        raise MuybridgeError(f"key {k + 2} is not behind key {k + 1}: they fall on the frames {frames[k + 1] + 1} and "
                             f"{frames[k] + 1}")  # fmt: skip
    if frames[0] < 0 or frames[-1] >= count:
        worst = int(frames[-1] if frames[-1] >= count else frames[0])
        raise MuybridgeError(f"a key falls on frame {worst + 1}, and the clip has the frames 1 to {count}")


def key_frames(times: Sequence[float], motion: Motion) -> IndexArray:
    """The frames that are nearest to times in seconds.

    Raises:
        MuybridgeError: a time outside of the clip, or two for one frame.
    """
    frames = np.round(np.asarray(times, dtype=np.float64) * motion.fps).astype(np.intp)
    end = (len(motion) - 1) / motion.fps
    for time, frame in zip(times, frames, strict=True):
        if not 0 <= frame < len(motion):
            raise MuybridgeError(f"the key at {time:g} s is outside of the clip, which ends at {end:.3f} s")
    _check_frames(frames, len(motion))
    return frames


def keys_of_motion(poses: Motion, motion: Motion, times: Sequence[float] = ()) -> KeyPoses:
    """Key poses from a motion of few frames, such as an animator posed and saved.

    Args:
        poses: the key poses; its joints are matched by name, and may be some of the joints only.
        motion: that is to be warped.
        times: seconds of the clip, one for each pose; empty for those of the poses' own frames.

    Raises:
        MuybridgeError: joints that the motion does not have, bones of other lengths or directions, or times that do not
            fit.
    """
    check_editable(poses)
    skeleton, own = motion.skeleton, poses.skeleton
    if lost := [name for name in own.names if name not in skeleton.names]:
        raise MuybridgeError(f"the key poses have a joint {lost[0]!r}, which the motion has not; pose the motion's own "
                             "skeleton")  # fmt: skip
    here = [skeleton.index(name) for name in own.names]
    away = np.linalg.norm(own.offsets - skeleton.offsets[here], axis=1)
    away[0] = 0.0
    size = np.ptp(skeleton.rest_positions, axis=0).max()
    slides = {*skeleton.sliding}
    rigid = np.array([j not in own.sliding and here[j] not in slides for j in range(len(own))])
    if (away * rigid).max() > 0.01 * size:
        j = int(np.argmax(away * rigid))
        raise MuybridgeError(f"the key poses' bone to {own.names[j]!r} differs by {away[j]:.3f} m from the motion's; "
                             "pose the motion's own skeleton")  # fmt: skip
    if times and len(times) != len(poses):
        raise MuybridgeError(f"{len(times)} times are given for {len(poses)} key poses")
    frames = key_frames(times or [k / poses.fps for k in range(len(poses))], motion)
    keyed = np.zeros(len(skeleton), np.bool_)
    keyed[here] = True
    quat = motion.quat_wxyz[frames].copy()
    quat[:, here] = poses.quat_wxyz
    translations = None if motion.translations is None else motion.translations[frames].copy()
    for j, to in enumerate(here):
        if translations is not None and to in slides:  # a single pose has no sliding joints: its bones hold the place
            k = skeleton.sliding.index(to)
            own_slides = poses.translations if j in own.sliding else None
            translations[:, k] = own.offsets[j] if own_slides is None else own_slides[:, own.sliding.index(j)]
    root = poses.root_positions_world if here[0] == 0 else None
    return KeyPoses(frames, quat, keyed, root, translations)
