"""Motions laid over each other on the ground: a turn about the vertical and a shift, in closed form.

Kovar, Gleicher and Pighin 2002, "Motion Graphs", section 3.1: two windows of frames are two clouds of points, and
they are as far apart as the weighted sum of squared distances of their points once one cloud has been turned about
the vertical and shifted over the floor to where that sum is least.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import placed


@dataclass(frozen=True, eq=False)
class PlanarTransform:
    """Turns about the world's Z axis through its origin, each followed by a shift over the floor.

    Attributes:
        yaw: (...) radians, counter-clockwise seen from above.
        shift: (..., 2) metres.
        distance: (...) weighted sum of squared distances that are left, metres squared.
    """

    yaw: FloatArray
    shift: FloatArray
    distance: FloatArray


def bone_ends(skeleton: Skeleton) -> list[int]:
    """The joints whose bones end without a further joint; their tips follow the joints in `point_cloud`."""
    return [j for j in range(len(skeleton)) if np.isfinite(skeleton.tips[j]).all() and skeleton.tips[j].any()]


def point_cloud(motion: Motion) -> FloatArray:
    """(T, N, 3) metres, in the world: all joints, and the ends of the bones that have no further joint."""
    skeleton = motion.skeleton
    world = motion.forward()
    ends = bone_ends(skeleton)
    turns, places = world[..., :3, :3], world[..., :3, 3]
    tips = (turns[:, ends] @ skeleton.tips[ends][..., None])[..., 0] + places[:, ends]
    return np.concatenate([places, tips], axis=1)


def cloud_windows(cloud: FloatArray, frames: int) -> FloatArray:
    """(T - frames + 1, frames N, 3) the points of every window of consecutive frames of a cloud (T, N, 3)."""
    windows = np.lib.stride_tricks.sliding_window_view(cloud, frames, axis=0)  # (W, N, 3, frames)
    return np.ascontiguousarray(np.moveaxis(windows, -1, 1)).reshape(len(windows), -1, 3)


def planar_alignment(reference: FloatArray, moved: FloatArray, weights: FloatArray | None = None) -> PlanarTransform:
    """Lay clouds of points over others, as well as a turn about the vertical and a shift over the floor can.

    Args:
        reference: (..., N, 3) metres.
        moved: (..., N, 3) metres; broadcast against the reference.
        weights: (..., N) of the points, not negative; None counts all alike, and they sum to one.

    Returns:
        What takes `moved` to `reference`: the yaw is zero where points say nothing of it.
    """
    count = reference.shape[-2]
    w = np.full(count, 1.0 / count) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w[..., None]
    total = w.sum(axis=-2)
    means = [(w * x[..., :2]).sum(axis=-2) / total for x in (reference, moved)]
    a, b = reference[..., :2] - means[0][..., None, :], moved[..., :2] - means[1][..., None, :]
    along = (w[..., 0] * (a * b).sum(axis=-1)).sum(axis=-1)
    across = (w[..., 0] * (b[..., 0] * a[..., 1] - b[..., 1] * a[..., 0])).sum(axis=-1)
    yaw = np.arctan2(across, along)
    turned = _turned(means[1], yaw)
    size = (w[..., 0] * ((a**2).sum(axis=-1) + (b**2).sum(axis=-1))).sum(axis=-1)
    heights = (w[..., 0] * (reference[..., 2] - moved[..., 2]) ** 2).sum(axis=-1)
    left = np.maximum(size - 2 * np.hypot(along, across), 0.0) + heights
    return PlanarTransform(np.asarray(yaw), np.asarray(means[0] - turned), np.asarray(left))


def _turned(points: FloatArray, yaw: FloatArray) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([c * points[..., 0] - s * points[..., 1], s * points[..., 0] + c * points[..., 1]], axis=-1)


def place_at(motion: Motion, yaw: float, shift: FloatArray) -> Motion:
    """The whole motion turned by `yaw` radians about the world's Z axis, then shifted by `shift` (2,) metres."""
    return placed(motion, float(yaw), np.append(shift, 0.0))
