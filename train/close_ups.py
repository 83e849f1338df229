"""People of whom a camera has only a part: at a desk, too near, leaving the picture. Their crops frame that part."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# What lies beyond the cut: the black outside of the video, something in front of the person, or the person after all.
BORDER, SOMETHING, PERSON = range(3)
_BEYOND = (0.65, 0.2, 0.15)
# Which side is cut off: bottom, left, right, top.
_NORMALS = np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
_SIDES = (0.7, 0.11, 0.11, 0.08)
_KEPT = (0.3, 0.85)  # of the box


@dataclass(frozen=True)
class Cuts:
    """Where people are cut off.

    Attributes:
        line: (B, 3) nx, ny, edge in crop pixels: beyond the cut nx x + ny y > edge; NaN where nothing is cut off.
        beyond: (B,) BORDER, SOMETHING or PERSON.
    """

    line: NDArray[np.float32]
    beyond: NDArray[np.int64]

    def mask(self, i: int, size: int) -> NDArray[np.bool_]:
        """(size, size) pixels of crop `i` beyond its cut."""
        y, x = np.mgrid[:size, :size].astype(np.float32)
        nx, ny, edge = self.line[i]
        return np.asarray(nx * x + ny * y > edge)

    def chosen(self, beyond: int) -> NDArray[np.intp]:
        """Crops with a cut of that kind."""
        return np.flatnonzero(np.isfinite(self.line[:, 0]) & (self.beyond == beyond))

    def hidden(self, landmarks: NDArray[np.float32]) -> NDArray[np.bool_]:
        """(B, J) whether landmarks (B, J, 2) are out of sight by it."""
        there = np.isfinite(self.line[:, 0]) & (self.beyond != PERSON)
        past = np.einsum("bjk,bk->bj", landmarks, self.line[:, :2]) > self.line[:, 2:]
        return np.asarray(past & there[:, None])


def cut_boxes(
    rng: np.random.Generator, box_px: NDArray[np.float32], share: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Boxes (B, 4) of what is left of people of whom `share` are cut off, and lines (B, 3) as in `Cuts`, both in the
    pixels of `box_px`."""
    boxes, lines = box_px.copy(), np.full((len(box_px), 3), np.nan, np.float32)
    for i in np.flatnonzero(rng.random(len(boxes)) < share):
        side, kept = int(rng.choice(4, p=_SIDES)), rng.uniform(*_KEPT)
        left, top, right, bottom = boxes[i]
        if side == 0:
            boxes[i, 3] = edge = top + kept * (bottom - top)
        elif side == 1:
            boxes[i, 0] = edge = right - kept * (right - left)
        elif side == 2:
            boxes[i, 2] = edge = left + kept * (right - left)
        else:
            boxes[i, 1] = edge = bottom - kept * (bottom - top)
        lines[i] = *_NORMALS[side], edge * _NORMALS[side].sum()
    return boxes, lines


def to_crop(rng: np.random.Generator, lines: NDArray[np.float32], matrix: NDArray[np.float32]) -> Cuts:
    """Lines of `cut_boxes` seen through the affine maps `matrix` (B, 2, 3) into crops, with what lies beyond them."""
    normal = np.einsum("bji,bj->bi", np.linalg.inv(matrix[:, :, :2].astype(np.float64)), lines[:, :2])
    edge = lines[:, 2] + np.einsum("bi,bi->b", normal, matrix[:, :, 2])
    line = np.concatenate([normal, edge[:, None]], 1).astype(np.float32)
    return Cuts(line, rng.choice(3, len(lines), p=_BEYOND))
