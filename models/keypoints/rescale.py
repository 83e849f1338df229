"""People of whom a part is seen: it fills the crop, larger than a network knows people best, and so it is shown to it
smaller."""

from collections.abc import Callable
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.models.keypoints.decode import in_part, there
from muybridge.models.keypoints.metadata import crop_side

Maps = list[Float32Array]
Value = TypeVar("Value", np.uint8, np.float32)
Look = Callable[[NDArray[Value]], Maps]

# Sides of crops over that at which the network is best: of those of a first look, and of people of whom least is seen.
FIRST_LOOK, LEAST = 3 / 4, 5 / 8
# Of whom at most this share of the landmarks is found is shown at this share of a crop's side; measured on held-out
# close-ups and people cut off.
_SIDES = ((0.5, LEAST), (0.85, 3 / 4), (0.99, 7 / 8))


def reading_sides(score: FloatArray, side: int, best: int) -> IntArray:
    """(N,) side in px at which crops of `side` px are read best by a network that is best at `best` px, by the scores
    (N, J) of their landmarks."""
    count, most = there(score), score.shape[1]
    sides = np.full(len(score), side, dtype=np.int64)
    for share, smaller in reversed(_SIDES):
        sides[count <= share * most] = crop_side(best * smaller)
    return np.where(in_part(score, 1.0), np.minimum(sides, side), side)


def at_side(look: Look[Value], side: int, rows: int) -> Look[Value]:
    """A `look` at crops made smaller, whose maps are as large as if they had not been.

    Args:
        look: runs the network: crops to maps, of which those with four axes are (N, J, h, w) logits.
        side: of the crops that it is to see, px.
        rows: axis of the crops' rows of pixels, before that of the columns.
    """

    def smaller(crops: NDArray[Value]) -> Maps:
        size = crops.shape[rows]
        if side == size:
            return look(crops)
        shrunk = redrawn(crops, rows, lambda p: cv2.resize(p, (side, side), interpolation=cv2.INTER_AREA))
        maps = look(shrunk)
        return [_enlarged(m, m.shape[-1] * size // side) if m.ndim == 4 else m for m in maps]

    return smaller


def redrawn(crops: NDArray[Value], rows: int, draw: Callable[[NDArray[Value]], NDArray[Any]]) -> NDArray[Value]:
    """Crops each drawn anew.

    Args:
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        rows: 1 or 2.
        draw: (h, w, C) to pictures of as many channels, all of one size.
    """
    pictures = np.ascontiguousarray(crops if rows == 1 else crops.transpose(0, 2, 3, 1))
    drawn = np.stack([draw(p) for p in pictures])
    drawn = drawn.reshape(*drawn.shape[:3], -1)  # of one channel OpenCV drops the axis
    return np.ascontiguousarray(drawn if rows == 1 else drawn.transpose(0, 3, 1, 2)).astype(crops.dtype, copy=False)


def _enlarged(maps: Float32Array, cells: int) -> Float32Array:
    """Maps (N, J, h, h) with `cells` cells a side: linear between their middles, the nearest beyond the outermost."""
    have = maps.shape[-1]
    at = np.clip((np.arange(cells) + 0.5) * have / cells - 0.5, 0, have - 1)
    weights = np.maximum(0, 1 - np.abs(at[:, None] - np.arange(have))).astype(np.float32)
    return np.asarray(weights @ maps @ weights.T, dtype=np.float32)
