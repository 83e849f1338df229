"""Crops turned by quarters: a network that knows people upright best finds who lies or stands on their hands so."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.models.decode import NO_IDEA, DecodedHeatmaps, decode_heatmaps
from muybridge.models.registry import KeypointModelCard

Maps = list[NDArray[np.float32]]
Value = TypeVar("Value", np.uint8, np.float32)

# A crop of whose landmarks the logarithms of the variances are more than this on average (px^2 of a crop of 192 px) is
# unsure; another orientation counts where they are less by so much.
_UNSURE, _SURER = 3.0, 0.6
# Nobody is turned of whom some landmarks, but less than this share of them, are in the crop: who is seen in part, at a
# desk or by the picture's border, is unsure for that and not for lying, and may look like a person any way up. Of whom
# fewer than so many are found, nothing is known yet.
_WHOLE, _LEAST_THERE = 0.85, 6


class Series(NamedTuple):
    """Which crops show the same at one moment after another, so that not every one need be tried in every orientation:
    what the detector takes for a person and is none is unsure in all of its frames.

    Attributes:
        number: (N,) of the series; the crops of each are in order of time.
        every: one of so many is tried in every orientation, the others in those that count for their neighbours.
    """

    number: NDArray[np.int64]
    every: int


def turn_where_unsure(
    look: Callable[[NDArray[Value]], Maps], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int,
    series: Series | None = None,
) -> DecodedHeatmaps:  # fmt: skip
    """Replace what a network says of unsure crops by what it says of them turned, where it is surer of that.

    Args:
        look: runs the network: crops to maps.
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        maps: what the network says of them, changed in place: first the landmarks' heatmaps (N, J, h, w), logits, then
            any others of four axes, and arrays of two axes that do not turn.
        card: of the network.
        rows: axis of the crops.
        series: of the crops; each stands for itself if absent.

    Returns:
        the landmarks that the heatmaps then say.
    """
    decoded = decode_heatmaps(maps[0], card.stride, card.spread)
    least = _doubt(decoded, card)
    there = (decoded.score >= NO_IDEA).sum(axis=1)
    in_part = (there >= _LEAST_THERE) & (there < _WHOLE * decoded.score.shape[1])
    (unsure,) = np.nonzero((least > _UNSURE) & ~in_part)
    if not len(unsure):
        return decoded
    least -= _SURER
    quarters = np.zeros(len(crops), dtype=np.int64)

    def attempt(turn: int, tried: NDArray[np.intp]) -> None:
        if not len(tried):
            return
        turned = look(np.rot90(crops[tried], turn, axes=(rows, rows + 1)))
        doubt = _doubt(decode_heatmaps(turned[0], card.stride, card.spread), card)
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
    (changed,) = np.nonzero(quarters)
    for values, new in zip(decoded, decode_heatmaps(maps[0][changed], card.stride, card.spread), strict=True):
        values[changed] = new
    return decoded


def _samples(unsure: NDArray[np.intp], series: Series | None) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
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


def _doubt(found: DecodedHeatmaps, card: KeypointModelCard) -> NDArray[np.float64]:
    """(N,) mean logarithm of the landmarks' variances, px^2 of a crop of 192 px."""
    return np.asarray(np.log(found.variance_crop_px2 * (192 / card.input_size) ** 2).mean(axis=1))
