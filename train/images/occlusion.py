"""Occlusion in training crops: objects in front of people, pixelated faces, borders of the picture."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.images.camera_faults import outside_of_video

FACE = tuple(BODY23.index(n) for n in ("nose", "left_eye", "right_eye", "left_ear", "right_ear"))


def draw_occluders(
    image: Tensor, share: float | FloatArray, textures: Callable[[int], Tensor], rng: np.random.Generator
) -> Float32Array:
    """Draw objects in front of the person, in place: polygons and bars with the texture of another background.

    Args:
        image: (B, 3, S, S) in 0..1.
        share: of the images; or (B,) the probability of each.
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


# Borders of a picture in the order of a box: left, top, right, bottom. How many are near a person who is cut off by it
# or fills it, how often each is, how much of the person it cuts off at most, and the share that cuts nothing off.
_NORMALS = np.array([[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]])
_BORDERS = (0.35, 0.3, 0.15, 0.2)
_BORDER_SHARES = np.array([0.2, 0.27, 0.2, 0.33])
_MOST_CUT = np.array([0.4, 0.2, 0.4, 0.5])
_UNCUT = 0.45
# Share of cut boxes that are those of the whole person, as a detector that completes people gives them.
_COMPLETED = 0.25


@dataclass(frozen=True)
class Frames:
    """Pictures' borders in crops; beyond them crops are black.

    Attributes:
        lines: (B, 4, 3) nx, ny, edge: a point p of the crop is outside if nx * px + ny * py > edge; NaN where no border
            is near.
    """

    lines: Float32Array

    @property
    def near(self) -> IndexArray:
        """Crops with a border."""
        return np.flatnonzero(np.isfinite(self.lines[:, :, 2]).any(1))

    def mask(self, i: int, size: int) -> BoolArray:
        """(size, size) pixels of crop `i` outside of its picture."""
        y, x = np.mgrid[:size, :size].astype(np.float32)
        outside = np.zeros((size, size), bool)
        for nx, ny, edge in self.lines[i][np.isfinite(self.lines[i, :, 2])]:
            outside |= nx * x + ny * y > edge
        return outside

    def hidden(self, landmarks: Float32Array) -> BoolArray:
        """(B, J) whether landmarks (B, J, 2) are outside of the picture."""
        along = np.einsum("bjk,bsk->bjs", landmarks, np.nan_to_num(self.lines[:, :, :2]))
        return np.asarray((along > np.nan_to_num(self.lines[:, None, :, 2], nan=np.inf)).any(2))


def frame_people(
    rng: np.random.Generator, box_px: Float32Array, share: float, able: BoolArray
) -> tuple[Float32Array, Float32Array]:
    """Let the picture end near or within people: those who fill it, and those whose crown, feet or side it cuts off.

    Args:
        rng: source of random numbers, not used if the share is zero.
        box_px: (B, 4) bounding boxes.
        share: of the people.
        able: (B,) people who may be cut off.

    Returns:
        Boxes (B, 4) of what the picture shows, and its borders (B, 4), left, top, right and bottom, in the pixels of
        the boxes; NaN where there is none.
    """
    boxes, borders = box_px.copy(), np.full((len(box_px), 4), np.nan, np.float32)
    if not share:
        return boxes, borders
    for i in np.flatnonzero((rng.random(len(boxes)) < share) & able):
        size = np.tile(boxes[i, 2:] - boxes[i, :2], 2)
        cut = _MOST_CUT * rng.beta(1.0, 1.4, 4)
        cut = np.where(rng.random(4) < _UNCUT, -rng.uniform(0, 0.12, 4) * size.max() / np.maximum(size, 1e-3), cut)
        count = 1 + int(rng.choice(4, p=_BORDERS))
        sides = rng.choice(4, count, replace=False, p=_BORDER_SHARES)
        borders[i, sides] = (box_px[i] + np.array([1, 1, -1, -1]) * cut * size)[sides]
        for axis in (0, 1):  # hardly any picture is narrower than half of its height
            lack = rng.uniform(0.45, 0.8) * size.max() - (borders[i, axis + 2] - borders[i, axis])
            if lack > 0:
                borders[i, axis] -= lack / 2
                borders[i, axis + 2] += lack / 2
        if rng.random() >= _COMPLETED:
            low, high = np.fmax(boxes[i, :2], borders[i, :2]), np.fmin(boxes[i, 2:], borders[i, 2:])
            boxes[i] = np.concatenate([low, high])
    return boxes, borders


def map_borders(borders: Float32Array, matrix: Float32Array) -> Frames:
    """Map borders (B, 4), as of `frame_people`, into crops with affine maps (B, 2, 3)."""
    normal = np.einsum("bji,sj->bsi", np.linalg.inv(matrix[:, :, :2].astype(np.float64)), _NORMALS)
    edge = borders * np.array([-1, -1, 1, 1]) + np.einsum("bsi,bi->bs", normal, matrix[:, :, 2])
    return Frames(np.concatenate([normal, edge[..., None]], 2).astype(np.float32))


def loosen(rng: np.random.Generator, box_px: Float32Array, share: float) -> Float32Array:
    """Boxes (B, 4), a share of them 10 to 25 % larger or smaller, with each side off by some per cent, as detectors
    give them."""
    if not share:
        return box_px
    boxes = box_px.copy()
    chosen = rng.random(len(boxes)) < share
    size = boxes[:, 2:] - boxes[:, :2]
    grow = rng.uniform(0.1, 0.25, len(boxes)) * rng.choice([-1, 1], len(boxes)) / 2
    off = rng.normal(0, 0.04, (len(boxes), 4)).clip(-0.1, 0.1) + grow[:, None] * np.array([-1, -1, 1, 1])
    boxes[chosen] += (off * np.tile(size, 2))[chosen].astype(np.float32)
    return boxes
