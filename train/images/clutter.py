"""Cluttered backgrounds, as sharp as people and full of objects that are not people.

An enlarged background is blurred where a composited person is sharp, and a network would learn that difference instead
of people.
"""

from collections.abc import Callable

import cv2
import numpy as np

from muybridge.arrays import ByteArray


def tile_by_mirroring(patch: ByteArray, height: int, width: int, rng: np.random.Generator) -> ByteArray:
    """A square patch (s, s, 3), made smaller or slightly larger and continued by reflection: (height, width, 3)."""
    window = len(patch)
    side = max(16, round(window * float(np.exp(rng.uniform(np.log(0.5), np.log(1.15))))))
    resized = cv2.resize(patch, (side, side), interpolation=cv2.INTER_AREA if side < window else cv2.INTER_LINEAR)
    spread = cv2.copyMakeBorder(resized, 0, height, 0, width, cv2.BORDER_REFLECT_101)
    y, x = rng.integers(0, side, 2)
    return np.ascontiguousarray(spread[y : y + height, x : x + width], np.uint8)


def add_clutter(plate: ByteArray, most: int, texture: Callable[[], ByteArray], rng: np.random.Generator) -> None:
    """Draw up to `most` blobs, bars and polygons of the size of people or limbs into `plate` (H, W, 3), plain or with a
    `texture` of the same size."""
    height, width = plate.shape[:2]
    for _ in range(int(rng.integers(0, most + 1))):
        inside = shape(height, width, rng)
        if rng.random() < 0.6:
            cv2.copyTo(texture(), inside, plate)
        else:
            cv2.copyTo(np.ascontiguousarray(plain(height, width, rng)), inside, plate)


def plain(height: int, width: int, rng: np.random.Generator) -> ByteArray:
    """(H, W, 3) of one colour with a horizontal gradient; read-only."""
    left, right = rng.uniform(0.6, 1.2, 2).tolist()
    fall = np.linspace(left, right, width)
    row = (rng.uniform(10, 240, 3) * fall[:, None]).clip(0, 255).astype(np.uint8)
    return np.broadcast_to(row, (height, width, 3))


def shape(height: int, width: int, rng: np.random.Generator) -> ByteArray:
    """(H, W) one within a blob, bar or polygon of the size of people or limbs, zero elsewhere."""
    mask = np.zeros((height, width), np.uint8)
    at = rng.uniform(0, 1, 2) * [width, height]
    reach = float(np.exp(rng.uniform(np.log(0.03), np.log(0.4)))) * max(width, height)
    kind, angle = rng.random(), float(rng.normal(90, 25) if rng.random() < 0.6 else rng.uniform(0, 180))
    centre = (int(at[0]), int(at[1]))
    if kind < 0.4:
        cv2.ellipse(mask, centre, (round(reach), round(reach * rng.uniform(0.12, 0.7)) + 1), angle, 0, 360, 1, -1)
    elif kind < 0.75:
        end = at + reach * 2 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        cv2.line(mask, centre, (int(end[0]), int(end[1])), 1, max(2, round(reach * rng.uniform(0.08, 0.4))))
    else:
        turn = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8))))
        corners = at + reach * np.stack([np.cos(turn), np.sin(turn)], 1) * rng.uniform(0.3, 1.2, 2)
        cv2.fillPoly(mask, [corners.astype(np.int32)], 1)
    return mask
