"""The pixels of person crops; their geometry is in `muybridge.geometry.cameras.crops`."""

from __future__ import annotations

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray, IndexArray
from muybridge.geometry.cameras.crops import Crops
from muybridge.geometry.cameras.sampling import warp

# A crop that is this many times coarser than the frame is cut from a frame that is averaged down first: whole multiples
# are averaged many times as fast as a finer crop is sampled.
_COARSE = 2

# Averaging down stops here: crops of 128 px from people of 16,000.
_MAX_FOLD = 128


def extract_crops(frame: ByteArray, crops: Crops, half: ByteArray | None = None) -> ByteArray:
    """Cut crops out of a frame, without aliasing.

    Where the crop is coarser than the frame it is sampled at a whole multiple of its resolution, at least as
    fine as the frame, and averaged down over areas. Outside the frame a crop is black.

    Args:
        frame: (H, W, 3), or (H, W) of one channel.
        crops: N crops of this frame.
        half: the frame averaged over two by two pixels, where that is there already; coarse crops are cut from it.

    Returns:
        (N, S, S, 3), or (N, S, S).
    """
    size = crops.size_px
    pixels = np.empty((len(crops), size, size, *frame.shape[2:]), dtype=np.uint8)
    coarseness = np.clip(crops.image_px_per_crop_px, 1, _MAX_FOLD)
    bounds = _image_bounds(crops, frame.shape[1], frame.shape[0])
    for index, crop_from_image in enumerate(crops.crop_from_image):
        # A power of two that leaves a factor of 1 to 2 to the sampling below.
        shrink = 2 ** int(np.log2(coarseness[index])) if coarseness[index] >= _COARSE else 1
        if shrink > 1 and half is not None:
            image, image_from_shrunk = _shrunk(half, _in_half(bounds[index], half), shrink // 2)
            image_from_shrunk = _scaling(2, 2) @ image_from_shrunk
        else:
            image, image_from_shrunk = _shrunk(frame, bounds[index], shrink)
        fold = int(np.ceil(coarseness[index] / shrink - 0.05))
        fine_from_crop = _scaling(fold, fold)
        fine = warp(image, fine_from_crop @ crop_from_image @ image_from_shrunk, (fold * size, fold * size))
        if fold > 1:
            fine = np.asarray(cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        pixels[index] = fine
    _blacken_behind(pixels, crops)
    return pixels


def scaled_down(crops: Crops, scale: int) -> Crops:
    """The same crops of the image averaged over `scale` by `scale` pixels."""
    return crops if scale == 1 else Crops(crops.size_px, crops.crop_from_image @ _scaling(scale, scale))


def _in_half(bounds: IndexArray, half: ByteArray) -> IndexArray:
    """(4,) bounds in px of the frame to px of its half, never empty."""
    low = np.minimum(bounds[:2] // 2, np.array(half.shape[1::-1]) - 1)
    return np.concatenate([low, np.clip(-(-bounds[2:] // 2), low + 1, half.shape[1::-1])])


def _scaling(factor_x: float, factor_y: float) -> FloatArray:
    """(3, 3) what scaling an image by these factors does to its pixels, whose centres are whole numbers."""
    return np.array([[factor_x, 0, (factor_x - 1) / 2], [0, factor_y, (factor_y - 1) / 2], [0, 0, 1.0]])


def _shrunk(frame: ByteArray, bounds: IndexArray, shrink: int) -> tuple[ByteArray, FloatArray]:
    """The part of the frame within bounds, averaged down, and the (3, 3) from its pixels to the frame's."""
    if shrink == 1:
        return frame, np.eye(3)
    # Whole multiples are twenty times as fast. What is left over at the frame's far edge turns black.
    count = np.maximum(-(-(bounds[2:] - bounds[:2]) // shrink), 1)
    count = np.minimum(count, np.array(frame.shape[1::-1]) // shrink)
    if (count < 1).any():
        return frame, np.eye(3)
    left, top = np.minimum(bounds[:2], frame.shape[1::-1] - count * shrink)
    part = frame[top : top + count[1] * shrink, left : left + count[0] * shrink]
    small = cv2.resize(part, (int(count[0]), int(count[1])), interpolation=cv2.INTER_AREA)
    to_frame = _scaling(shrink, shrink)
    to_frame[:2, 2] += left, top
    return np.asarray(small), to_frame


def _image_bounds(crops: Crops, width: int, height: int) -> IndexArray:
    """(N, 4) left, top, right, bottom (exclusive) of what the crops can see of a frame, never empty."""
    edge = crops.size_px - 0.5
    corners = np.array([[-0.5, -0.5], [edge, -0.5], [edge, edge], [-0.5, edge]])
    seen = crops.to_image(np.repeat(corners[None], len(crops), axis=0))
    # A corner behind the camera: anything may be in view.
    whole = np.isnan(seen).any(axis=(1, 2))
    seen[whole] = [[0, 0], [width, 0], [width, height], [0, height]]
    limit = np.array([width, height])
    low = np.clip(np.floor(seen.min(axis=1)) - 1, 0, limit - 1)
    high = np.clip(np.ceil(seen.max(axis=1)) + 2, low + 1, limit)
    return np.concatenate([low, high], axis=1).astype(np.intp)


def _blacken_behind(pixels: ByteArray, crops: Crops) -> None:
    """Paint black what a wide crop sees behind the real camera, where the homography would fold the image."""
    edge = crops.size_px - 0.5
    corners = np.array([[-0.5, -0.5, 1], [edge, -0.5, 1], [edge, edge, 1], [-0.5, edge, 1]])
    third_rows = crops.image_from_crop[:, 2]
    for index in np.flatnonzero(((third_rows @ corners.T) <= 0).any(axis=1)):
        grid = np.arange(crops.size_px)
        a, b, c = third_rows[index]
        pixels[index][a * grid[None, :] + b * grid[:, None] + c <= 0] = 0
