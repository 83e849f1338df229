"""Dark and flat pictures, brought to what the networks know, who learned from cameras that expose for what they see."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from muybridge.arrays import ByteArray

# What a picture's values span, where they span less, and how far they are drawn apart at most.
_SPAN, _MOST = 150.0, 6.0
# Share of the values that may lie beyond: less than there is of anybody who could be read.
_BEYOND = 0.001
# Who stands in the dark before a window is in a picture that spans all there is. Their crop is dim where all but a
# share of what is neither glaring nor beyond the border, which is black, is below a value; it is lit up to another.
# That share is less than there is of anybody, who may be all that is lit.
_DIM, _LIT, _BUT, _GLARING = 75.0, 150.0, 0.01, 250
# A picture is judged by about so many rows and columns.
_ENOUGH = 160


def well_exposed(chunks: Iterable[ByteArray]) -> Iterator[ByteArray]:
    """Chunks of (n, H, W, 3) frames, of which those that are too dark or too flat are stretched; each by itself, in
    place."""
    for frames in chunks:
        for frame in frames:
            stretch(frame)
        yield frames


def stretch(frame: ByteArray) -> None:
    """Draws the values of a frame (H, W, 3) apart, in place, where they span too little: all channels alike, and from
    the brightest down, or up from black where that leaves no room."""
    few = frame[:: max(1, frame.shape[0] // _ENOUGH), :: max(1, frame.shape[1] // _ENOUGH)]
    share = np.bincount(few.reshape(-1), minlength=256).cumsum() / few.size
    low, high = (int(value) for value in np.searchsorted(share, [_BEYOND, 1 - _BEYOND]))
    if high - low >= _SPAN:
        return
    gain = min(_SPAN / max(high - low, 1), _MOST)
    values = (np.arange(256) - low) * gain + max(high - (high - low) * gain, 0.0)
    cv2.LUT(frame, values.round().clip(0, 255).astype(np.uint8), dst=frame)


def light_up(crops: ByteArray) -> None:
    """Draws the values of dim crops (K, S, S, 3 or 4) apart, in place: from black up, all channels alike, also the
    fourth, which is a difference of values."""
    for crop in crops:
        brightest = crop[::4, ::4, :3].max(-1)
        shown = brightest[(brightest > 0) & (brightest < _GLARING)]
        high = float(np.quantile(shown, 1 - _BUT)) if len(shown) else _DIM
        if high < _DIM:
            gain = min(_LIT / high, _MOST)
            cv2.LUT(crop, (np.arange(256) * gain).round().clip(0, 255).astype(np.uint8), dst=crop)
