"""People of whom a camera sees only a part: at a desk, too near, leaving the image. Their crops frame that part."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.train.synthesis.rendering.view import View, direction_from_angles, look_at, target_of_pixel

# What lies beyond the cut: the black outside of the video, an object in front of the person, or the person after all.
BORDER, OCCLUDER, PERSON = range(3)
_BEYOND = (0.65, 0.2, 0.15)
# Side that is cut off: bottom, left, right, top.
_NORMALS = np.array([[0.0, 1.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -1.0]])
_SIDES = (0.6, 0.11, 0.11, 0.18)
_VISIBLE = (0.3, 0.85)  # range of the visible share of the box
_VISIBLE_NEAR = (0.22, 0.75)  # the same for rendered close-ups
_NEAREST = 0.15  # least depth in metres of points that count for a person's bounding box


@dataclass(frozen=True)
class Cuts:
    """Where people are cut off.

    Attributes:
        line: (B, 3) nx, ny, edge in crop pixels: beyond the cut nx x + ny y > edge; NaN where nothing is cut off.
        beyond: (B,) BORDER, OCCLUDER or PERSON.
    """

    line: Float32Array
    beyond: IntArray

    def mask(self, i: int, size: int) -> BoolArray:
        """(size, size) pixels of crop `i` beyond its cut."""
        y, x = np.mgrid[:size, :size].astype(np.float32)
        nx, ny, edge = self.line[i]
        return np.asarray(nx * x + ny * y > edge)

    def chosen(self, beyond: int) -> IndexArray:
        """Crops with a cut of that kind."""
        return np.flatnonzero(np.isfinite(self.line[:, 0]) & (self.beyond == beyond))

    def hidden(self, landmarks: Float32Array) -> BoolArray:
        """(B, J) whether a cut hides landmarks (B, J, 2)."""
        is_cut = np.isfinite(self.line[:, 0]) & (self.beyond != PERSON)
        beyond_edge = np.einsum("bjk,bk->bj", landmarks, self.line[:, :2]) > self.line[:, 2:]
        return np.asarray(beyond_edge & is_cut[:, None])


def cut_boxes(
    rng: np.random.Generator,
    box_px: Float32Array,
    share: float,
    made: Float32Array | None = None,
    visible: tuple[float, float] = _VISIBLE,
) -> tuple[Float32Array, Float32Array]:
    """Cut off people at random.

    Args:
        rng: source of random numbers.
        box_px: (B, 4) bounding boxes.
        share: of the people to cut off.
        made: (B, 3) existing cuts, which stay; NaN where there is none.
        visible: range of the visible share of a box.

    Returns:
        Boxes (B, 4) of the visible parts, and lines (B, 3) as in `Cuts`, both in the pixels of `box_px`.
    """
    boxes, lines = box_px.copy(), np.full((len(box_px), 3), np.nan, np.float32)
    if made is not None:
        lines[:] = made
    for i in np.flatnonzero((rng.random(len(boxes)) < share) & np.isnan(lines[:, 0])):
        side, share_visible = int(rng.choice(4, p=_SIDES)), rng.uniform(*visible)
        left, top, right, bottom = boxes[i]
        if side == 0:
            boxes[i, 3] = edge = top + share_visible * (bottom - top)
        elif side == 1:
            boxes[i, 0] = edge = right - share_visible * (right - left)
        elif side == 2:
            boxes[i, 2] = edge = left + share_visible * (right - left)
        else:
            boxes[i, 1] = edge = bottom - share_visible * (bottom - top)
        lines[i] = *_NORMALS[side], edge * _NORMALS[side].sum()
    return boxes, lines


def map_cuts(rng: np.random.Generator, lines: Float32Array, matrix: Float32Array, made: BoolArray) -> Cuts:
    """Map cuts into crops and choose what lies beyond them.

    Args:
        rng: source of random numbers.
        lines: (B, 3) of `cut_boxes`.
        matrix: (B, 2, 3) affine maps into crops.
        made: (B,) whether the render is a close-up, which ends somewhere beyond its line, so that the person cannot lie
            beyond it.
    """
    normal = np.einsum("bji,bj->bi", np.linalg.inv(matrix[:, :, :2].astype(np.float64)), lines[:, :2])
    edge = lines[:, 2] + np.einsum("bi,bi->b", normal, matrix[:, :, 2])
    line = np.concatenate([normal, edge[:, None]], 1).astype(np.float32)
    beyond = rng.choice(3, len(lines), p=_BEYOND)
    return Cuts(line, np.where(made & (beyond == PERSON), BORDER, beyond))


class CloseUp(NamedTuple):
    """A view of part of a person.

    Attributes:
        view: the camera.
        box_px: (4,) left, top, right, bottom of that part.
        cut_px: (3,) where it is cut off, see `Cuts`.
    """

    view: View
    box_px: Float32Array
    cut_px: Float32Array


def sample_close_up(body: Float32Array, rng: np.random.Generator, size: int, span: float) -> CloseUp:
    """A camera without roll near a part of a person, as webcams on desks and tripods are.

    Args:
        body: (V, 3) metres.
        rng: source of random numbers.
        size: of the image, px.
        span: `size` relative to the longer side of the visible part.
    """
    points = body.astype(np.float64)
    azimuth, elevation = rng.uniform(0, 2 * np.pi), np.radians(np.clip(rng.normal(5, 13), -25, 50))
    direction = direction_from_angles(azimuth, elevation)
    # The part is chosen in the view of a distant camera.
    flat = points @ look_at(points.mean(0) + direction, points.mean(0))[:2, :3].T
    whole = np.concatenate([flat.min(0), flat.max(0)]).astype(np.float32)
    _, lines = cut_boxes(rng, whole[None], 1.0, None, _VISIBLE_NEAR)
    normal = lines[0, :2].astype(np.float64)
    part = points[flat @ normal <= lines[0, 2]]
    target = (part.min(0) + part.max(0)) / 2
    reach = float(np.linalg.norm(part - target, axis=1).max())
    distance = max(0.45, reach * float(np.exp(rng.uniform(np.log(1.7), np.log(8.0)))))
    eye = target + distance * direction
    eye[2] = max(eye[2], 0.05)
    middle, focal, roll = (size - 1) / 2, float(size), np.radians(rng.normal(0, 3))
    for _ in range(4):  # the centre of the part moves slightly as the camera turns to it
        view = View(look_at(eye, target, roll), focal, (middle, middle), size, size)
        box, _ = _box_of(view, points, part, normal)
        target = target_of_pixel(view, (box[:2] + box[2:]) / 2, eye, distance)
        focal *= size / (span * float((box[2:] - box[:2]).max()))
    view = View(look_at(eye, target, roll), focal, (middle, middle), size, size)
    box, edge = _box_of(view, points, part, normal)
    return CloseUp(view, box.astype(np.float32), np.array([*normal, edge], np.float32))


def _box_of(view: View, points: FloatArray, part: FloatArray, normal: FloatArray) -> tuple[FloatArray, float]:
    """The bounding box (4,) of those `points` that do not lie beyond the farthest of `part` along `normal`, and that
    edge."""
    px, depth_m = view.project(part)
    edge = float((px[depth_m > _NEAREST] @ normal).max())
    px, depth_m = view.project(points)
    px = px[(depth_m > _NEAREST) & (px @ normal <= edge)]
    return np.concatenate([px.min(0), px.max(0)]), edge
