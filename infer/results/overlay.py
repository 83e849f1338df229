"""Videos with what was found drawn in: 2D keypoints dim, the 3D landmarks projected back bright.

Where the bright figure sits on the person, the cameras agree. Where it does not, the dim marks tell whether
the network was wrong (they are off the person too) or the calibration is (they are on the person, the figure
is beside them). The subject's left is warm, the right cool. A rejected 2D point is a cross.

Shapes: `T` frames, `J` landmarks.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import av
import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray
from muybridge.errors import VideoError
from muybridge.files import replacing
from muybridge.geometry.landmarks.sets import LandmarkSet, side_of

Colour = tuple[int, int, int]

# RGB. Orange and sky blue of Okabe and Ito's palette stay apart for every kind of colour vision.
LEFT: Colour = (255, 159, 28)
RIGHT: Colour = (86, 190, 255)
MIDDLE: Colour = (250, 250, 250)
REJECTED: Colour = (255, 64, 96)
DIM: Colour = (190, 190, 190)
PALE: Colour = (222, 222, 222)
DARK: Colour = (16, 16, 16)

# cv2 draws at 1/16 px with this many fractional bits.
_SHIFT = 4


Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]


@dataclass(frozen=True)
class OverlayOptions:
    """How an overlay is drawn and encoded.

    Attributes:
        crf: constant rate factor of x264, 0..51; lower is better and larger.
        preset: speed preset of x264.
        legend: whether the meaning of the marks stands at the bottom of every frame.
        thumbnail_side_px: longer side of the thumbnails.
        thumbnail_quality: JPEG quality of the thumbnails, 1..100.
    """

    crf: int = 24
    preset: Preset = "veryfast"
    legend: bool = True
    thumbnail_side_px: int = 480
    thumbnail_quality: int = 72

    def __post_init__(self) -> None:
        if not (0 <= self.crf <= 51 and 1 <= self.thumbnail_quality <= 100 and self.thumbnail_side_px >= 16):
            raise ValueError("overlays: crf is 0 to 51, thumbnail-quality 1 to 100, thumbnail-side-px 16 or more")


@dataclass(frozen=True)
class Overlay:
    """What was written.

    Attributes:
        path: the video.
        frames: number of frames in it.
        thumbnails: JPEG bytes by frame number, of the frames that were asked for.
    """

    path: Path
    frames: int
    thumbnails: dict[int, bytes] = field(default_factory=dict)


def colour_of(*names: str) -> Colour:
    """Colour of a landmark, or of a bone by the names of its ends; middle unless all agree on a side."""
    sides = {side_of(name) for name in names}
    if sides == {"left"}:
        return LEFT
    return RIGHT if sides == {"right"} else MIDDLE


def write_overlay(
    path: Path,
    frames: Iterable[ByteArray],
    fps: float,
    scale: float | tuple[float, float],
    keypoints_px: FloatArray | None,
    projected_px: FloatArray,
    landmarks: LandmarkSet,
    camera_name: str,
    residual_px: FloatArray | None = None,
    inlier: BoolArray | None = None,
    thumbnail_frames: Sequence[int] = (),
    options: OverlayOptions = OverlayOptions(),  # noqa: B008 - frozen
    others_px: Sequence[FloatArray] = (),
) -> Overlay:
    """Write `overlay_<camera>.mp4` (H.264, plays in a browser), one frame at a time in bounded memory.

    Args:
        path: the video to write; it appears under this name only when it is complete.
        frames: (H, W, 3) uint8 RGB images in order, all of one size; may be a smaller copy of the video.
        fps: frames a second of the output.
        scale: size of `frames` over the size of the original, one number or (x, y).
        keypoints_px: (T, J, 2) 2D landmarks in original pixels, NaN where missing; None if there are none.
        projected_px: (T, J, 2) 3D landmarks projected into the original image, NaN where missing.
        landmarks: names and bones of the `J` axis.
        camera_name: drawn at the top.
        residual_px: (T, J) distance of the two in original pixels; its median is drawn at the top.
        inlier: (T, J) whether the 2D landmark took part; those that did not are crosses. None: all did.
        thumbnail_frames: frames to hand back as JPEG.
        options: drawing and encoding.
        others_px: (T, J, 2) for each further person, their 3D landmarks projected; thin figures, numbered from 2.

    Returns:
        The path, the number of frames (the shorter of `frames` and T) and the thumbnails.

    Raises:
        VideoError: `frames` is empty.
        OutputError: the file cannot be written.
    """
    _check_shapes(landmarks, projected_px, keypoints_px, residual_px, inlier)
    if any(other.shape != projected_px.shape for other in others_px):
        raise ValueError(f"others_px must each have the shape of projected_px, {projected_px.shape}")

    def drawn() -> Iterator[ByteArray]:
        for t, frame in zip(range(len(projected_px)), frames, strict=False):
            yield draw_overlay(
                frame,
                t,
                fps,
                scale,
                None if keypoints_px is None else keypoints_px[t],
                projected_px[t],
                landmarks,
                camera_name,
                None if residual_px is None else residual_px[t],
                None if inlier is None else inlier[t],
                options.legend,
                [other[t] for other in others_px],
            )

    with replacing(path) as temporary:  # PyAV's own errors on files are OSErrors too
        count, thumbnails = _encode(temporary, drawn(), fps, set(thumbnail_frames), options)
        if not count:
            raise VideoError(f"{camera_name}: no frame to draw on, so {path.name} was not written")
    return Overlay(path, count, thumbnails)


def _encode(
    path: Path, images: Iterable[ByteArray], fps: float, wanted: set[int], options: OverlayOptions
) -> tuple[int, dict[int, bytes]]:
    """Write images as a video; how many there were, and those that were `wanted` as JPEG."""
    thumbnails: dict[int, bytes] = {}
    count = 0
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream: Any = None
        for t, image in enumerate(images):
            if stream is None:
                stream = _add_stream(container, image, fps, options)
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
            if t in wanted:
                thumbnails[t] = encode_thumbnail(image, options)
            count += 1
        for packet in () if stream is None else stream.encode():
            container.mux(packet)
    return count, thumbnails


def draw_overlay(
    frame: ByteArray,
    t: int,
    fps: float,
    scale: float | tuple[float, float],
    keypoints_px: FloatArray | None,
    projected_px: FloatArray,
    landmarks: LandmarkSet,
    camera_name: str,
    residual_px: FloatArray | None = None,
    inlier: BoolArray | None = None,
    legend: bool = True,
    others_px: Sequence[FloatArray] = (),
) -> ByteArray:
    """One frame of an overlay: a copy of `frame`, padded to even sides, with everything drawn in.

    Args as for `write_overlay`, without the leading `T`; `t` is the frame's number.

    Returns:
        (H, W, 3) uint8 RGB, H and W even.
    """
    # 4:2:0 video needs even sides; the repeated edge does not move any pixel.
    pad_y, pad_x = frame.shape[0] % 2, frame.shape[1] % 2
    image: ByteArray = cv2.copyMakeBorder(frame, 0, pad_y, 0, pad_x, cv2.BORDER_REPLICATE)  # type: ignore[assignment]
    unit = max(image.shape[:2]) / 960.0
    projected = _scaled(projected_px, scale)
    if keypoints_px is not None:
        kept = np.ones(len(landmarks), bool) if inlier is None else np.asarray(inlier, bool)
        _draw_keypoints(image, _scaled(keypoints_px, scale), projected, kept, unit)
    others = [_scaled(other, scale) for other in others_px]
    for other in others:
        _draw_figure(image, other, landmarks, unit, thickness=0.5)
    _draw_figure(image, projected, landmarks, unit)
    if others:
        for number, figure in enumerate([projected, *others], start=1):
            _draw_number(image, number, figure, unit)
    _draw_caption(image, t, fps, camera_name, projected, residual_px, unit)
    if legend:
        _draw_legend(image, unit, keypoints_px is not None)
    return image


def encode_thumbnail(image: ByteArray, options: OverlayOptions = OverlayOptions()) -> bytes:  # noqa: B008 - frozen
    """JPEG of an RGB image, shrunk to `options.thumbnail_side_px`."""
    factor = options.thumbnail_side_px / max(image.shape[:2])
    if factor < 1.0:
        image = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    quality = [cv2.IMWRITE_JPEG_QUALITY, options.thumbnail_quality]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), quality)
    if not done:
        raise ValueError(f"not an image that JPEG can hold: shape {image.shape}, {image.dtype}")
    return data.tobytes()


def _check_shapes(
    landmarks: LandmarkSet,
    projected_px: FloatArray,
    keypoints_px: FloatArray | None,
    residual_px: FloatArray | None,
    inlier: BoolArray | None,
) -> None:
    expected = (len(projected_px), len(landmarks))
    for name, array, shape in (
        ("projected_px", projected_px, (*expected, 2)),
        ("keypoints_px", keypoints_px, (*expected, 2)),
        ("residual_px", residual_px, expected),
        ("inlier", inlier, expected),
    ):
        if array is not None and array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape} (T, J, ...)")


def _add_stream(container: Any, image: ByteArray, fps: float, options: OverlayOptions) -> Any:
    rate = Fraction(fps).limit_denominator(1001)
    stream = container.add_stream("libx264", rate=rate)
    stream.height, stream.width = image.shape[:2]
    stream.pix_fmt = "yuv420p"
    # A keyframe twice a second: scrubbing in a browser stays quick.
    stream.options = {"crf": str(options.crf), "preset": options.preset, "g": str(max(1, round(fps / 2)))}
    return stream


def _scaled(points_px: FloatArray, scale: float | tuple[float, float]) -> FloatArray:
    """Original pixels to pixels of the smaller copy; both have (0, 0) at the centre of the top-left pixel."""
    return (np.asarray(points_px, np.float64) + 0.5) * np.asarray(scale, np.float64) - 0.5


def _fixed(point: FloatArray) -> tuple[int, int] | None:
    """A point in cv2's fixed-point coordinates; None if missing or so far off that cv2 would overflow."""
    if not np.all(np.isfinite(point)) or np.abs(point).max() > 1e5:
        return None
    return round(float(point[0]) * (1 << _SHIFT)), round(float(point[1]) * (1 << _SHIFT))


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
    # Dark edges first, for all bones: they keep the figure legible on any background.
    for a, b, _ in bones:
        _line(image, a, b, DARK, 5.0 * width)
    for a, b, names in bones:
        _line(image, a, b, colour_of(*names), 2.6 * width)
    for point, name in zip(points, landmarks.names, strict=True):
        _circle(image, point, 4.2 * width, DARK, -1)
        _circle(image, point, 3.0 * width, colour_of(name), -1)


def _draw_number(image: ByteArray, number: int, points: FloatArray, unit: float) -> None:
    """A person's number above the highest of their points in the image."""
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


def _shade(image: ByteArray, top: int, bottom: int) -> None:
    """Darken a band of rows, so that text on it is legible on any picture."""
    band = image[max(top, 0) : bottom]
    band[:] = (band * 0.3).astype(np.uint8)


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
