"""Another frame rate: cubic interpolation that passes through every frame, of rotations in their tangent space."""

from dataclasses import replace
from typing import cast

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    left_jacobian_so3,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
)
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import T, check_editable, frame_count, per_channel

_MOST_FPS = 10_000.0
_SAME_TIME = 1e-6  # frames


def check_resampled(fps: float | None) -> None:
    """MuybridgeError unless a clip can be resampled to that many frames per second; None is always possible."""
    if fps is not None and not 0 < fps <= _MOST_FPS:
        raise MuybridgeError(f"frames per second must be above 0 and at most {_MOST_FPS:,.0f}, not {fps:g}")


def resample(thing: T, fps: float) -> T:
    """The same clip with another number of frames per second; frames at the same times stay exactly as they are.

    Args:
        thing: a motion or points; points are missing between two frames of which one is missing.
        fps: frames per second; movement faster than half of it is not filtered out.

    Raises:
        MuybridgeError: the frame rate is not above zero and at most 10,000, or the clip is empty.
    """
    check_editable(thing)
    check_resampled(fps)
    count = frame_count(thing)
    new = int(np.floor((count - 1) / thing.fps * fps + _SAME_TIME)) + 1
    at: FloatArray = np.arange(new, dtype=np.float64) * thing.fps / fps
    if isinstance(thing, Motion):
        return cast(T, replace(motion_at(thing, at), fps=fps))  # type: ignore[redundant-cast]
    before, share = _places(at, count)
    return _points(thing, fps, before, share)


def motion_at(motion: Motion, at: FloatArray) -> Motion:
    """A motion at times between its frames, whose velocity is continuous; at a frame it is exactly that frame.

    Args:
        motion: of at least one frame.
        at: (N,) in frames; others than from 0 to the last one are those of its ends.
    """
    before, share = _places(np.clip(at, 0, len(motion) - 1), len(motion))
    return per_channel(motion, lambda x: _cubic(x, before, share), lambda q: _cubic_rotations(q, before, share))


def _places(at: FloatArray, count: int) -> tuple[IndexArray, FloatArray]:
    """The frames before times in frames, and how much of the way to the next one has passed."""
    at = np.where(np.abs(at - np.round(at)) < _SAME_TIME, np.round(at), at)
    before = np.clip(at.astype(np.intp), 0, count - 1)
    return before, np.asarray(at - before, dtype=np.float64)


def _points(points: Points3D, fps: float, before: IndexArray, share: FloatArray) -> Points3D:
    after = np.minimum(before + 1, len(points.points_world) - 1)
    nearest = np.where(share < 0.5, before, after)
    weight = share[:, None, None, None]
    between = (1 - weight) * points.covariance_world[before] + weight * points.covariance_world[after]
    return replace(
        points,
        points_world=_cubic(points.points_world, before, share),
        covariance_world=np.where(weight == 0, points.covariance_world[before], between),
        residual_px=points.residual_px[:, nearest],
        inlier=points.inlier[:, nearest],
        fps=fps,
    )


def _weights(share: FloatArray, ndim: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Hermite's weights of the tangent before, the value after and the tangent after."""
    s = share.reshape(-1, *[1] * (ndim - 1))
    return s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)


def _tangents(steps: FloatArray) -> FloatArray:
    """(T, ...) per frame: the mean of the steps (T - 1, ...) before and after; at gaps and ends the one known."""
    none = np.full((1, *steps.shape[1:]), np.nan)
    left, right = np.concatenate([none, steps]), np.concatenate([steps, none])
    mean = 0.5 * (left + right)
    return np.where(np.isfinite(mean), mean, np.where(np.isfinite(left), left, right))


def _cubic(values: FloatArray, before: IndexArray, share: FloatArray) -> FloatArray:
    """(T, ...) values between frames (Catmull and Rom 1974)."""
    if len(values) == 1:
        return values[before]
    slopes, after = _tangents(np.diff(values, axis=0)), np.minimum(before + 1, len(values) - 1)
    a, b, c = _weights(share, values.ndim)
    start = values[before]
    between = start + a * slopes[before] + b * (values[after] - start) + c * slopes[after]
    return np.where(share.reshape(-1, *[1] * (values.ndim - 1)) == 0, start, between)


def _cubic_rotations(quat: FloatArray, before: IndexArray, share: FloatArray) -> FloatArray:
    """(T, J, 4) rotations between frames: a cubic of the rotation vector from the frame before, whose angular
    velocity is continuous."""
    if len(quat) == 1:
        return quat[before]
    steps = rotvec_from_quat(multiply_quat(conjugate_quat(quat[:-1]), quat[1:]))
    rates, after = _tangents(steps), np.minimum(before + 1, len(quat) - 1)
    way = steps[np.minimum(before, len(steps) - 1)]
    # The vector's own rate at the next frame is its angular velocity there through the inverse right Jacobian.
    last = np.linalg.solve(left_jacobian_so3(-way), rates[after][..., None])[..., 0]
    a, b, c = _weights(share, 3)
    between = multiply_quat(quat[before], quat_from_rotvec(a * rates[before] + b * way + c * last))
    return continuous_quat(np.where(share[:, None, None] == 0, quat[before], between))
