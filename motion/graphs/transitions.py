"""Transitions of a motion graph: two windows of frames, one blended into the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.alignment import point_cloud
from muybridge.motion.graphs._transition_kernel import align_transitions, transition_peaks
from muybridge.motion.graphs.distances import point_weights
from muybridge.motion.graphs.minima import Minima

# Of the hardest acceleration of each point in the clips: what a transition may have, as points are blended
# differently than joints. It may have a little more than its own two windows.
_CALM, _MORE = 0.95, 1.02
# Points that hardly accelerate in the clips may have this share of what the one does that accelerates hardest, and so
# many metres per second squared in any case.
_SHARE, _GENTLE = 0.3, 3.0


@dataclass(frozen=True, eq=False)
class Transitions:
    """Ways from one moment to another: the window that begins at `leave` is blended into the one at `enter`.

    Attributes:
        leave: (E,) frame, ascending.
        enter: (E,) frame.
        yaw: (E,) radians by which the entered clip is turned about the world's Z axis to lie over the one left.
        shift: (E, 2) metres by which it is then shifted.
        distance: (E,) metres between the windows that are left, root mean square of the points.
    """

    leave: IntArray
    enter: IntArray
    yaw: FloatArray
    shift: FloatArray
    distance: FloatArray

    def __len__(self) -> int:
        return len(self.leave)

    def select(self, which: BoolArray | IndexArray) -> "Transitions":
        """Some of them."""
        return Transitions(self.leave[which], self.enter[which], self.yaw[which], self.shift[which],
                           self.distance[which])  # fmt: skip


def blend_weights(window: int) -> FloatArray:
    """(window,) share of the motion that is left: smooth, one before the window and zero behind it.

    Source: Kovar, Gleicher and Pighin 2002, section 3.2.
    """
    s = (np.arange(window) + 1) / (window + 1)
    return np.asarray(2 * s**3 - 3 * s**2 + 1)


def candidates(clips: Sequence[Motion], minima: Minima, window: int) -> tuple[Transitions, int]:
    """The transitions of minima, in both directions, but for the rough ones.

    Args:
        clips: of one skeleton, one behind the other.
        minima: of the distances between their windows.
        window: frames.

    Returns:
        Transitions, and how many were left out because a joint would accelerate harder in them than it does anywhere
        in the clips.
    """
    leave = np.concatenate([minima.first, minima.second])
    enter = np.concatenate([minima.second, minima.first])
    order = np.lexsort((enter, leave))
    leave, enter, distance = leave[order], enter[order], np.concatenate([minima.distance, minima.distance])[order]
    weights = point_weights(clips[0].skeleton)
    used = np.flatnonzero(weights)
    clouds = [point_cloud(c)[:, used] for c in clips]
    bends = np.concatenate([_bends(c) for c in clouds])
    limits = bends.max(axis=0).astype(np.float64)
    limits = np.maximum(limits, max(_SHARE * limits.max(), _GENTLE / clips[0].fps ** 2))
    cloud = np.concatenate([c.astype(np.float32) for c in clouds])
    del clouds
    yaw, shift = align_transitions(cloud, weights[used], leave, enter, window)
    peaks = transition_peaks(cloud, bends, leave, enter, yaw, shift, blend_weights(window), _CALM * limits)
    calm = peaks <= _MORE
    return Transitions(leave, enter, yaw, shift, distance).select(calm), int((~calm).sum())


def _bends(cloud: FloatArray) -> Float32Array:
    """(T, N) metres per frame squared: the acceleration of each point."""
    out = np.zeros(cloud.shape[:2], np.float32)
    out[1:-1] = np.linalg.norm(np.diff(cloud, n=2, axis=0), axis=2)
    return out
