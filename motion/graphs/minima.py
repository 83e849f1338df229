"""Local minima of the distances between all pairs of windows, in blocks: memory grows with the frames alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.graphs._minima_kernel import collect_minima
from muybridge.motion.graphs.distances import WindowFeatures, distance_block

_BLOCK = 1024


@dataclass(frozen=True, eq=False)
class Minima:
    """Pairs of windows where the distance is locally least.

    Attributes:
        first: (E,) frame at which the earlier window begins.
        second: (E,) and the later one.
        distance: (E,) metres, root mean square of the points.
    """

    first: IntArray
    second: IntArray
    distance: FloatArray

    def __len__(self) -> int:
        return len(self.first)


def find_minima(
    features: WindowFeatures, radius: int, least_gap: int, most: int = 8,
    advance: Callable[[int], object] | None = None,
) -> Minima:  # fmt: skip
    """The local minima, at most some for each frame: the least ones within its clip, and to other clips.

    Args:
        features: of all windows.
        radius: frames around a minimum in which nothing is less.
        least_gap: frames between the two windows of one clip.
        most: kept for each frame, of either kind.
        advance: called with 1 when a block is done, of `blocks_of`.
    """
    frames = len(features)
    best = np.full((2, frames, most), np.inf, np.float32)
    others = np.full((2, frames, most), -1, np.int64)
    for top in range(0, frames, _BLOCK):
        for left in range(top, frames, _BLOCK):
            rows, above, below = _with_margin(top, frames, radius)
            columns, before, behind = _with_margin(left, frames, radius)
            block = distance_block(features, rows, columns)
            collect_minima(block, rows.start, columns.start, (above, below, before, behind), radius, least_gap,
                           features.clip, best, others)  # fmt: skip
            if advance is not None:
                advance(1)
    kept = others >= 0
    own = np.broadcast_to(np.arange(frames)[None, :, None], others.shape)[kept]
    ends = np.sort(np.stack([own, others[kept]]), axis=0)
    (first, second), at = np.unique(ends, axis=1, return_index=True)
    return Minima(first, second, np.sqrt(best[kept][at].astype(np.float64)))


def blocks_of(frames: int) -> int:
    """How many blocks `find_minima` goes through."""
    side = -(-frames // _BLOCK)
    return side * (side + 1) // 2


def _with_margin(start: int, frames: int, radius: int) -> tuple[slice, int, int]:
    """Frames of a block with its neighbours, and how many of these are before and behind it."""
    stop = min(start + _BLOCK, frames)
    before, behind = min(radius, start), min(radius, frames - stop)
    return slice(start - before, stop + behind), before, behind
