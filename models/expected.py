"""Where landmarks are expected, as the keypoint network sees it: a stick figure in three colours.

One picture cannot tell which leg of somebody in profile is the left one, nor which of two people in a hold is meant;
other cameras and other moments can. What they say is drawn into the crop: channels for the left side, the right side
and the middle; arms and face brighter than legs, so that where they cross it is still known which is which.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.landmarks import BODY23, LandmarkSet

SIDES = ("left", "right", "middle")
# Where the channels of a crop lie in its mirror picture: RGB, the plate's difference, and left and right exchanged.
MIRRORED = [0, 1, 2, 3, 5, 4, 6]
_ARM, _LEG = 255, 160
_OF_LEGS = ("hip", "knee", "ankle", "toe", "heel")
# Lines are a 64th of the crop wide; their ends lie on an eighth of a pixel.
_WIDTH, _FRACTION_BITS = 64, 3
# Far outside of a crop, in sides of it: OpenCV's lines overflow with larger numbers.
_FAR = 8.0


def draw_expected(points_px: NDArray[np.floating], size: int, landmarks: LandmarkSet = BODY23) -> NDArray[np.uint8]:
    """Stick figures where people are expected.

    Args:
        points_px: (N, J, 2) px of the crops, NaN where nothing is expected.
        size: side S of the crops, px.
        landmarks: what the J are.

    Returns:
        (N, S, S, 3) left, right, middle; zero where nothing is expected.
    """
    out = np.zeros((len(points_px), len(SIDES), size, size), np.uint8)
    bones, dots = _strokes(landmarks)
    thickness = max(1, round(size / _WIDTH))
    known = np.isfinite(points_px).all(-1)
    fixed = np.clip(np.where(known[..., None], points_px, 0), -_FAR * size, _FAR * size) * (1 << _FRACTION_BITS)
    places = np.round(fixed).astype(np.int64).tolist()
    for planes, at, there in zip(out, places, known, strict=True):
        for a, b, side, shade in bones:
            if there[a] and there[b]:
                cv2.line(planes[side], at[a], at[b], shade, thickness, cv2.LINE_AA, _FRACTION_BITS)
        for j, side, shade in dots:
            if there[j]:
                radius = thickness << _FRACTION_BITS
                cv2.circle(planes[side], at[j], radius, shade, -1, cv2.LINE_AA, _FRACTION_BITS)
    return np.ascontiguousarray(out.transpose(0, 2, 3, 1))


def _strokes(landmarks: LandmarkSet) -> tuple[list[tuple[int, int, int, int]], list[tuple[int, int, int]]]:
    """Bones (from, to, side, shade) and dots (landmark, side, shade)."""
    names = landmarks.names
    bones = [(a, b, _side(names[a], names[b]), _shade(names[a], names[b])) for a, b in landmarks.edge_indices]
    return bones, [(j, _side(name), _shade(name)) for j, name in enumerate(names)]


def _side(*names: str) -> int:
    sides = {name.split("_")[0] for name in names} & set(SIDES[:2])
    return SIDES.index(sides.pop()) if len(sides) == 1 else 2


def _shade(*names: str) -> int:
    return _LEG if all(name.rsplit("_", 1)[-1] in _OF_LEGS for name in names) else _ARM
