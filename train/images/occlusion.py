"""Occlusion in training crops: objects in front of people, pixelated faces, image borders."""

from collections.abc import Callable

import cv2
import numpy as np
import torch
from torch import Tensor

from muybridge.arrays import BoolArray, Float32Array
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.images.camera_faults import outside_of_video

FACE = tuple(BODY23.index(n) for n in ("nose", "left_eye", "right_eye", "left_ear", "right_ear"))


def draw_occluders(
    image: Tensor, share: float, textures: Callable[[int], Tensor], rng: np.random.Generator
) -> Float32Array:
    """Draw objects in front of the person, in place: polygons and bars with the texture of another background.

    Args:
        image: (B, 3, S, S) in 0..1.
        share: of the images.
        textures: gives so many textures (n, 3, S, S).
        rng: source of random numbers.

    Returns:
        (B, S, S) opacity of the objects.
    """
    size = image.shape[-1]
    chosen = np.nonzero(rng.random(len(image)) < share)[0]
    mask = np.zeros((len(image), size, size), np.float32)
    for i in chosen:
        canvas = np.zeros((size, size), np.uint8)
        for _ in range(int(rng.integers(1, 4))):
            center = rng.uniform(0, size, 2)
            if rng.random() < 0.5:
                reach = rng.uniform(0.04, 0.2) * size
                angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(4, 8))))
                corners = center + reach * np.stack([np.cos(angle), np.sin(angle)], 1) * rng.uniform(0.5, 1.6, 2)
                cv2.fillPoly(canvas, [corners.astype(np.int32)], 255, cv2.LINE_AA)
            else:
                end = center + rng.normal(0, 0.5, 2) * size
                width = int(rng.integers(1, max(2, size // 12)))
                cv2.line(canvas, center.astype(int).tolist(), end.astype(int).tolist(), 255, width, cv2.LINE_AA)
        mask[i] = canvas / 255.0
    if len(chosen):
        alpha = torch.from_numpy(mask)[:, None]
        for i, texture in zip(chosen, textures(len(chosen)), strict=True):
            image[i].lerp_(texture, alpha[i])
    return mask


def pixelate_faces(image: Tensor, landmarks: Float32Array, share: float, rng: np.random.Generator) -> None:
    """Pixelate faces in a share of the images, in place, as in published recordings."""
    size = image.shape[-1]
    for i in np.nonzero(rng.random(len(image)) < share)[0]:
        face = landmarks[i, list(FACE)]
        center, reach = face.mean(0), 1.2 * float(np.abs(face - face.mean(0)).max()) + 2
        low = np.clip(center - reach, 0, size - 2).astype(int)
        high = np.clip(center + reach, low + 2, size).astype(int)
        patch = image[i : i + 1, :, low[1] : high[1], low[0] : high[0]]
        cells = int(rng.integers(2, 6))
        small = torch.nn.functional.adaptive_avg_pool2d(patch, cells)
        image[i : i + 1, :, low[1] : high[1], low[0] : high[0]] = torch.nn.functional.interpolate(
            small, patch.shape[-2:], mode="nearest"
        )


def truncate(
    visible: BoolArray, landmarks: Float32Array, size: int, share: float, rng: np.random.Generator
) -> tuple[BoolArray, list[tuple[int, BoolArray]]]:
    """Let a share of the crops extend over the border of the video.

    Args:
        visible: (B, J).
        landmarks: (B, J, 2) px.
        size: side of the crops, px.
        share: of the crops.
        rng: source of random numbers.

    Returns:
        Which landmarks are still visible, and pairs of a crop's index and its mask (S, S) of pixels outside.
    """
    visible, outside = visible.copy(), []
    for i in np.nonzero(rng.random(len(visible)) < share)[0]:
        mask, (nx, ny, edge) = outside_of_video(rng, size, size)
        outside.append((int(i), mask))
        centred = landmarks[i] - (size - 1) / 2
        visible[i] &= ~(centred[:, 0] * nx + centred[:, 1] * ny > edge)
    return visible, outside
