"""Images of 8 bits, warped and scaled down in whole numbers: the same to the bit on every processor.

OpenCV computes both in float32, with code of its own for every kind of processor, and about one value in 25,000 comes
out different by one. A network of 8 bits answers with another rounding of all its activations, which moves its
landmarks by tenths of a pixel. OpenCV's lookup of pixels by a table of places in whole numbers is exact.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.numerics._numba import compiled

Value = TypeVar("Value", np.uint8, np.float32)

# OpenCV's tables have places in 32nds of a pixel.
_PLACE_BITS = 5
# The shares of the pixels below a larger one are whole numbers that add up to a power of two.
_SHARE_BITS = 11
# Places beyond this, in those parts, are outside of every image.
_FAR = float(2**15 - 1 << _PLACE_BITS)


def warp(image: NDArray[Value], out_from_image: NDArray[Any], size: tuple[int, int]) -> NDArray[Value]:
    """An image through a homography, bilinear; black outside.

    Args:
        image: (H, W) or (H, W, C) of at most 32,767 px; what has no 8 bits is left to OpenCV.
        out_from_image: (3, 3) from pixels of the image to those of the result, or (2, 3).
        size: width and height of the result.

    Returns:
        (height, width) or (height, width, C).
    """
    affine = len(out_from_image) == 2
    if image.dtype != np.uint8 or max(image.shape[:2]) > 2**15 - 1:
        usual = cv2.warpAffine if affine else cv2.warpPerspective
        return np.asarray(usual(image, out_from_image, size, flags=cv2.INTER_LINEAR), dtype=image.dtype)
    matrix = np.vstack([out_from_image, [0.0, 0.0, 1.0]]) if affine else out_from_image
    places = np.empty((size[1], size[0], 2), dtype=np.int16)
    between = np.empty((size[1], size[0]), dtype=np.uint16)
    _place(np.linalg.inv(matrix), places, between)
    return np.asarray(cv2.remap(image, places, between, cv2.INTER_LINEAR), dtype=image.dtype)


def scaled_down(image: NDArray[Value], size: tuple[int, int]) -> NDArray[Value]:
    """An image averaged over areas.

    Args:
        image: (H, W) or (H, W, C); what has no 8 bits, or is scaled up, is left to OpenCV.
        size: width and height of the result.
    """
    height, width = image.shape[:2]
    across, down = width / size[0], height / size[1]
    simple = across == down == 2  # exact in OpenCV too, and fast
    if image.dtype != np.uint8 or min(across, down) < 1 or simple:
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=image.dtype)
    rows = np.ascontiguousarray(image).reshape(height, -1).astype(np.uint8, copy=False)
    channels = rows.shape[1] // width
    at, shares = _shares(width, size[0])
    at = (at[:, :, None] * channels + np.arange(channels)).reshape(len(at), -1)
    lines, portions = _shares(height, size[1])
    out = np.empty((size[1], size[0] * channels), dtype=np.uint8)
    _scale_down(rows, at, np.repeat(shares, channels, axis=1), lines, portions, out)
    return np.asarray(out.reshape(size[1], size[0], *image.shape[2:]), dtype=image.dtype)


@lru_cache(maxsize=32)
def _shares(many: int, few: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(n, few) pixels, of `many`, below each larger one, and their shares of it."""
    edges = np.arange(few + 1) * many / few
    at = np.floor(edges[:-1] + 1e-9) + np.arange(int(np.ceil(many / few)) + 1)[:, None]
    # Rounded up to each pixel's ends, not pixel by pixel: so the shares add up.
    begin, end = (
        np.round((np.clip(x, edges[:-1], edges[1:]) - edges[:-1]) * few / many * 2**_SHARE_BITS) for x in (at, at + 1)
    )
    shares = (end - begin).astype(np.int32)
    used = shares.any(axis=1)
    return np.minimum(at, many - 1).astype(np.int32)[used], shares[used]


@compiled
def _place(image_from_out: FloatArray, places: NDArray[np.int16], between: NDArray[np.uint16]) -> None:
    (a, b, c), (d, e, f), (g, h, i) = image_from_out
    one = np.int32(1 << _PLACE_BITS)
    count = places.shape[1]
    across, down = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    for row in range(places.shape[0]):
        x0, y0, w0 = b * row + c, e * row + f, h * row + i
        for n in range(count):
            scale = one / (g * n + w0)
            # Rounded by truncation of what is positive, which takes a third of the time of `floor`.
            x = min(max((a * n + x0) * scale, -_FAR), _FAR) + (_FAR + 0.5)
            y = min(max((d * n + y0) * scale, -_FAR), _FAR) + (_FAR + 0.5)
            across[n], down[n] = np.int32(x) - np.int32(_FAR), np.int32(y) - np.int32(_FAR)
        for n in range(count):
            places[row, n, 0] = across[n] >> _PLACE_BITS
            places[row, n, 1] = down[n] >> _PLACE_BITS
            between[row, n] = (down[n] & (one - 1)) * one + (across[n] & (one - 1))


@compiled
def _scale_down(
    rows: ByteArray, at: NDArray[np.int32], shares: NDArray[np.int32], lines: NDArray[np.int32],
    portions: NDArray[np.int32], out: ByteArray,
) -> None:  # fmt: skip
    width = out.shape[1]
    line, sums = np.empty(width, dtype=np.int32), np.empty(width, dtype=np.int32)
    done = -1
    for row in range(out.shape[0]):
        for n in range(width):
            sums[n] = 1 << (2 * _SHARE_BITS - 1)
        for k in range(lines.shape[0]):
            portion = portions[k, row]
            if portion == 0:
                continue
            if lines[k, row] != done:  # two rows of the result may share one of the image
                done = lines[k, row]
                source, first, share = rows[done], at[0], shares[0]
                for n in range(width):
                    line[n] = share[n] * np.int32(source[first[n]])
                for m in range(1, at.shape[0]):
                    first, share = at[m], shares[m]
                    for n in range(width):
                        line[n] += share[n] * np.int32(source[first[n]])
            for n in range(width):
                sums[n] += portion * line[n]
        for n in range(width):
            out[row, n] = sums[n] >> (2 * _SHARE_BITS)
