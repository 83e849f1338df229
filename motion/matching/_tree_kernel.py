"""The search by a tree of boxes, compiled.

Boxes and frames lie in memory as runs of 16 a feature, so that the processor compares 16 at a time while each sum
still adds its features in one order. A sum of rounded terms in a fixed order never falls when a term grows, so the
distance to a box, as computed, is never above the distance, as computed, to a frame in it: skipping boxes loses
nothing.
"""

import numpy as np

from muybridge.arrays import Float32Array, IndexArray
from muybridge.geometry.numerics._numba import compiled

LANES = 16  # frames of a small box, and small boxes of a run
FAN = 4  # small boxes of a large one


@compiled
def box_distances(query: Float32Array, low: Float32Array, high: Float32Array, out: Float32Array) -> None:
    """Squared distances (R, 16) of a query (F,) to boxes (R, F, 16)."""
    for r in range(low.shape[0]):
        for k in range(LANES):
            out[r, k] = 0
        for f in range(query.shape[0]):
            q = query[f]
            for k in range(LANES):
                gap = max(max(low[r, f, k] - q, q - high[r, f, k]), np.float32(0))
                out[r, k] += gap * gap


@compiled
def scan_frames(query: Float32Array, points: Float32Array, sums: Float32Array) -> None:
    """Squared distances (16,) of a query (F,) to frames (F, 16)."""
    for k in range(LANES):
        sums[k] = 0
    for f in range(query.shape[0]):
        q = query[f]
        for k in range(LANES):
            gap = points[f, k] - q
            sums[k] += gap * gap


@compiled
def nearest(
    query: Float32Array, points: Float32Array, frames: IndexArray, low: Float32Array, high: Float32Array,
    far_low: Float32Array, far_high: Float32Array, bound: float, skip_from: int, skip_to: int,
) -> tuple[int, np.float32]:  # fmt: skip
    """The frame that is nearest to a query.

    Args:
        query: (F,) float32.
        points: (B, F, 16) features of the frames of each small box.
        frames: (B, 16) their numbers; -1 where a box has fewer.
        low, high: (B / 16, F, 16) limits of small boxes.
        far_low, far_high: (B / 64 / 16, F, 16) limits of large boxes.
        bound: squared distance that must be undercut.
        skip_from: first frame of those that do not count.
        skip_to: the frame behind the last one of them.

    Returns:
        The frame (-1: none undercuts the bound) and its squared distance (the bound).
    """
    best, at = np.float32(bound), -1
    far = np.empty((far_low.shape[0], LANES), np.float32)
    box_distances(query, far_low, far_high, far)
    distances = far.reshape(-1)
    first = 0
    for k in range(len(distances)):
        if distances[k] < distances[first]:
            first = k
    sums = np.empty(LANES, np.float32)
    large = points.shape[0] // FAN
    for step in range(-1, large):
        # The nearest large box comes first: what it holds lets most others be skipped.
        k = first if step < 0 else step
        if distances[k] >= best or (step == first):
            continue
        for small in range(k * FAN, k * FAN + FAN):
            run, lane = small // LANES, small % LANES
            total = np.float32(0)
            for f in range(query.shape[0]):
                gap = max(max(low[run, f, lane] - query[f], query[f] - high[run, f, lane]), np.float32(0))
                total += gap * gap
            if total >= best:
                continue
            scan_frames(query, points[small], sums)
            for j in range(LANES):
                frame = frames[small, j]
                if sums[j] < best and frame >= 0 and not skip_from <= frame < skip_to:
                    best, at = sums[j], frame
    return at, best


@compiled
def nearest_of_all(
    query: Float32Array, points: Float32Array, frames: IndexArray, bound: float, skip_from: int, skip_to: int
) -> tuple[int, np.float32]:
    """As `nearest`, by comparing with every frame."""
    best, at = np.float32(bound), -1
    sums = np.empty(LANES, np.float32)
    for small in range(points.shape[0]):
        scan_frames(query, points[small], sums)
        for j in range(LANES):
            frame = frames[small, j]
            if sums[j] < best and frame >= 0 and not skip_from <= frame < skip_to:
                best, at = sums[j], frame
    return at, best
