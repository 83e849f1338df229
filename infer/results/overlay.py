"""Videos with 2D landmarks and the projected 3D landmarks overlaid."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import av
import cv2
import numpy as np

from muybridge.arrays import ByteArray
from muybridge.errors import VideoError
from muybridge.files import replacing
from muybridge.infer.results.overlay_drawing import OverlayData, draw_overlay

Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]


@dataclass(frozen=True)
class OverlayOptions:
    """How an overlay is drawn and encoded.

    Attributes:
        crf: constant rate factor of x264, 0..51; lower is better and larger.
        preset: speed preset of x264.
        legend: whether the marks are explained at the bottom of every frame.
        thumbnail_side_px: longer side of the thumbnails.
        thumbnail_quality: JPEG quality of the thumbnails, 1..100.
    """

    crf: int = 24
    preset: Preset = "superfast"
    legend: bool = True
    thumbnail_side_px: int = 480
    thumbnail_quality: int = 72

    def __post_init__(self) -> None:
        if not (0 <= self.crf <= 51 and 1 <= self.thumbnail_quality <= 100 and self.thumbnail_side_px >= 16):
            raise ValueError("overlays: crf is 0 to 51, thumbnail-quality 1 to 100, thumbnail-side-px 16 or more")


@dataclass(frozen=True)
class Overlay:
    """An overlay that was written.

    Attributes:
        path: the video.
        frames: number of frames in it.
        thumbnails: JPEG bytes by frame number.
    """

    path: Path
    frames: int
    thumbnails: dict[int, bytes] = field(default_factory=dict)


def write_overlay(
    path: Path,
    frames: Iterable[ByteArray],
    scale: float | tuple[float, float],
    data: OverlayData,
    thumbnail_frames: Sequence[int] = (),
    options: OverlayOptions = OverlayOptions(),  # noqa: B008 - frozen
) -> Overlay:
    """Write `overlay_<camera>.mp4` (H.264, plays in a browser), one frame at a time in bounded memory.

    Args:
        path: the video to write, atomically.
        frames: (H, W, 3) uint8 RGB images in order, all of one size; may be a smaller copy of the video.
        scale: size of `frames` over the size of the original, one number or (x, y).
        data: what is drawn.
        thumbnail_frames: frames to return as JPEG.
        options: drawing and encoding.

    Returns:
        The path, the number of frames (the smaller of `frames` and T) and the thumbnails.

    Raises:
        VideoError: `frames` is empty.
        OutputError: the file cannot be written.
    """

    def drawn() -> Iterator[ByteArray]:
        for t, frame in zip(range(len(data.projected_px)), frames, strict=False):
            yield draw_overlay(frame, t, scale, data, options.legend)

    with replacing(path) as temporary:  # PyAV's own errors on files are OSErrors too
        count, thumbnails = _encode(temporary, drawn(), data.fps, set(thumbnail_frames), options)
        if not count:
            raise VideoError(f"{data.camera_name}: no frame to draw on, so {path.name} was not written")
    return Overlay(path, count, thumbnails)


def _encode(
    path: Path, images: Iterable[ByteArray], fps: float, wanted: set[int], options: OverlayOptions
) -> tuple[int, dict[int, bytes]]:
    """Write images as a video; the number of images, and the `wanted` ones as JPEG."""
    thumbnails: dict[int, bytes] = {}
    count = 0
    with av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as container:
        stream: Any = None
        for t, image in enumerate(images):
            if stream is None:
                stream = _add_stream(container, image, fps, options)
            # OpenCV converts colours several times as fast as the encoder's library does.
            planes = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420), dtype=np.uint8)
            for packet in stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")):
                container.mux(packet)
            if t in wanted:
                thumbnails[t] = encode_thumbnail(image, options)
            count += 1
        for packet in () if stream is None else stream.encode():
            container.mux(packet)
    return count, thumbnails


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


def _add_stream(container: Any, image: ByteArray, fps: float, options: OverlayOptions) -> Any:
    rate = Fraction(fps).limit_denominator(1001)
    stream = container.add_stream("libx264", rate=rate)
    stream.height, stream.width = image.shape[:2]
    stream.pix_fmt = "yuv420p"
    # x264's rate control depends on the number of its threads, and with it the bytes of equal runs.
    stream.codec_context.thread_count = 1
    # A keyframe twice a second: scrubbing in a browser stays quick.
    # x264's macroblock tree reads beyond its arrays on processors with AVX-512: bytes of equal runs would differ.
    stream.options = {"crf": str(options.crf), "preset": options.preset, "g": str(max(1, round(fps / 2))),
                      "x264-params": "mbtree=0"}  # fmt: skip
    return stream
