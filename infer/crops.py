"""The pixels of person crops; their geometry is in `muybridge.geometry.crops`."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.crops import Crops

# A crop is sampled at most this much finer than it is wanted and then averaged down: enough for a person of
# 2,000 px in a crop of 128.
_MAX_SUPERSAMPLING = 16


def extract_crops(frame: NDArray[np.uint8], crops: Crops) -> NDArray[np.uint8]:
    """Cut crops out of a frame, without aliasing.

    Where the crop is coarser than the frame it is sampled at whole multiples of its resolution, at least as
    fine as the frame, and averaged down over areas. Outside the frame a crop is black.

    Args:
        frame: (H, W, 3).
        crops: N crops of this frame.

    Returns:
        (N, S, S, 3).
    """
    size = crops.size_px
    pixels = np.empty((len(crops), size, size, 3), dtype=np.uint8)
    finest = crops.image_px_per_crop_px
    for index, homography in enumerate(crops.crop_from_image):
        fold = int(np.clip(np.ceil(finest[index] - 0.05), 1, _MAX_SUPERSAMPLING))
        shift = (fold - 1) / 2
        fine_from_image = np.array([[fold, 0, shift], [0, fold, shift], [0, 0, 1.0]]) @ homography
        fine = cv2.warpPerspective(
            frame, fine_from_image, (fold * size, fold * size), flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=(0, 0, 0),
        )  # fmt: skip
        if fold > 1:
            fine = cv2.resize(fine, (size, size), interpolation=cv2.INTER_AREA)
        pixels[index] = fine
    _blacken_behind(pixels, crops)
    return pixels


def _blacken_behind(pixels: NDArray[np.uint8], crops: Crops) -> None:
    """Paint black what a wide crop sees behind the real camera, where the homography would fold the image."""
    edge = crops.size_px - 0.5
    corners = np.array([[-0.5, -0.5, 1], [edge, -0.5, 1], [edge, edge, 1], [-0.5, edge, 1]])
    third_rows = crops.image_from_crop[:, 2]
    for index in np.flatnonzero(((third_rows @ corners.T) <= 0).any(axis=1)):
        grid = np.arange(crops.size_px)
        a, b, c = third_rows[index]
        pixels[index][a * grid[None, :] + b * grid[:, None] + c <= 0] = 0
