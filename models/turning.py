"""Crops turned by quarters: a network that knows people upright best finds who lies or stands on their hands so."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.models.decode import decode_heatmaps
from muybridge.models.registry import KeypointModelCard

Maps = list[NDArray[np.float32]]
Value = TypeVar("Value", np.uint8, np.float32)

# A crop of whose landmarks the logarithms of the variances are more than this on average (px^2 of a crop of 192 px) is
# unsure; another orientation counts where they are less by so much.
_UNSURE, _SURER = 3.0, 0.6


def turn_where_unsure(
    look: Callable[[NDArray[Value]], Maps], crops: NDArray[Value], maps: Maps, card: KeypointModelCard, rows: int
) -> None:
    """Replace what a network says of unsure crops by what it says of them turned, where it is surer of that.

    Args:
        look: runs the network: crops to maps.
        crops: (N, ...) with rows and columns of pixels at the axes `rows` and `rows + 1`.
        maps: what the network says of them, changed in place: first the landmarks' heatmaps (N, J, h, w), logits, then
            any others of four axes, and arrays of two axes that do not turn.
        card: of the network.
        rows: axis of the crops.
    """
    unsure = _doubt(maps[0], card)
    (tried,) = np.nonzero(unsure > _UNSURE)
    if not len(tried):
        return
    least = unsure[tried] - _SURER
    for quarters in (1, 2, 3):
        turned = look(np.rot90(crops[tried], quarters, axes=(rows, rows + 1)))
        doubt = _doubt(turned[0], card)
        (surer,) = np.nonzero(doubt < least)
        least[surer] = doubt[surer]
        for out, found in zip(maps, turned, strict=True):
            back = found[surer]
            out[tried[surer]] = np.rot90(back, -quarters, axes=(2, 3)) if back.ndim == 4 else back


def _doubt(heatmaps: NDArray[np.float32], card: KeypointModelCard) -> NDArray[np.float64]:
    """(N,) mean logarithm of the landmarks' variances, px^2 of a crop of 192 px."""
    variance = decode_heatmaps(heatmaps, card.stride, card.spread).variance_crop_px2
    return np.asarray(np.log(variance * (192 / card.input_size) ** 2).mean(axis=1))
