"""Resolve left-right ambiguity: two twins in one place.

The network locates each landmark by itself, so it may give one hand both names if it cannot tell which it is, or if it
sees one better than the other. Two hands in one place are rarer than that.
"""

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.models.keypoints.patches import patches

# Twins are in one place if their likeliest cells are at most this many apart along either axis.
_ONE_PLACE = 3
# Half the side of the square of cells whose probability is that of a place.
_AROUND = 2
# The twin that loses less by moving moves, if it loses at most this many nats.
_LESS_LIKELY = 0.8
# If the best place has less of the probability, as for landmarks outside the image, the second could be anywhere.
_KNOWN = 0.25


def disambiguate_left_right(
    maps: Float32Array, total: FloatArray, best: IndexArray, crops: IndexArray,
    twins: IndexArray,
) -> tuple[IndexArray, IndexArray]:  # fmt: skip
    """Move one of two twins in one place to its second likeliest place, if that is nearly as likely.

    Args:
        maps: (N J, h, w) probabilities of any scale, crop by crop.
        total: (N J,) their sums.
        best: (N J,) flat index of their likeliest cells.
        crops: indices of the crops to check.
        twins: (J,) index of each landmark's counterpart on the other side; its own index if it has none.

    Returns:
        Indices of the maps whose landmark moves, and the cells that they move to.
    """
    left = np.flatnonzero(np.arange(len(twins)) < twins)
    one, other = ((crops[:, None] * len(twins) + marks).ravel() for marks in (left, twins[left]))
    v, u = np.divmod(best, maps.shape[2])
    together = np.maximum(*(np.abs(at[one] - at[other]) for at in (v, u))) <= _ONE_PLACE
    pairs = np.concatenate([one[together], other[together]])
    first = patches(maps, pairs, best[pairs], _AROUND).sum(axis=(1, 2)).astype(np.float64)
    # If the best place has too much of the probability, the rest cannot suffice for another one.
    share = first / total[pairs]
    open_ = np.flatnonzero((share > _KNOWN) & (share < 1 / (1 + np.exp(-_LESS_LIKELY))))
    less, cell = np.full(len(pairs), np.inf), best[pairs]
    less[open_], cell[open_] = _second_place(maps[pairs[open_]], first[open_], cell[open_])
    # Of each pair (first half, second half) the one that loses less.
    halves = less.reshape(2, -1)
    mover = np.arange(halves.shape[1]) + halves.shape[1] * halves.argmin(axis=0)
    mover = mover[less[mover] < _LESS_LIKELY]
    return pairs[mover], cell[mover]


def _second_place(maps: Float32Array, first: FloatArray, best: IndexArray) -> tuple[FloatArray, IndexArray]:
    """The likeliest place away from the best one.

    Args:
        maps: (K, h, w).
        first: (K,) mass of the best place.
        best: (K,) its cell.

    Returns:
        (K,) how many nats less likely it is than the best one, infinite if a map is not finite; and (K,) its likeliest
        cell.
    """
    height, width = maps.shape[1:]
    rows, (v, u) = np.arange(len(maps)), np.divmod(best, width)
    near = (np.abs(np.arange(height) - v[:, None]) <= _ONE_PLACE)[:, :, None]
    away = np.where(near & (np.abs(np.arange(width) - u[:, None]) <= _ONE_PLACE)[:, None, :], 0, maps)
    wide = np.pad(away, ((0, 0), (_AROUND, _AROUND), (_AROUND, _AROUND)))
    side = 2 * _AROUND + 1
    lines = np.sum([wide[:, k : k + height] for k in range(side)], axis=0)
    place = np.sum([lines[:, :, k : k + width] for k in range(side)], axis=0).reshape(-1, height * width)
    middle = place.argmax(axis=1)
    # The likeliest cell of that place.
    inner = patches(away, rows, middle, _AROUND).reshape(len(maps), side**2).argmax(axis=1)
    cell = middle + (inner // side - _AROUND) * width + inner % side - _AROUND
    with np.errstate(divide="ignore", invalid="ignore"):
        less = np.log(first / place[rows, middle])
    return np.nan_to_num(less, nan=np.inf, posinf=np.inf), cell
