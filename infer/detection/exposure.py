"""Contrast of dark and flat images, stretched to what the networks were trained on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import cv2
import numpy as np

from muybridge.arrays import ByteArray

# Range to which the values of an image are stretched, and the largest gain.
_SPAN, _MOST = 150.0, 6.0
# Share of the values that may lie outside the range: smaller than any person who can be detected.
_BEYOND = 0.001
# Someone in the dark in front of a window is in an image that spans the full range, but their crop is dim: all but a
# share of its pixels that are neither saturated nor outside the image (black) are below _DIM. It is brightened to
# _LIT. The share is smaller than a person, who may be the only bright part.
_DIM, _LIT, _BUT, _GLARING = 75.0, 150.0, 0.01, 250
# An image is judged by about so many rows and columns.
_ENOUGH = 160


def stretch_frames(chunks: Iterable[ByteArray]) -> Iterator[ByteArray]:
    """Chunks of (n, H, W, 3) frames with their contrast stretched where needed, each frame by itself, in place."""
    for frames in chunks:
        for frame in frames:
            stretch_contrast(frame)
        yield frames


def stretch_contrast(frame: ByteArray) -> bool:
    """Stretch the values of a frame (H, W, 3), in place, where their range is too small: all channels alike, downwards
    from the brightest value, or upwards from black where that leaves no room; whether they were."""
    few = frame[:: max(1, frame.shape[0] // _ENOUGH), :: max(1, frame.shape[1] // _ENOUGH)]
    # Twenty times as fast as numpy's; its counts are floats, exact here.
    count = cv2.calcHist([few.reshape(-1, 1)], [0], None, [256], [0, 256])
    share = count.ravel().astype(np.float64).cumsum() / few.size
    low, high = (int(value) for value in np.searchsorted(share, [_BEYOND, 1 - _BEYOND]))
    if high - low >= _SPAN:
        return False
    gain = min(_SPAN / max(high - low, 1), _MOST)
    values = (np.arange(256) - low) * gain + max(high - (high - low) * gain, 0.0)
    cv2.LUT(frame, values.round().clip(0, 255).astype(np.uint8), dst=frame)
    return True


def brighten_crops(crops: ByteArray) -> None:
    """Brighten dim crops (K, S, S, 3 or 4), in place: upwards from black, all channels alike, including the fourth, a
    difference of values."""
    for crop in crops:
        brightest = crop[::4, ::4, :3].max(-1)
        shown = brightest[(brightest > 0) & (brightest < _GLARING)]
        high = float(np.quantile(shown, 1 - _BUT)) if len(shown) else _DIM
        if high < _DIM:
            gain = min(_LIT / high, _MOST)
            cv2.LUT(crop, (np.arange(256) * gain).round().clip(0, 255).astype(np.uint8), dst=crop)
