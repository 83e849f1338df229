"""Twins told apart: a network says of each landmark alone where it is, and so names one hand twice where it cannot tell
which of two it is, or sees one better than the other. Two in one place are rarer than that."""

import numpy as np
from numpy.typing import NDArray

# Twins whose likeliest cells are no more than so many apart, along either axis, are in one place.
_ONE_PLACE = 3
# Half the side of the square of cells whose probability is a place's.
_AROUND = 2
# The one to which another place is the likelier goes there, if that is at most so many nats less likely to it.
_LESS_LIKELY = 0.8
# Of what has less of its probability in one place, as where it is outside of the picture, the second is anywhere.
_KNOWN = 0.25


def told_apart(
    probability: NDArray[np.float32], total: NDArray[np.float64], best: NDArray[np.intp], crops: NDArray[np.intp],
    twins: NDArray[np.intp],
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """Of twins in one place one goes to its second likeliest place where that is nearly as likely.

    Args:
        probability: (N, J, h, w), of any scale.
        total: (N, J) sums over the cells.
        best: (N, J) likeliest cells, counted along the rows.
        crops: which of the N are looked at.
        twins: (J,) each landmark's counterpart on the other side; its own index where it has none.

    Returns:
        landmarks that go, as indices of N x J, and the cells that they go to.
    """
    left = np.flatnonzero(np.arange(len(twins)) < twins)
    v, u = np.divmod(best, probability.shape[3])
    apart = np.maximum(*(np.abs(at[:, left] - at[:, twins[left]]) for at in (v[crops], u[crops])))
    place, pair = np.nonzero(apart <= _ONE_PLACE)
    crop, mark = np.tile(crops[place], 2), np.concatenate([left[pair], twins[left[pair]]])
    first = _mass_round(probability, crop, mark, v[crop, mark], u[crop, mark])
    # What is left to another place cannot be enough where the first has too much.
    share = first / total[crop, mark]
    open_ = np.flatnonzero((share > _KNOWN) & (share < 1 / (1 + np.exp(-_LESS_LIKELY))))
    less, cell = np.full(len(crop), np.inf), best[crop, mark]
    less[open_], cell[open_] = _second(probability[crop[open_], mark[open_]], first[open_], cell[open_])
    # Of each pair, one after the other in the two halves, the one that minds least.
    halves = less.reshape(2, -1)
    mover = np.arange(halves.shape[1]) + halves.shape[1] * halves.argmin(axis=0)
    mover = mover[less[mover] < _LESS_LIKELY]
    return crop[mover] * best.shape[1] + mark[mover], cell[mover]


def _mass_round(
    probability: NDArray[np.float32], crop: NDArray[np.intp], mark: NDArray[np.intp], v: NDArray[np.intp],
    u: NDArray[np.intp],
) -> NDArray[np.float64]:  # fmt: skip
    """(K,) sums of maps round cells."""
    height, width = probability.shape[2:]
    around = np.arange(-_AROUND, _AROUND + 1)
    rows, columns = v[:, None] + around, u[:, None] + around
    inside = ((rows >= 0) & (rows < height))[:, :, None] & ((columns >= 0) & (columns < width))[:, None]
    rows, columns = rows.clip(0, height - 1), columns.clip(0, width - 1)
    patch = probability[crop[:, None, None], mark[:, None, None], rows[:, :, None], columns[:, None]]
    return np.asarray((patch * inside).sum(axis=(1, 2)), dtype=np.float64)


def _second(
    maps: NDArray[np.float32], first: NDArray[np.float64], best: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """By how many nats the likeliest place of maps (K, h, w) away from the cells `best` (K,) is less likely than the
    place round these, whose mass is `first` (K,), infinitely where a map is not finite; and its likeliest cell (K,)."""
    height, width = maps.shape[1:]
    rows, (v, u) = np.arange(len(maps)), np.divmod(best, width)
    near = (np.abs(np.arange(height) - v[:, None]) <= _ONE_PLACE)[:, :, None]
    away = np.where(near & (np.abs(np.arange(width) - u[:, None]) <= _ONE_PLACE)[:, None, :], 0, maps)
    wide = np.pad(away, ((0, 0), (_AROUND, _AROUND), (_AROUND, _AROUND)))
    side = np.arange(2 * _AROUND + 1)
    lines = np.sum([wide[:, k : k + height] for k in side], axis=0)
    place = np.sum([lines[:, :, k : k + width] for k in side], axis=0).reshape(-1, height * width)
    middle = place.argmax(axis=1)
    v, u = np.divmod(middle, width)
    # Of the cells of that place the likeliest.
    patch = wide[rows[:, None, None], (v[:, None] + side)[:, :, None], (u[:, None] + side)[:, None]]
    dv, du = np.divmod(patch.reshape(len(maps), side.size**2).argmax(axis=1), side.size)
    cell = (v + dv - _AROUND) * width + u + du - _AROUND
    with np.errstate(divide="ignore", invalid="ignore"):
        less = np.log(first / place[rows, middle])
    return np.nan_to_num(less, nan=np.inf, posinf=np.inf), cell
