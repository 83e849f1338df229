"""How far apart windows of frames are: clouds of points over a window, laid over each other on the ground.

Kovar, Gleicher and Pighin 2002, "Motion Graphs", section 3.1. What is left after the best turn about the vertical and
shift over the floor is known in closed form (`muybridge.motion.blending.planar_alignment`): the sizes of both clouds,
less twice the length of (along, across), two inner products. So a whole matrix is products of two small matrices, and
sums along its diagonals.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IntArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.blending.alignment import point_cloud
from muybridge.motion.graphs._minima_kernel import window_distances

_LEAST_WEIGHT = 0.1  # of the mean: points that count less, such as fingers', are left out
_BLOCK = 1024  # frames: the sums of a block fit into the processor's cache, and single precision suffices


@dataclass(frozen=True, eq=False)
class WindowFeatures:
    """What distances of windows are computed from. A window is known by its first frame.

    Attributes:
        window: frames.
        along: (F, 2N) weighted places of the points over the floor, from the frame's centroid.
        across: (F, 2N) the same turned by a quarter.
        heights: (F, N) weighted.
        swing: (F, 2 window) of the centroid, from its mean over the window.
        swing_across: (F, 2 window) turned by a quarter.
        sizes: (F,) metres squared, of the window's cloud.
        valid: (F,) whether the window lies in one clip.
        clip: (F,) number of the clip.
    """

    window: int
    along: Float32Array
    across: Float32Array
    heights: Float32Array
    swing: Float32Array
    swing_across: Float32Array
    sizes: Float32Array
    valid: BoolArray
    clip: IntArray

    def __len__(self) -> int:
        return len(self.sizes)


def point_weights(skeleton: Skeleton) -> FloatArray:
    """(N,) of the points of `point_cloud`, their sum one: the length of the bone that ends there.

    Fingers and other small parts count little, however many joints they have; a root counts as a bone of mean length.
    """
    tips = [j for j in range(len(skeleton)) if np.isfinite(skeleton.tips[j]).all() and skeleton.tips[j].any()]
    lengths = np.concatenate([np.linalg.norm(skeleton.offsets, axis=1), np.linalg.norm(skeleton.tips[tips], axis=1)])
    roots = list(skeleton.roots)
    bones = np.delete(lengths, roots)
    lengths[roots] = bones.mean() if len(bones) and bones.sum() > 0 else 1.0
    lengths[lengths < _LEAST_WEIGHT * lengths.mean()] = 0.0
    return np.asarray(lengths / lengths.sum())


def window_features(clips: Sequence[Motion], window: int) -> WindowFeatures:
    """What distances are computed from.

    Args:
        clips: of one skeleton.
        window: frames.
    """
    weights = point_weights(clips[0].skeleton)
    used = np.flatnonzero(weights)
    root = np.sqrt(weights[used])[:, None]
    middle = np.mean([point_cloud(c)[:, used, 2].mean(axis=0) for c in clips], axis=0)
    parts = []
    for clip in clips:
        cloud = point_cloud(clip)[:, used]
        centroid = (weights[used][:, None] * cloud[..., :2]).sum(axis=1)
        floor = root * (cloud[..., :2] - centroid[:, None])
        heights = root[:, 0] * (cloud[..., 2] - middle)
        swing = _swing(centroid, window)
        sizes = _running_mean((floor**2).sum(axis=(1, 2)) + (heights**2).sum(axis=1), window) + (swing**2).sum((1, 2))
        valid = np.arange(len(clip)) <= len(clip) - window
        parts.append((_flat(floor), _flat(_quarter(floor)), heights, _flat(swing), _flat(_quarter(swing)), sizes,
                      valid))  # fmt: skip
    numbers = np.repeat(np.arange(len(clips)), [len(c) for c in clips])
    joined = [np.concatenate(p) for p in zip(*parts, strict=True)]
    a, b, c, d, e, f = (np.ascontiguousarray(p, dtype=np.float32) for p in joined[:6])
    return WindowFeatures(window, a, b, c, d, e, f, joined[6].astype(np.bool_), numbers)


def _swing(centroid: FloatArray, window: int) -> FloatArray:
    """(T, window, 2) of the centroid (T, 2) from its mean over the window; zero where no window begins."""
    out = np.zeros((len(centroid), window, 2))
    if len(centroid) >= window:
        ways = np.moveaxis(np.lib.stride_tricks.sliding_window_view(centroid, window, axis=0), -1, 1)
        out[: len(ways)] = (ways - ways.mean(axis=1, keepdims=True)) / np.sqrt(window)
    return out


def _running_mean(values: FloatArray, window: int) -> FloatArray:
    """(T,) mean of the frames from each one on; of fewer at the end, where no window begins."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    stops = np.minimum(np.arange(len(values)) + window, len(values))
    return np.asarray((sums[stops] - sums[:-1]) / window)


def _quarter(floor: FloatArray) -> FloatArray:
    return np.stack([floor[..., 1], -floor[..., 0]], axis=-1)


def _flat(values: FloatArray) -> FloatArray:
    return values.reshape(len(values), -1)


def distance_block(features: WindowFeatures, rows: slice, columns: slice) -> Float32Array:
    """Squared distances of windows: the mean over a window's points of the squared distance that is left.

    Args:
        features: of all windows.
        rows: first frames of windows, from start to stop.
        columns: likewise.

    Returns:
        (R, C) metres squared; infinite for windows that lie in no clip.
    """
    f, more = features, features.window - 1
    a, b = slice(rows.start, rows.stop + more), slice(columns.start, columns.stop + more)
    shape = (rows.stop - rows.start + more, columns.stop - columns.start + more)
    products = np.zeros((3, *shape), np.float32)
    for k, (left, right) in enumerate(((f.along, f.along), (f.across, f.along), (f.heights, f.heights))):
        value = left[a] @ right[b].T
        products[k, : value.shape[0], : value.shape[1]] = value
    swings = np.stack([f.swing[rows] @ f.swing[columns].T, f.swing_across[rows] @ f.swing[columns].T])
    out = np.empty((rows.stop - rows.start, columns.stop - columns.start), np.float32)
    window_distances(products, swings, f.sizes[rows], f.sizes[columns], f.valid[rows], f.valid[columns], f.window, out)
    return out


def lag_distances(features: WindowFeatures, lag: int) -> FloatArray:
    """(L,) metres: how far apart a window and the one `lag` frames later in the same clip are, everywhere."""
    f, out = features, []
    for start in range(0, len(f) - lag, _BLOCK // 4):
        stop = min(start + _BLOCK // 4, len(f) - lag)
        block = distance_block(f, slice(start, stop), slice(start + lag, stop + lag))
        same = f.clip[start:stop] == f.clip[start + lag : stop + lag]
        values = np.diagonal(block)[same]
        out.append(np.sqrt(values[np.isfinite(values)]))
    return np.concatenate(out).astype(np.float64) if out else np.zeros(0)


def sampled_distances(clips: Sequence[Motion], window: int, frames: IntArray) -> FloatArray:
    """Distances between the windows that begin at some frames, as a picture of the matrix needs them.

    Args:
        clips: of one skeleton, one behind the other.
        window: frames.
        frames: (S,) first frames, ascending.

    Returns:
        (S, S) metres; NaN for windows that lie in no clip.
    """
    features, every = window_features(clips, window), np.arange(window)
    at = np.minimum(frames[:, None] + every, len(features) - 1)

    def products(left: Float32Array, right: Float32Array) -> FloatArray:
        a, b = (values[at].reshape(len(frames), -1) for values in (left, right))
        return np.asarray((a @ b.T).astype(np.float64) / window)

    along = products(features.along, features.along) + features.swing[frames] @ features.swing[frames].T
    across = products(features.across, features.along) + features.swing_across[frames] @ features.swing[frames].T
    sizes = features.sizes[frames].astype(np.float64)
    both = np.hypot(along, across) + products(features.heights, features.heights)
    out = np.sqrt(np.maximum(sizes[:, None] + sizes[None] - 2 * both, 0.0))
    lost = ~features.valid[frames]
    out[lost], out[:, lost] = np.nan, np.nan
    return np.asarray(out)
