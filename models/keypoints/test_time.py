"""Test-time augmentation of crops: mirrored, smaller, rotated by quarter turns, tilted, and in a tighter box.

The network is best on whole, upright people. Smaller crops help with partly visible people, quarter turns with people
who lie or stand on their hands; tilted crops and tighter boxes reduce the uncertainty that remains.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.geometry.cameras.sampling import scaled_down, warp
from muybridge.models.keypoints.decode import NO_IDEA, DecodedHeatmaps, count_located, in_part
from muybridge.models.keypoints.metadata import KeypointModelCard, crop_side

Maps = list[Float32Array]
Value = TypeVar("Value", np.uint8, np.float32)
Read = Callable[[NDArray[Value]], Maps]

# Sides of crops relative to the network's best: of a first pass over a video, and of people of whom least is visible.
FIRST_PASS, LEAST = 3 / 4, 5 / 8
# If at most this share of the landmarks is located, the crop is read at this share of its side; measured on held-out
# close-ups and people cut off by the image border.
_SIDES = ((0.5, LEAST), (0.85, 3 / 4), (0.99, 7 / 8))

# A crop is uncertain if the mean logarithm of its landmarks' variances (px^2 in a crop of 192 px) exceeds the first
# number; another orientation is used if it lowers that by the second. Partly visible people, at a desk or at the image
# border, are not rotated: that is why they are uncertain, and they may look like a person in any orientation.
_UNCERTAIN, _GAIN = 2.85, 0.6
# Of the crops of a series that are tried in every orientation, every n-th is tried first.
_FIRST_TRIED = 3
# Crops more uncertain than this are also tilted to both sides by this angle, read at a smaller size and in a tighter
# box (both relative to the crop's); the mean of all readings, each with its inverse variance as weight, is used.
_STILL_UNCERTAIN, _TILT = 2.05, np.radians(14.0)
_SMALLER, _TIGHTER = 3 / 4, 0.85
# Crops more uncertain than this are worth a mirrored reading.
WORTH_MIRRORING = 0.0


class Series(NamedTuple):
    """Which crops show the same person over time, so that not every one has to be tried in every orientation: false
    detections of the person detector are uncertain in all of their frames.

    Attributes:
        number: (N,) of the series; the crops of each are in temporal order.
        every: every n-th crop is tried in every orientation, the others only in those that helped their neighbours;
            fewer in a series in which none of a first few is helped.
    """

    number: IntArray
    every: int


def augment_at_test_time(
    read: Read[Value], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    series: Series | None = None, tilt: bool = False,
) -> DecodedHeatmaps:  # fmt: skip
    """Decode crops with test-time augmentation.

    Crops of partly visible people are read at a smaller size. Uncertain crops are read in other orientations, which
    replace the first reading where they are less uncertain. Crops that remain uncertain are merged with
    further readings.

    Args:
        read: runs the network: crops of any side that is a multiple of 32, to maps.
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        maps: the network's output for them, updated in place: first the landmarks' heatmaps (N, J, h, w), logits, then
            any other arrays of four axes, and arrays of two axes, which do not rotate.
        card: of the network.
        rows: axis of the crops' pixel rows.
        series: of the crops; without, each crop stands for itself.
        tilt: read uncertain crops again, tilted, smaller and in a tighter box: five more readings of each.

    Returns:
        The landmarks decoded from the final heatmaps.
    """
    decoded, size = card.decode(maps[0]), crops.shape[rows]
    sides = reading_sides(decoded.score, size, card.input_size)
    (small,) = np.nonzero(sides < size)
    for side in np.unique(sides[small]):
        (here,) = np.nonzero(sides == side)
        for out, found in zip(maps, at_side(read, int(side), rows)(crops[here]), strict=True):
            out[here] = found
    _update_decoded(decoded, maps, card, small)
    limit = crop_uncertainty(decoded, size)
    (uncertain,) = np.nonzero((limit > _UNCERTAIN) & ~in_part(decoded.score))
    quarters = _rotate(read, crops, maps, card, rows, limit - _GAIN, uncertain, series)
    (changed,) = np.nonzero(quarters)
    _update_decoded(decoded, maps, card, changed)
    if not tilt:
        return decoded
    (uncertain,) = np.nonzero(crop_uncertainty(decoded, size, in_part(decoded.score)) > _STILL_UNCERTAIN)
    sides[changed] = size
    for side in np.unique(sides[uncertain]):
        here = uncertain[sides[uncertain] == side]
        least = min(int(side), max(crop_side(side * _SMALLER), crop_side(card.input_size * LEAST)))
        reads = at_side(read, int(side), rows), at_side(read, least, rows)
        _read_again(reads, crops, maps, card, rows, here, quarters)
    _update_decoded(decoded, maps, card, uncertain)
    return decoded


def _update_decoded(decoded: DecodedHeatmaps, maps: Maps, card: KeypointModelCard, changed: IndexArray) -> None:
    """Decode the heatmaps of some crops again, in place."""
    if len(changed):
        for values, new in zip(decoded, card.decode(maps[0][changed]), strict=True):
            values[changed] = new


def _rotate(
    read: Read[Value], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    limit: FloatArray, uncertain: IndexArray, series: Series | None,
) -> IntArray:  # fmt: skip
    """Rotate the `uncertain` crops, see `augment_at_test_time`; (N,) number of quarter turns of each crop's best
    orientation. Its uncertainty has to be below `limit` (N,), which is lowered in place."""
    quarters = np.zeros(len(crops), dtype=np.int64)

    def attempt(turn: int, tried: IndexArray) -> None:
        if not len(tried):
            return
        rotated = read(np.rot90(crops[tried], turn, axes=(rows, rows + 1)))
        value = crop_uncertainty(card.decode(rotated[0]), crops.shape[rows])
        better_here = value < limit[tried]
        better = tried[better_here]
        limit[better], quarters[better] = value[better_here], turn
        for out, found in zip(maps, rotated, strict=True):
            back = found[better_here]
            out[better] = np.rot90(back, -turn, axes=(2, 3)) if back.ndim == 4 else back

    before, after = _neighbours_in_series(uncertain, series, 1)
    sampled = before == uncertain
    # A few tell whether any orientation helps a series.
    first = _neighbours_in_series(uncertain, series, _FIRST_TRIED)[0] == uncertain
    for turn in (1, 2, 3):
        attempt(turn, uncertain[first])
    if series is not None:
        number = series.number[uncertain]
        promising = np.isin(number, number[quarters[uncertain] > 0])
        for turn in (1, 2, 3):
            attempt(turn, uncertain[sampled & ~first & promising])
    counts = quarters[before], quarters[after]
    for turn in (1, 2, 3):
        attempt(turn, uncertain[~sampled & ((counts[0] == turn) | (counts[1] == turn))])
    return quarters


def _read_again(
    reads: tuple[Read[Value], Read[Value]], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    uncertain: IndexArray, quarters: IntArray,
) -> None:  # fmt: skip
    """Merge the maps of the `uncertain` crops, rotated by their `quarters` (N,), with those of further readings of the
    same crops, in place: tilted to either side, smaller, and in a tighter box at both sizes.

    The logits are averaged, so that a place needs every reading's support; a reading's weight is its inverse variance,
    the geometric mean over the landmarks of the crop.

    Args:
        reads: the network at the size of the first reading, and at a smaller one.
        crops, maps, card, rows, uncertain, quarters: as in `augment_at_test_time`.
    """
    usual, smaller = reads
    upright = np.stack([np.rot90(crops[k], quarters[k], axes=(rows - 1, rows)) for k in uncertain])
    tighter = _magnify_crops(upright, rows)
    views: list[tuple[Read[Value], NDArray[Value], Callable[[Float32Array], Float32Array]]] = [
        (usual, _tilt_crops(upright, rows, _TILT), partial(_tilt_maps_back, angle=_TILT)),
        (usual, _tilt_crops(upright, rows, -_TILT), partial(_tilt_maps_back, angle=-_TILT)),
        (smaller, upright, lambda found: found),
        (usual, tighter, _shrink_maps_back),
        (smaller, tighter, _shrink_maps_back),
    ]
    weight = _weights(maps[0][uncertain], card)
    totals, weights = [_weighted(out[uncertain], weight) for out in maps], weight
    for look, shown, back in views:
        found = [back(each) if each.ndim == 4 else each for each in look(shown)]
        weight = _weights(found[0], card)
        weights = weights + weight
        for total, values in zip(totals, found, strict=True):
            values = _weighted(values, weight)
            if values.ndim == 2:
                total += values
                continue
            for k, turn in enumerate(quarters[uncertain]):
                total[k] += np.rot90(values[k], -turn, axes=(1, 2))
    for out, total in zip(maps, totals, strict=True):
        out[uncertain] = _weighted(total, np.reciprocal(weights))


def _weights(heatmaps: Float32Array, card: KeypointModelCard) -> Float32Array:
    """(N,) inverse variance of crops by their heatmaps (N, J, h, h), the geometric mean over the landmarks."""
    spread = np.log(card.decode(heatmaps).variance_crop_px2).mean(axis=1)
    return np.asarray(np.exp(-spread), dtype=np.float32)


def _weighted(values: Float32Array, weight: Float32Array) -> Float32Array:
    """Each of N arrays times its weight (N,)."""
    return np.asarray(values * weight.reshape(-1, *[1] * (values.ndim - 1)), dtype=np.float32)


def _tilt_crops(crops: NDArray[Value], rows: int, angle: float) -> NDArray[Value]:
    """Crops rotated about their centre by `angle`, radians, counter-clockwise as displayed; black beyond the border."""
    size = crops.shape[rows]
    matrix = cv2.getRotationMatrix2D(((size - 1) / 2, (size - 1) / 2), float(np.degrees(angle)), 1.0)
    return _redraw(crops, rows, lambda p: warp(p, matrix, (size, size)))


def _tilt_maps_back(maps: Float32Array, angle: float) -> Float32Array:
    """Heatmaps (N, J, h, h) of crops tilted by `angle`, resampled to the upright crop: bilinear, with the nearest cell
    beyond the border."""
    cells, weights = _bilinear(maps.shape[-1], angle)
    flat = maps.reshape(*maps.shape[:2], -1)
    out = sum(weight * flat[..., cell] for cell, weight in zip(cells, weights, strict=True))
    return np.asarray(out, dtype=np.float32).reshape(maps.shape)


@lru_cache(maxsize=8)
def _bilinear(size: int, angle: float) -> tuple[IndexArray, Float32Array]:
    """(4, size * size) cells of a map tilted by `angle`, and the weight of each in every cell of the upright map."""
    middle = (size - 1) / 2
    v, u = np.indices((size, size)) - middle
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = (np.clip(at + middle, 0, size - 1).ravel() for at in (cos * u + sin * v, cos * v - sin * u))
    left, top = (np.minimum(np.floor(at), size - 2).astype(np.intp) for at in (x, y))
    cells = np.stack([(top + dv) * size + left + du for dv in (0, 1) for du in (0, 1)])
    across, down = (np.stack([1 - (at - low), at - low]) for at, low in ((x, left), (y, top)))
    weights = np.stack([down[dv] * across[du] for dv in (0, 1) for du in (0, 1)]).astype(np.float32)
    return cells, weights


def _magnify_crops(crops: NDArray[Value], rows: int) -> NDArray[Value]:
    """The middle of crops, as in a box that is smaller by `_TIGHTER`, at the crops' size."""
    size = crops.shape[rows]
    shift = (size - 1) / 2 * (1 - 1 / _TIGHTER)
    matrix = np.array([[1 / _TIGHTER, 0, shift], [0, 1 / _TIGHTER, shift]])
    return _redraw(crops, rows, lambda p: warp(p, matrix, (size, size)))


def _shrink_maps_back(maps: Float32Array) -> Float32Array:
    """Heatmaps (N, J, h, h) of `_magnify_crops`, resampled to the whole crop: linear between cell centres, the nearest
    cell beyond the border."""
    cells = maps.shape[-1]
    middle = (cells - 1) / 2
    return _resampled(maps, (np.arange(cells) - middle) / _TIGHTER + middle)


def _neighbours_in_series(uncertain: IndexArray, series: Series | None, times: int) -> tuple[IndexArray, IndexArray]:
    """(n,) and (n,): for each uncertain crop, the nearest crops of its series before and after it of those at every
    `times * series.every` places, the first among them; the crop itself if it is one of these."""
    before, after = uncertain.copy(), uncertain.copy()
    if series is None:
        return before, after
    number = series.number[uncertain]
    for each in np.unique(number):
        (here,) = np.nonzero(number == each)
        place, every = np.arange(len(here)), times * series.every
        preceding, following = place // every * every, -(-place // every) * every
        before[here] = uncertain[here[preceding]]
        after[here] = uncertain[here[np.where(following < len(here), following, preceding)]]
    return before, after


def crop_uncertainty(found: DecodedHeatmaps, size: int, partly: BoolArray | None = None) -> FloatArray:
    """(N,) mean logarithm of the landmark variances in crops of `size` px, scaled to px^2 in a crop of 192 px. In crops
    that are `partly` (N,) visible people only located landmarks count."""
    value = np.log(found.variance_crop_px2 * (192 / size) ** 2)
    counted = True if partly is None else ~partly[:, None] | (found.score >= NO_IDEA)
    return np.asarray(value.mean(axis=1, where=counted))


def mean_of_mirrored(once: Float32Array, mirrored: Float32Array, twins: IndexArray) -> Float32Array:
    """The mean of the outputs for crops and for their mirror images, in the geometry of the crops.

    Args:
        once: (N, J, h, w) heatmaps or (N, J) visibility, logits.
        mirrored: the same for the mirror images.
        twins: (J,) index of each landmark's counterpart on the other side.
    """
    back = mirrored[:, twins]
    return np.asarray((once + (back[..., ::-1] if back.ndim == 4 else back)) / 2, dtype=np.float32)


def reading_sides(score: FloatArray, side: int, best: int) -> IntArray:
    """Side at which crops are read best.

    Args:
        score: (N, J) scores of the landmarks at the present side.
        side: of the crops, px.
        best: crop side at which the network is best, px.

    Returns:
        (N,) px.
    """
    count, most = count_located(score), score.shape[1]
    sides = np.full(len(score), side, dtype=np.int64)
    for share, smaller in reversed(_SIDES):
        sides[count <= share * most] = crop_side(best * smaller)
    return np.where(in_part(score, 1.0), np.minimum(sides, side), side)


def at_side(read: Read[Value], side: int, rows: int) -> Read[Value]:
    """A `read` that makes crops smaller first; its maps have the size of those of the original crops.

    Args:
        read: runs the network: crops to maps, of which those with four axes are (N, J, h, w) logits.
        side: of the crops that it gets, px.
        rows: axis of the crops' pixel rows, before that of the columns.
    """

    def smaller(crops: NDArray[Value]) -> Maps:
        size = crops.shape[rows]
        if side == size:
            return read(crops)
        shrunk = _redraw(crops, rows, lambda p: scaled_down(p, (side, side)))
        maps = read(shrunk)
        return [_enlarge(m, m.shape[-1] * size // side) if m.ndim == 4 else m for m in maps]

    return smaller


def _redraw(crops: NDArray[Value], rows: int, draw: Callable[[NDArray[Value]], NDArray[Any]]) -> NDArray[Value]:
    """Apply an image operation to each crop.

    Args:
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        rows: 1 or 2.
        draw: (h, w, C) to images of as many channels, all of one size.
    """
    pictures = np.ascontiguousarray(crops if rows == 1 else crops.transpose(0, 2, 3, 1))
    drawn = np.stack([draw(p) for p in pictures])
    drawn = drawn.reshape(*drawn.shape[:3], -1)  # OpenCV drops the axis of a single channel
    return np.ascontiguousarray(drawn if rows == 1 else drawn.transpose(0, 3, 1, 2)).astype(crops.dtype, copy=False)


def _enlarge(maps: Float32Array, cells: int) -> Float32Array:
    """Maps (N, J, h, h) resampled to `cells` cells per side: linear between cell centres, the nearest cell beyond the
    outermost."""
    return _resampled(maps, (np.arange(cells) + 0.5) * maps.shape[-1] / cells - 0.5)


def _resampled(maps: Float32Array, at: FloatArray) -> Float32Array:
    """Maps (N, J, h, h) at the rows and columns `at` (n,), which may lie beyond the outermost cells."""
    have = maps.shape[-1]
    at = np.clip(at, 0, have - 1)
    weights = np.maximum(0, 1 - np.abs(at[:, None] - np.arange(have))).astype(np.float32)
    return np.asarray(weights @ maps @ weights.T, dtype=np.float32)
