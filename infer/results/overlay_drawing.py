"""One frame of an overlay: 2D landmarks dim, the projected 3D landmarks bright.

Where the bright figure lies on the person, the cameras agree. Where it does not, the dim marks tell whether the 2D
landmarks are wrong (they are off the person too) or the calibration is (they are on the person, the figure is not).
The subject's left is warm, the right cool. A rejected 2D landmark is a cross.

Shapes: `T` frames, `J` landmarks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray
from muybridge.geometry.landmarks.sets import LandmarkSet, side_of
from muybridge.infer.report.templates import SIDES_ON_DARK

Colour = tuple[int, int, int]


def _rgb(hexadecimal: str) -> Colour:
    red, green, blue = bytes.fromhex(hexadecimal.removeprefix("#"))
    return red, green, blue


LEFT, RIGHT = (_rgb(SIDES_ON_DARK[side]) for side in ("left", "right"))
MIDDLE: Colour = (250, 250, 250)
REJECTED: Colour = (255, 64, 96)
DIM: Colour = (190, 190, 190)
PALE: Colour = (222, 222, 222)
DARK: Colour = (16, 16, 16)

# cv2 draws at 1/16 px with this many fractional bits.
_SHIFT = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class OverlayData:
    """What is drawn into one camera's video.

    Attributes:
        camera_name: drawn at the top.
        fps: frames per second of the take.
        landmarks: names and bones of the `J` axis.
        projected_px: (T, J, 2) 3D landmarks projected into the original image, NaN where missing.
        keypoints_px: (T, J, 2) 2D landmarks in original pixels, NaN where missing; None if there are none.
        residual_px: (T, J) distance of the two in original pixels; its median is drawn at the top.
        inlier: (T, J) whether the 2D landmark took part; the others are crosses. None: all did.
        others_px: (T, J, 2) projected 3D landmarks of each further person: thin figures, numbered from 2.

    Raises:
        ValueError: arrays do not fit each other.
    """

    camera_name: str
    fps: float
    landmarks: LandmarkSet
    projected_px: FloatArray
    keypoints_px: FloatArray | None = None
    residual_px: FloatArray | None = None
    inlier: BoolArray | None = None
    others_px: Sequence[FloatArray] = ()

    def __post_init__(self) -> None:
        expected = (len(self.projected_px), len(self.landmarks))
        for name, array, shape in (
            ("projected_px", self.projected_px, (*expected, 2)),
            ("keypoints_px", self.keypoints_px, (*expected, 2)),
            ("residual_px", self.residual_px, expected),
            ("inlier", self.inlier, expected),
            *((f"others_px[{n}]", other, (*expected, 2)) for n, other in enumerate(self.others_px)),
        ):
            if array is not None and array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected {shape} (T, J, ...)")


@cache
def colour_of(*names: str) -> Colour:
    """Colour of a landmark, or of a bone by the names of its ends; middle unless all agree on a side."""
    sides = {side_of(name) for name in names}
    if sides == {"left"}:
        return LEFT
    return RIGHT if sides == {"right"} else MIDDLE


def draw_overlay(
    frame: ByteArray, t: int, scale: float | tuple[float, float], data: OverlayData, legend: bool = True
) -> ByteArray:
    """One frame of an overlay.

    Args:
        frame: (H, W, 3) uint8 RGB.
        t: its number.
        scale: size of `frame` over the size of the original, one number or (x, y).
        data: what to draw.
        legend: whether the meaning of the marks is drawn at the bottom.

    Returns:
        (H, W, 3) uint8 RGB: a copy, H and W padded to even numbers.
    """
    # 4:2:0 video needs even sides; the repeated edge does not move any pixel.
    pad_y, pad_x = frame.shape[0] % 2, frame.shape[1] % 2
    image: ByteArray = cv2.copyMakeBorder(frame, 0, pad_y, 0, pad_x, cv2.BORDER_REPLICATE)  # type: ignore[assignment]
    unit = max(image.shape[:2]) / 960.0
    projected = _scaled(data.projected_px[t], scale)
    landmarks, residual_px = data.landmarks, None if data.residual_px is None else data.residual_px[t]
    if data.keypoints_px is not None:
        kept = np.ones(len(landmarks), bool) if data.inlier is None else np.asarray(data.inlier[t], bool)
        _draw_keypoints(image, _scaled(data.keypoints_px[t], scale), projected, kept, unit)
    others = [_scaled(other[t], scale) for other in data.others_px]
    for other in others:
        _draw_figure(image, other, landmarks, unit, thickness=0.5)
    _draw_figure(image, projected, landmarks, unit)
    if others:
        for number, figure in enumerate([projected, *others], start=1):
            _draw_number(image, number, figure, unit)
    _draw_caption(image, t, data.fps, data.camera_name, projected, residual_px, unit)
    if legend:
        _draw_legend(image, unit, data.keypoints_px is not None)
    return image


def _scaled(points_px: FloatArray, scale: float | tuple[float, float]) -> FloatArray:
    """Original pixels to pixels of the smaller copy; both have (0, 0) at the centre of the top-left pixel."""
    return (np.asarray(points_px, np.float64) + 0.5) * np.asarray(scale, np.float64) - 0.5


def _fixed(point: FloatArray) -> tuple[int, int] | None:
    """A point in cv2's fixed-point coordinates; None if missing or too far outside for cv2."""
    x, y = float(point[0]), float(point[1])
    if not (abs(x) <= 1e5 and abs(y) <= 1e5):  # NaN too; a call of numpy for two numbers takes ten times as long
        return None
    return round(x * (1 << _SHIFT)), round(y * (1 << _SHIFT))


def _line(image: ByteArray, a: FloatArray, b: FloatArray, colour: Colour, width: float) -> None:
    start, end = _fixed(a), _fixed(b)
    if start is not None and end is not None:
        cv2.line(image, start, end, colour, max(1, round(width)), cv2.LINE_AA, _SHIFT)


def _circle(image: ByteArray, centre: FloatArray, radius: float, colour: Colour, width: float) -> None:
    at = _fixed(centre)
    if at is not None:
        thickness = -1 if width < 0 else max(1, round(width))
        cv2.circle(image, at, round(radius * (1 << _SHIFT)), colour, thickness, cv2.LINE_AA, _SHIFT)


def _draw_keypoints(image: ByteArray, points: FloatArray, projected: FloatArray, kept: BoolArray, unit: float) -> None:
    for point, target, is_kept in zip(points, projected, kept, strict=True):
        if is_kept:
            _line(image, point, target, DIM, unit)
            _circle(image, point, 4.5 * unit, DARK, 2.5 * unit)
            _circle(image, point, 4.5 * unit, DIM, unit)
            continue
        arm = 5.0 * unit
        for colour, width in ((DARK, 4.0 * unit), (REJECTED, 2.0 * unit)):
            _line(image, point - arm, point + arm, colour, width)
            _line(image, point + [-arm, arm], point + [arm, -arm], colour, width)


def _draw_figure(
    image: ByteArray, points: FloatArray, landmarks: LandmarkSet, unit: float, thickness: float = 1.0
) -> None:
    bones = [(points[a], points[b], (landmarks.names[a], landmarks.names[b])) for a, b in landmarks.edge_indices]
    width = unit * thickness
    # Dark outlines first, for all bones: they keep the figure visible on any background.
    for a, b, _ in bones:
        _line(image, a, b, DARK, 5.0 * width)
    for a, b, names in bones:
        _line(image, a, b, colour_of(*names), 2.6 * width)
    for point, name in zip(points, landmarks.names, strict=True):
        _circle(image, point, 4.2 * width, DARK, -1)
        _circle(image, point, 3.0 * width, colour_of(name), -1)


def _draw_number(image: ByteArray, number: int, points: FloatArray, unit: float) -> None:
    """A person's number above their highest point in the image."""
    seen = points[np.isfinite(points).all(-1)]
    if not len(seen):
        return
    size = max(12.0, 22.0 * unit)
    x, y = seen[seen[:, 1].argmin()]
    at = round(float(x) - 0.3 * size), round(float(y) - 1.2 * size)
    if -size < at[0] < image.shape[1] and 0 < at[1] < image.shape[0] + size:
        step = max(1, round(size / 12.0))
        for dx, dy in ((-step, 0), (step, 0), (0, -step), (0, step)):
            _text(image, str(number), (at[0] + dx, at[1] + dy), size, DARK)
        _text(image, str(number), at, size)


def _text(image: ByteArray, text: str, at: tuple[int, int], size: float, colour: Colour = MIDDLE) -> int:
    """Text of about `size` px in height, `at` its lower left corner; its width."""
    font, height = cv2.FONT_HERSHEY_SIMPLEX, size / 22.0
    width = max(1, round(size / 14.0))
    cv2.putText(image, text, at, font, height, colour, width, cv2.LINE_AA)
    return int(cv2.getTextSize(text, font, height, width)[0][0])


_SHADES = (np.arange(256) * 0.3).astype(np.uint8)


def _shade(image: ByteArray, top: int, bottom: int) -> None:
    """Darken a band of rows, so that text on it is legible on any image."""
    band = image[max(top, 0) : bottom]
    if band.size:
        cv2.LUT(band, _SHADES, dst=band)


def _draw_caption(
    image: ByteArray, t: int, fps: float, name: str, projected: FloatArray, residual_px: FloatArray | None, unit: float
) -> None:
    size = max(11.0, 20.0 * unit)
    margin = round(0.6 * size)
    _shade(image, 0, margin + round(2.5 * size))
    _text(image, f"{name}   frame {t}   {t / fps:.2f} s", (margin, margin + round(0.8 * size)), size)
    found = int(np.isfinite(projected).all(axis=-1).sum())
    parts = [f"{found} of {len(projected)} landmarks"]
    if residual_px is not None and np.isfinite(residual_px).any():
        parts.append(f"median residual {float(np.nanmedian(residual_px)):.1f} px")
    _text(image, "   ".join(parts), (margin, margin + round(2.0 * size)), 0.8 * size, PALE)


def _draw_legend(image: ByteArray, unit: float, with_keypoints: bool) -> None:
    size = max(10.0, 16.0 * unit)
    x, y = round(0.9 * size), image.shape[0] - round(0.7 * size)
    _shade(image, image.shape[0] - round(2.0 * size), image.shape[0])
    entries: list[tuple[str, Colour, str]] = [("subject's left", LEFT, "dot"), ("right", RIGHT, "dot")]
    if with_keypoints:
        entries += [("2D", DIM, "ring"), ("2D, left out", REJECTED, "cross")]
    for label, colour, mark in entries:
        centre = np.array([x, y - 0.35 * size])
        if mark == "cross":
            arm = 0.3 * size
            _line(image, centre - arm, centre + arm, colour, size / 8)
            _line(image, centre + [-arm, arm], centre + [arm, -arm], colour, size / 8)
        else:
            _circle(image, centre, 0.36 * size, colour, -1 if mark == "dot" else size / 10)
        x += round(0.8 * size)
        x += _text(image, label, (x, y), size) + round(1.3 * size)
