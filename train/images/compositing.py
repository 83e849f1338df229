"""What compositors of crops and of scenes share."""

from dataclasses import dataclass, field

import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from muybridge.train.images.camera_faults import CameraFaults
from muybridge.train.synthesis.rendering.store import RenderSet

# A render's side cuts something off if so many of its pixels are opaque.
_TOUCHING = 3


class BaseCompositor:
    """Renders, backgrounds and camera faults, drawn from one generator.

    Args:
        renders: people, and scenes of people and things.
        backgrounds: (N, 3, S, S) pool.
        seed: random seed.
    """

    def __init__(self, renders: RenderSet, backgrounds: ByteArray, seed: int) -> None:
        self.renders, self.backgrounds = renders, backgrounds
        self.rng = np.random.default_rng(seed)
        self.faults = CameraFaults(self.rng)
        self.is_scene = scenes_among(renders)
        # Renders with a subject; of one whole person; of scenes with a subject; and of things alone.
        self.things = renders.unattended
        self.people = np.setdiff1d(np.arange(len(renders)), self.things)
        self.scenes = np.intersect1d(self.people, np.flatnonzero(self.is_scene))
        self.whole = np.setdiff1d(renders.whole, self.scenes)

    def _corner(self, window: int) -> tuple[int, int]:
        """Random corner (x, y) of a square window of a background."""
        x, y = self.rng.integers(0, self.backgrounds.shape[-1] - window + 1, 2)
        return int(x), int(y)

    def _patch(self, number: int, corner: tuple[int, int], window: int) -> ByteArray:
        """(window, window, 3) of a background, mirrored at random."""
        x, y = corner
        patch = self.backgrounds[number, :, y : y + window, x : x + window].transpose(1, 2, 0)
        return patch[:, ::-1] if self.rng.random() < 0.5 else patch


def scenes_among(renders: RenderSet) -> BoolArray:
    """(N,) which renders show several people, or things."""
    return np.asarray(~np.isin(renders.kind, ("", "alone")))


def touched_sides(planes: ByteArray) -> BoolArray:
    """(4,) whether people or things of a render (5 or 6, H, W) continue beyond its left, top, right and bottom."""
    opaque = planes[3] > 64
    sides = opaque[:, 0], opaque[0], opaque[:, -1], opaque[-1]
    return np.array([side.sum() >= _TOUCHING for side in sides])


@dataclass(frozen=True)
class Layer:
    """A render at the size at which a scene shows it.

    Attributes:
        pixels: (h, w, 5 or 6) as of renders.
        boxes: (N, 4) of its people, pixels of the layer.
        seen: (N,) share of each that others and things of the render do not hide.
        cut: (4,) whether people or things continue beyond the left, top, right and bottom side.
    """

    pixels: ByteArray
    boxes: FloatArray
    seen: FloatArray = field(default_factory=lambda: np.ones(1))
    cut: BoolArray = field(default_factory=lambda: np.zeros(4, bool))

    def mirrored(self) -> "Layer":
        """The same with left and right exchanged."""
        boxes = self.boxes.copy()
        boxes[:, [0, 2]] = self.pixels.shape[1] - 1 - boxes[:, [2, 0]]
        return Layer(self.pixels[:, ::-1], boxes, self.seen, self.cut[[2, 1, 0, 3]])

    def at_borders(self, shift: IndexArray, height: int, width: int) -> IndexArray:
        """`shift` (2,) of the layer in a picture, changed such that cut sides are at its borders or beyond."""
        room = np.array([width, height]) - self.pixels.shape[1::-1]
        near, far = self.cut[:2], self.cut[2:]
        at_one = np.where(near, 0, room)
        at_both = np.minimum(np.clip(shift, np.minimum(room, 0), 0), 0)
        return np.where(near & far, at_both, np.where(near | far, at_one, shift)).astype(int)

    def area(self, box: FloatArray) -> int:
        """Pixels of people in a box (4,)."""
        left, top, right, bottom = np.maximum(np.round(box), 0).astype(int)
        part = self.pixels[top : bottom + 1, left : right + 1]
        opaque = part[..., 3] > 127
        return int((opaque & (part[..., 5] <= 127)).sum() if part.shape[2] > 5 else opaque.sum())


def layer_of_render(
    renders: RenderSet, index: int, side: float, shape: tuple[int, int], largest: float
) -> Layer | None:
    """A render of a scene, or of things alone, for a picture; its opposite sides are as far apart as the picture's if
    the render cuts both off.

    Args:
        renders: the store.
        index: of the render.
        side: length of the longer side of the subject's bounding box, or of the things, pixels.
        shape: height and width of the picture.
        largest: None is returned if a side would have to be longer.
    """
    planes, box = renders.pixels_of(index), renders.box_px[index]
    cut = touched_sides(planes)
    x, y, width, height = _occupied(planes)
    is_person = bool(np.isfinite(box).all())
    longer = float((box[2:] - box[:2]).max()) if is_person else float(max(width, height))
    for axis, (have, wanted) in enumerate(zip((width, height), shape[::-1], strict=True)):
        if cut[axis] and cut[axis + 2]:
            side = max(side, 1.02 * wanted / have * longer)
    if side > largest:
        return None
    pixels, scale, _ = scaled_render(renders, index, side, count=len(planes))
    known = np.isfinite(renders.others_px[index]).all(1)
    boxes = np.concatenate([box[None][: int(is_person)], renders.others_px[index][known]]).astype(float)
    boxes = (boxes - np.tile([x, y], 2) + 0.5) * scale - 0.5
    # A third of the landmarks of somebody in full view are hidden by their own body.
    own = np.minimum(1, renders.visible[index].mean(keepdims=True) / 0.6)
    seen = np.concatenate([own[: int(is_person)], renders.others_visible[index][known]])
    return Layer(pixels, boxes, seen, cut)


def _occupied(planes: ByteArray) -> tuple[int, int, int, int]:
    """Left, top, width and height of what a render shows, at least one pixel."""
    x, y, width, height = cv2.boundingRect(np.maximum(planes[3], planes[4]))
    return x, y, max(1, width), max(1, height)


def scaled_render(
    renders: RenderSet, index: int, side: float, roll: float = 0.0, count: int = 5
) -> tuple[ByteArray, float, FloatArray]:
    """The occupied part of a render.

    Args:
        renders: the store.
        index: of the render.
        side: length of the longer side of the person's bounding box, pixels.
        roll: rotation, radians.
        count: of layers: five, or six of scenes.

    Returns:
        (h, w, count) layers; the scale; and the corner (x, y) of the part in the scaled render.
    """
    planes, extent = renders.pixels_of(index)[:count], renders.box_px[index]
    x, y, width, height = _occupied(planes)
    extent = extent if np.isfinite(extent).all() else np.array([0, 0, width, height], np.float32)  # things alone
    scale = side / float((extent[2:] - extent[:2]).max())
    w, h = (max(1, round(n * scale)) for n in (width, height))
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    turn = cv2.getRotationMatrix2D(((w - 1) / 2, (h - 1) / 2), float(np.degrees(roll)), 1.0)
    across, down = (np.abs(turn[:, :2]) @ [w, h]).round().astype(int).tolist()
    turn[:, 2] += (across - w) / 2, (down - h) / 2
    small = np.empty((down, across, len(planes)), np.uint8)
    for c, plane in enumerate(planes[:, y : y + height, x : x + width]):
        resized = cv2.resize(plane, (w, h), interpolation=interpolation)
        small[..., c] = cv2.warpAffine(resized, turn, (across, down), flags=cv2.INTER_LINEAR) if roll else resized
    return small, scale, scale * np.array([x, y], float)


def extent_of(mask: BoolArray) -> FloatArray:
    """(4,) left, top, right, bottom pixels of the non-empty mask."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.min(), rows.min(), columns.max(), rows.max()], float)
