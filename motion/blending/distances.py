"""How unlike the frames of two motions are, each frame of the one against each of the other.

Kovar, Gleicher and Pighin 2002, "Motion Graphs", section 3.1, for windows of frames as clouds of points. All pairs are
compared at once: what the closed form of the alignment needs of two windows are sums over their pairs of frames, and
these are matrix products.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import multiply_quat, quat_from_rotvec
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.blending.alignment import PlanarTransform, bone_ends
from muybridge.motion.blending.material import facing_frames

_LEAST_WEIGHT = 1e-3  # of the mean: joints that hang on bones without length


def point_weights(skeleton: Skeleton) -> FloatArray:
    """(N,) weights of the points of `point_cloud`, which sum to one: half the length of the bones beside each.

    A hand of twenty short bones so counts about as much as one of a single bone.
    """
    ends = bone_ends(skeleton)
    weights = np.zeros(len(skeleton) + len(ends))
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            weights[[j, parent]] += 0.5 * lengths[j]
    for k, j in enumerate(ends):
        weights[[j, len(skeleton) + k]] += 0.5 * float(np.linalg.norm(skeleton.tips[j]))
    weights = np.maximum(weights, _LEAST_WEIGHT * max(float(weights.mean()), 1e-12))
    return np.asarray(weights / weights.sum())


def window_alignments(
    reference: FloatArray, moved: FloatArray, half: int, weights: FloatArray | None = None
) -> PlanarTransform:
    """Lay the window of frames about each frame of one motion over that about each frame of another.

    Args:
        reference: (T, N, 3) metres, as `point_cloud` makes it.
        moved: (S, N, 3) metres.
        half: frames before and after the middle one; at the ends of a motion a window has those that are there.
        weights: (N,) of the points, which sum to one; None counts all alike.

    Returns:
        (T, S) what takes each window of `moved` to each of `reference`, as `planar_alignment` would. The distance is
        the mean over the frames of a window, metres squared.
    """
    w = np.full(reference.shape[1], 1.0 / reference.shape[1]) if weights is None else weights
    root = np.sqrt(w)
    a, b = (cloud[..., 0] + 1j * cloud[..., 1] for cloud in (reference, moved))
    far_a, far_b = a.mean(), b.mean()  # differences of large squares would cost digits
    a, b = a - far_a, b - far_b
    heights = [cloud[..., 2] for cloud in (reference, moved)]
    one = np.ones((len(a), len(b)))
    means = (a @ w)[:, None] * one, (b @ w)[None] * one
    turn = (a * root) @ (b * root).conj().T
    size = ((np.abs(a) ** 2 + heights[0] ** 2) @ w)[:, None] + ((np.abs(b) ** 2 + heights[1] ** 2) @ w)[None]
    size = size - 2 * (heights[0] * root) @ (heights[1] * root).T
    count, mean_a, mean_b, turn, size = (_summed(x, half) for x in (one, *means, turn, size))
    # The best shift leads one centre to the other; what is left is turned by the phase of the centred products.
    turn = turn - mean_a * mean_b.conj() / count
    size = size - (np.abs(mean_a) ** 2 + np.abs(mean_b) ** 2) / count
    yaw = np.angle(turn)
    shift = (mean_a - np.exp(1j * yaw) * mean_b) / count + far_a - np.exp(1j * yaw) * far_b
    left = np.maximum(size - 2 * np.abs(turn), 0.0) / count
    return PlanarTransform(yaw, np.stack([shift.real, shift.imag], axis=-1), left)


def _summed(values: FloatArray, half: int) -> FloatArray:
    """(T, S) sums along the diagonals, over the pairs up to `half` before and after each that are there."""
    out = values.copy()
    for k in range(1, half + 1):
        out[k:, k:] += values[:-k, :-k]
        out[:-k, :-k] += values[k:, k:]
    return out


def dof_distances(first: Motion, second: Motion) -> FloatArray:
    """(T, S) sum over all degrees of freedom of the squared differences between the frames of two motions.

    Rotations differ by their angle in radians, heights and translations in metres; where a body is on the ground, and
    where it faces, does not count.

    Args:
        first: T frames.
        second: S frames, of the same skeleton.
    """
    total = np.zeros((len(first), len(second)))
    turns, heights = [], []
    for motion in (first, second):
        yaw = facing_frames(motion).yaw
        quat = motion.quat_wxyz.copy()
        back = quat_from_rotvec(-yaw[:, None] * np.array([0.0, 0.0, 1.0]))
        roots = list(motion.skeleton.roots)
        quat[:, roots] = multiply_quat(back[:, None], quat[:, roots])
        turns.append(quat)
        heights.append(motion.root_positions_world[:, 2])
    for j in range(len(first.skeleton)):
        cosine = np.minimum(np.abs(turns[0][:, j] @ turns[1][:, j].T), 1.0)
        total += (2 * np.arccos(cosine)) ** 2
    total += (heights[0][:, None] - heights[1][None]) ** 2
    if first.translations is not None and second.translations is not None:
        inner = [k for k, j in enumerate(first.skeleton.sliding) if first.skeleton.parents[j] >= 0]
        for k in inner:
            gaps = first.translations[:, None, k] - second.translations[None, :, k]
            total += (gaps**2).sum(axis=-1)
    return total
