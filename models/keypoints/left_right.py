"""Twins told apart: a network says of each landmark alone where it is, and so names one hand twice where it cannot tell
which of two it is, or sees one better than the other. Two in one place are rarer than that."""

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.models.keypoints.patches import patches

# Twins whose likeliest cells are no more than so many apart, along either axis, are in one place.
_ONE_PLACE = 3
# Half the side of the square of cells whose probability is a place's.
_AROUND = 2
# The one to which another place is the likelier goes there, if that is at most so many nats less likely to it.
_LESS_LIKELY = 0.8
# Of what has less of its probability in one place, as where it is outside of the picture, the second is anywhere.
_KNOWN = 0.25


def disambiguate_left_right(
    maps: Float32Array, total: FloatArray, best: IndexArray, crops: IndexArray,
    twins: IndexArray,
) -> tuple[IndexArray, IndexArray]:  # fmt: skip
    """Of twins in one place one goes to its second likeliest place where that is nearly as likely.

    Args:
        maps: (N J, h, w) probabilities of any scale, crop by crop.
        total: (N J,) their sums.
        best: (N J,) their likeliest cells, counted along the rows.
        crops: which of the N are looked at.
        twins: (J,) each landmark's counterpart on the other side; its own index where it has none.

    Returns:
        maps whose landmark goes, and the cells that they go to.
    """
    left = np.flatnonzero(np.arange(len(twins)) < twins)
    one, other = ((crops[:, None] * len(twins) + marks).ravel() for marks in (left, twins[left]))
    v, u = np.divmod(best, maps.shape[2])
    together = np.maximum(*(np.abs(at[one] - at[other]) for at in (v, u))) <= _ONE_PLACE
    pairs = np.concatenate([one[together], other[together]])
    first = patches(maps, pairs, best[pairs], _AROUND).sum(axis=(1, 2)).astype(np.float64)
    # What is left to another place cannot be enough where the first has too much.
    share = first / total[pairs]
    open_ = np.flatnonzero((share > _KNOWN) & (share < 1 / (1 + np.exp(-_LESS_LIKELY))))
    less, cell = np.full(len(pairs), np.inf), best[pairs]
    less[open_], cell[open_] = _second(maps[pairs[open_]], first[open_], cell[open_])
    # Of each pair, one after the other in the two halves, the one that minds least.
    halves = less.reshape(2, -1)
    mover = np.arange(halves.shape[1]) + halves.shape[1] * halves.argmin(axis=0)
    mover = mover[less[mover] < _LESS_LIKELY]
    return pairs[mover], cell[mover]


def _second(maps: Float32Array, first: FloatArray, best: IndexArray) -> tuple[FloatArray, IndexArray]:
    """By how many nats the likeliest place of maps (K, h, w) away from the cells `best` (K,) is less likely than the
    place round these, whose mass is `first` (K,), infinitely where a map is not finite; and its likeliest cell (K,)."""
    height, width = maps.shape[1:]
    rows, (v, u) = np.arange(len(maps)), np.divmod(best, width)
    near = (np.abs(np.arange(height) - v[:, None]) <= _ONE_PLACE)[:, :, None]
    away = np.where(near & (np.abs(np.arange(width) - u[:, None]) <= _ONE_PLACE)[:, None, :], 0, maps)
    wide = np.pad(away, ((0, 0), (_AROUND, _AROUND), (_AROUND, _AROUND)))
    side = 2 * _AROUND + 1
    lines = np.sum([wide[:, k : k + height] for k in range(side)], axis=0)
    place = np.sum([lines[:, :, k : k + width] for k in range(side)], axis=0).reshape(-1, height * width)
    middle = place.argmax(axis=1)
    # Of the cells of that place the likeliest.
    inner = patches(away, rows, middle, _AROUND).reshape(len(maps), side**2).argmax(axis=1)
    cell = middle + (inner // side - _AROUND) * width + inner % side - _AROUND
    with np.errstate(divide="ignore", invalid="ignore"):
        less = np.log(first / place[rows, middle])
    return np.nan_to_num(less, nan=np.inf, posinf=np.inf), cell
