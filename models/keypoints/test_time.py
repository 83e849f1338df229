"""Crops shown to a network again: smaller, turned by quarters, and tilted a little. One that knows people whole and
upright best finds so who is seen in part, lies or stands on their hands, and what it is still unsure of it sees once
more from either side."""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.models.keypoints.decode import NO_IDEA, DecodedHeatmaps, in_part
from muybridge.models.keypoints.metadata import KeypointModelCard
from muybridge.models.keypoints.rescale import Look, Maps, Value, at_side, reading_sides, redrawn

# A crop of whose landmarks the logarithms of the variances are more than this on average (px^2 of a crop of 192 px) is
# unsure; another orientation counts where they are less by so much. Nobody is turned who is seen in part, at a desk or
# by the picture's border: they are unsure for that and not for lying, and may look like a person any way up.
_UNSURE, _SURER = 2.85, 0.6
# What is more unsure than this is tilted to both sides by so much, and the mean of all three looks counts.
_DOUBTFUL, _TILT = 2.05, np.radians(14.0)


class Series(NamedTuple):
    """Which crops show the same at one moment after another, so that not every one need be tried in every orientation:
    what the detector takes for a person and is none is unsure in all of its frames.

    Attributes:
        number: (N,) of the series; the crops of each are in order of time.
        every: one of so many is tried in every orientation, the others in those that count for their neighbours.
    """

    number: IntArray
    every: int


def test_time_augment(
    look: Look[Value], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    series: Series | None = None, tilt: bool = False,
) -> DecodedHeatmaps:  # fmt: skip
    """Replace what a network says of crops that show a part of somebody by what it says of them made smaller; of unsure
    crops by what it says of them turned by quarters, where it is surer of that; of what is unsure still, by the mean
    with what it says of it tilted.

    Args:
        look: runs the network: crops of any side that is a multiple of 32 to maps.
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        maps: what the network says of them, changed in place: first the landmarks' heatmaps (N, J, h, w), logits, then
            any others of four axes, and arrays of two axes that do not turn.
        card: of the network.
        rows: axis of the crops.
        series: of the crops; each stands for itself if absent.
        tilt: crops too, two looks more at what is unsure.

    Returns:
        the landmarks that the heatmaps then say.
    """
    decoded, size = card.decoded(maps[0]), crops.shape[rows]
    sides = reading_sides(decoded.score, size, card.input_size)
    (small,) = np.nonzero(sides < size)
    for side in np.unique(sides[small]):
        (here,) = np.nonzero(sides == side)
        for out, found in zip(maps, at_side(look, int(side), rows)(crops[here]), strict=True):
            out[here] = found
    _decode_again(decoded, maps, card, small)
    least = _doubt(decoded, size)
    (unsure,) = np.nonzero((least > _UNSURE) & ~in_part(decoded.score))
    quarters = _turn(look, crops, maps, card, rows, least - _SURER, unsure, series)
    (changed,) = np.nonzero(quarters)
    _decode_again(decoded, maps, card, changed)
    if not tilt:
        return decoded
    (doubtful,) = np.nonzero(_doubt(decoded, size, in_part(decoded.score)) > _DOUBTFUL)
    sides[changed] = size
    for side in np.unique(sides[doubtful]):
        here = doubtful[sides[doubtful] == side]
        _tilt(at_side(look, int(side), rows), crops, maps, rows, here, quarters)
    _decode_again(decoded, maps, card, doubtful)
    return decoded


def _decode_again(decoded: DecodedHeatmaps, maps: Maps, card: KeypointModelCard, changed: IndexArray) -> None:
    """Brings the landmarks of some crops up to date with their heatmaps, in place."""
    if len(changed):
        for values, new in zip(decoded, card.decoded(maps[0][changed]), strict=True):
            values[changed] = new


def _turn(
    look: Look[Value], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    least: FloatArray, unsure: IndexArray, series: Series | None,
) -> IntArray:  # fmt: skip
    """Turns the `unsure` crops, see `test_time_augment`; (N,) by how many quarters each is seen best. The doubt of them
    has to be less than `least` (N,), which is changed."""
    quarters = np.zeros(len(crops), dtype=np.int64)

    def attempt(turn: int, tried: IndexArray) -> None:
        if not len(tried):
            return
        turned = look(np.rot90(crops[tried], turn, axes=(rows, rows + 1)))
        doubt = _doubt(card.decoded(turned[0]), crops.shape[rows])
        surer = doubt < least[tried]
        better = tried[surer]
        least[better], quarters[better] = doubt[surer], turn
        for out, found in zip(maps, turned, strict=True):
            back = found[surer]
            out[better] = np.rot90(back, -turn, axes=(2, 3)) if back.ndim == 4 else back

    before, after = _samples(unsure, series)
    sampled = (before == unsure) | (after == unsure)
    for turn in (1, 2, 3):
        attempt(turn, unsure[sampled])
    counts = quarters[before], quarters[after]
    for turn in (1, 2, 3):
        attempt(turn, unsure[~sampled & ((counts[0] == turn) | (counts[1] == turn))])
    return quarters


def _tilt(
    look: Look[Value], crops: NDArray[Value], maps: Maps, rows: int, doubtful: IndexArray,
    quarters: IntArray,
) -> None:  # fmt: skip
    """Makes what a network says of the `doubtful` crops, turned by their `quarters` (N,), the mean of that and of what
    it says of them tilted to either side, in place."""
    upright = np.stack([np.rot90(crops[k], quarters[k], axes=(rows - 1, rows)) for k in doubtful])
    totals = [out[doubtful] for out in maps]
    for angle in (_TILT, -_TILT):
        for total, found in zip(totals, look(_tilted(upright, rows, angle)), strict=True):
            if found.ndim == 2:
                total += found
                continue
            back = _tilted_back(found, angle)
            for k, turn in enumerate(quarters[doubtful]):
                total[k] += np.rot90(back[k], -turn, axes=(1, 2))
    for out, total in zip(maps, totals, strict=True):
        out[doubtful] = total / 3


def _tilted(crops: NDArray[Value], rows: int, angle: float) -> NDArray[Value]:
    """Crops turned about their middle by `angle`, radians, counter-clockwise as one sees them; black beyond."""
    size = crops.shape[rows]
    matrix = cv2.getRotationMatrix2D(((size - 1) / 2, (size - 1) / 2), float(np.degrees(angle)), 1.0)
    return redrawn(crops, rows, lambda p: cv2.warpAffine(p, matrix, (size, size), flags=cv2.INTER_LINEAR))


def _tilted_back(maps: Float32Array, angle: float) -> Float32Array:
    """Heatmaps (N, J, h, h) of crops that were tilted by `angle`, as if they had not been: bilinear, the nearest cell
    beyond the edge."""
    cells, weights = _sampling(maps.shape[-1], angle)
    flat = maps.reshape(*maps.shape[:2], -1)
    out = sum(weight * flat[..., cell] for cell, weight in zip(cells, weights, strict=True))
    return np.asarray(out, dtype=np.float32).reshape(maps.shape)


@lru_cache(maxsize=8)
def _sampling(size: int, angle: float) -> tuple[IndexArray, Float32Array]:
    """(4, size * size) cells of a map tilted by `angle`, and the weight with which each cell of the upright map is made
    of them."""
    middle = (size - 1) / 2
    v, u = np.indices((size, size)) - middle
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = (np.clip(at + middle, 0, size - 1).ravel() for at in (cos * u + sin * v, cos * v - sin * u))
    left, top = (np.minimum(np.floor(at), size - 2).astype(np.intp) for at in (x, y))
    cells = np.stack([(top + dv) * size + left + du for dv in (0, 1) for du in (0, 1)])
    across, down = (np.stack([1 - (at - low), at - low]) for at, low in ((x, left), (y, top)))
    weights = np.stack([down[dv] * across[du] for dv in (0, 1) for du in (0, 1)]).astype(np.float32)
    return cells, weights


def _samples(unsure: IndexArray, series: Series | None) -> tuple[IndexArray, IndexArray]:
    """(n,) and (n,) of the unsure crops' own series those before and after each that are tried in every orientation;
    of one that is, itself is one of them."""
    before, after = unsure.copy(), unsure.copy()
    if series is None:
        return before, after
    number = series.number[unsure]
    for each in np.unique(number):
        (here,) = np.nonzero(number == each)
        place = np.arange(len(here))
        before[here] = unsure[here[place // series.every * series.every]]
        after[here] = unsure[here[np.minimum(-(-place // series.every) * series.every, len(here) - 1)]]
    return before, after


def _doubt(found: DecodedHeatmaps, size: int, partly: BoolArray | None = None) -> FloatArray:
    """(N,) mean logarithm of the variances of landmarks found in crops of `size` px, px^2 of a crop of 192 px; of crops
    seen `partly` (N,), of those landmarks that are there."""
    doubt = np.log(found.variance_crop_px2 * (192 / size) ** 2)
    counted = True if partly is None else ~partly[:, None] | (found.score >= NO_IDEA)
    return np.asarray(doubt.mean(axis=1, where=counted))
