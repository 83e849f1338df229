"""The nearest frame by a tree of boxes: bounding boxes of 16 and of 64 consecutive frames.

Consecutive frames are alike, so their boxes are small, and a box that is farther away than the best frame so far is
skipped with all its frames. Nothing needs to be sorted, split or balanced.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.motion.matching._tree_kernel import FAN, LANES, nearest, nearest_of_all

_FAR = np.float32(np.inf)


@dataclass(frozen=True, eq=False)
class BoxTree:
    """Frames by their scaled features, in boxes of two sizes.

    Attributes:
        points: (B, F, 16) float32, features of the frames of each small box; infinite where it has fewer.
        frames: (B, 16) their numbers; -1 where the box has fewer.
        low, high: (B / 16, F, 16) limits of the small boxes.
        far_low, far_high: (R, F, 16) limits of the large boxes.
    """

    points: Float32Array
    frames: IndexArray
    low: Float32Array
    high: Float32Array
    far_low: Float32Array
    far_high: Float32Array

    @classmethod
    def build(cls, scaled: Float32Array, searchable: BoolArray) -> "BoxTree":
        """Put frames into boxes.

        Args:
            scaled: (N, F) features of all frames.
            searchable: (N,) which may be found. A box holds frames of one run of these.

        Raises:
            ValueError: no frame is searchable.
        """
        if not searchable.any():
            raise ValueError("no frame is searchable")
        frames = _boxed(searchable)
        there = frames >= 0
        values = np.asarray(scaled, dtype=np.float32)[np.maximum(frames, 0)]  # (B, 16, F)
        low = np.where(there[..., None], values, _FAR).min(axis=1)
        high = np.where(there[..., None], values, -_FAR).max(axis=1)
        far_low, far_high = (
            low.reshape(-1, FAN, low.shape[1]).min(axis=1),
            high.reshape(-1, FAN, low.shape[1]).max(axis=1),
        )
        points = np.where(there[..., None], values, _FAR)
        return cls(np.ascontiguousarray(points.transpose(0, 2, 1)), frames, *_lanes(low, high),
                   *_lanes(far_low, far_high))  # fmt: skip

    def __len__(self) -> int:
        return int((self.frames >= 0).sum())

    def search(
        self, query: FloatArray | Float32Array, bound: float = np.inf, skip: tuple[int, int] = (0, 0)
    ) -> tuple[int | None, float]:
        """The frame nearest to a query.

        Args:
            query: (F,) scaled features.
            bound: squared distance that a frame must undercut.
            skip: first frame, and the one behind the last, of those that do not count.

        Returns:
            The frame, None where no frame undercuts the bound, and its squared distance: exactly that which comparing
            with every frame finds.
        """
        at, distance = nearest(_query(query), self.points, self.frames, self.low, self.high, self.far_low,
                               self.far_high, bound, *skip)  # fmt: skip
        return (None if at < 0 else int(at)), float(distance)

    def search_all(
        self, query: FloatArray | Float32Array, bound: float = np.inf, skip: tuple[int, int] = (0, 0)
    ) -> tuple[int | None, float]:
        """As `search`, by comparing with every frame."""
        at, distance = nearest_of_all(_query(query), self.points, self.frames, bound, *skip)
        return (None if at < 0 else int(at)), float(distance)


def _query(query: FloatArray | Float32Array) -> Float32Array:
    return np.ascontiguousarray(query, dtype=np.float32)


def _boxed(searchable: BoolArray) -> IndexArray:
    """(B, 16) the numbers of searchable frames, each run of them from a new box on; B is a multiple of 64."""
    edges = np.flatnonzero(np.diff(searchable.astype(np.int8), prepend=0, append=0))
    rows = []
    for first, behind in zip(edges[::2], edges[1::2], strict=True):
        count = -(-(behind - first) // LANES) * LANES
        run = np.arange(first, first + count)
        rows.append(np.where(run < behind, run, -1).reshape(-1, LANES))
    boxes = np.concatenate(rows)
    missing = -len(boxes) % (FAN * LANES)
    return np.concatenate([boxes, np.full((missing, LANES), -1)]).astype(np.int64)


def _lanes(low: Float32Array, high: Float32Array) -> tuple[Float32Array, Float32Array]:
    """(B / 16, F, 16) of limits (B, F): 16 boxes beside each other."""
    low, high = (np.ascontiguousarray(v.reshape(-1, LANES, v.shape[1]).transpose(0, 2, 1)) for v in (low, high))
    return low, high
