"""Adaptation of calibrated cameras to videos of another size.

Between the calibration and the video, the image may have been scaled, padded, cropped or rotated. `fit_to_video`
decides by these rules, in order:

1. The size is the same: nothing changes.
2. The shape is the calibrated one rotated by a quarter turn (1920x1080 and 1080x1920): the direction cannot be derived
   from the sizes, so this is an error that names the two choices.
3. The shape is the calibrated one up to the rounding of the sizes: the image was resized.
4. Otherwise the shapes differ, and an image of the video (its first frame, if the caller has it) is examined: black
   bars exactly where scaling the whole image into the frame leaves them indicate a letterbox; image content there
   excludes one.
5. A letterbox is excluded: if the calibrated size is the video's size rounded up to a multiple of 16 (1088 for 1080),
   the calibration used frames with the codec's padding, which is at the right and bottom: crop-corner. Otherwise the
   image fills the frame and was cropped around its centre: fill. If one side has kept its length, this is a plain crop.
6. No image, or a dark one: shapes that differ by 2 % or less are treated as a letterbox, because transcoders with a
   given frame size fit the whole image into it; shapes that differ more are treated as fill, because cameras switch
   between their own modes (4:3 and 16:9) this way.

The assumption is reported in one sentence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import CalibrationError
from muybridge.geometry.cameras.camera import Camera

VideoFit = Literal["auto", "scale", "letterbox", "fill", "crop", "crop-corner", "rotate-cw", "rotate-ccw"]
"""Operation that turned the calibrated image into the video's:

- ``auto``: decide by the rules of this module.
- ``scale``: resized to the video's size, each side by its own factor.
- ``letterbox``: scaled by one factor so that the whole image fits in, centred; bars fill the rest.
- ``fill``: scaled by one factor so that no bars are left, centred; the excess was cropped.
- ``crop``: not scaled; the video is the middle of the image (or the image the middle of the video).
- ``crop-corner``: not scaled; the top-left corner was kept (the codec's padding was cropped, or added).
- ``rotate-cw``, ``rotate-ccw``: rotated by 90 degrees clockwise or counterclockwise, then as ``auto``; cameras whose
  shape is not rotated are not changed.
"""

_UNROTATED: tuple[VideoFit, ...] = ("scale", "letterbox", "fill", "crop", "crop-corner")


@dataclass(frozen=True)
class FitAssumption:
    """What `fit_to_video` assumed about the relation between the calibrated image and the video.

    Attributes:
        fit: the operation that was chosen, one of `VideoFit`.
        sentence: the sizes, the operation and the reason, in one line.
    """

    fit: VideoFit
    sentence: str

    @property
    def alternatives(self) -> tuple[VideoFit, ...]:
        """The operations that could have been meant instead."""
        return tuple(fit for fit in _UNROTATED if fit != self.fit)


# Encoders prefer even sizes, so a proportional resize may deviate by up to two pixels per side.
_ROUNDING_PX = 2.0
_SIMILAR_SHAPE = 0.02
_CODEC_BLOCK_PX = 16
# Usual scale factors of videos.
_RESIZED = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 1.0, 3 / 2, 2.0, 3.0, 4.0)
# Video black is 16, and compression artefacts reach into thin bars.
_BLACK = 32


def guess_calibrated_size(camera: Camera, width: int, height: int) -> Camera:
    """The camera with the most likely size of the calibrated image, without any other change.

    For a camera whose size was guessed from its principal point: the usual scale of a video of `width` x `height` px
    that is nearest to the guess.
    """
    if _is_rotated(camera, width, height):
        return camera
    guess = np.sqrt(camera.width / width * (camera.height / height))
    factor = min(_RESIZED, key=lambda f: abs(np.log(guess / f)))
    return replace(camera, width=round(factor * width), height=round(factor * height))


def fit_to_video(
    camera: Camera, width: int, height: int, how: VideoFit = "auto", image: NDArray[Any] | None = None
) -> tuple[Camera, FitAssumption | None]:
    """Adapt a camera to a video of `width` x `height` px.

    Args:
        camera: the calibrated camera.
        width: of the decoded video frames, px.
        height: of the decoded video frames, px.
        how: what happened to the image; see `VideoFit` and this module's docstring.
        image: (height, width) or (height, width, 3) uint8, a frame of the video, examined by ``auto`` for black bars
            when the shapes differ.

    Returns:
        The adapted camera, and what was assumed (None if nothing was).

    Raises:
        CalibrationError: the video seems rotated by 90 degrees and `how` is ``auto``.
        ValueError: `how` is none of `VideoFit`, a size is not positive, or the image has another size.
    """
    if how not in get_args(VideoFit):
        raise ValueError(f"how must be one of {', '.join(get_args(VideoFit))}, not {how!r}")
    if width <= 0 or height <= 0:
        raise ValueError(f"video size {width}x{height} is not positive")
    if image is not None and image.shape[:2] != (height, width):
        raise ValueError(f"the image is {image.shape[1]}x{image.shape[0]}, the video {width}x{height}")
    if how in ("rotate-cw", "rotate-ccw"):
        return _fit_rotated(camera, width, height, how, image)
    if how != "auto":
        return _apply_fit(camera, width, height, how), None
    if (width, height) == (camera.width, camera.height):
        return camera, None
    sizes = f"camera {camera.name}: calibrated at {camera.width}x{camera.height}, video is {width}x{height}"
    if _is_rotated(camera, width, height):
        raise CalibrationError(
            f"{sizes}, the same shape rotated by 90 degrees; the direction of the rotation is unknown",
            remedy="video_rotated",
        )
    chosen, why = _decide(camera, width, height, image)
    return _apply_fit(camera, width, height, chosen), FitAssumption(chosen, f"{sizes}; {why} ({chosen})")


def _fit_rotated(
    camera: Camera, width: int, height: int, how: VideoFit, image: NDArray[Any] | None
) -> tuple[Camera, FitAssumption | None]:
    """Rotate the camera, unless its shape shows that its image was not rotated."""
    if camera.width != camera.height and not _is_rotated(camera, width, height):
        return fit_to_video(camera, width, height, "auto", image)
    try:
        turned = camera.turned(1 if how == "rotate-cw" else -1)
    except ValueError as error:
        raise CalibrationError(f"camera {camera.name}: {error}; calibrate with the camera as it records") from None
    return fit_to_video(turned, width, height, "auto", image)


def _apply_fit(camera: Camera, width: int, height: int, how: str) -> Camera:
    """The camera after one specific operation."""
    if how == "scale":
        return camera.resized(width, height)
    factors = width / camera.width, height / camera.height
    scale = {"letterbox": min(factors), "fill": max(factors)}.get(how, 1.0)
    offset = (0.0, 0.0)
    if how != "crop-corner":
        offset = (width - scale * camera.width) / 2, (height - scale * camera.height) / 2
        if how == "crop":  # windows begin at a whole pixel
            offset = float(np.floor(offset[0])), float(np.floor(offset[1]))
    return camera.resampled(width, height, (scale, scale), offset)


def _same_shape(calibrated: tuple[int, int], width: int, height: int) -> bool:
    """Whether one factor relates the two sizes, up to the rounding of the video's size."""
    factors = width / calibrated[0], height / calibrated[1]
    return any(
        abs(f * calibrated[0] - width) < _ROUNDING_PX and abs(f * calibrated[1] - height) < _ROUNDING_PX
        for f in factors
    )


def _is_rotated(camera: Camera, width: int, height: int) -> bool:
    """Whether the video's shape is the calibrated one rotated by 90 degrees, approximately."""
    shape, video = camera.width / camera.height, width / height
    if _same_shape((camera.width, camera.height), width, height) or (shape - 1) * (video - 1) >= 0:
        return False
    return abs(shape * video - 1) <= _SIMILAR_SHAPE


def _decide(camera: Camera, width: int, height: int, image: NDArray[Any] | None) -> tuple[VideoFit, str]:
    """Operation and reason, for sizes that differ and are not rotated."""
    if _same_shape((camera.width, camera.height), width, height):
        return "scale", f"the shape is the same: taken as resized by {width / camera.width:.4g}"
    scale = min(width / camera.width, height / camera.height)
    bars = None if image is None else _has_bars(camera, image)
    if bars:
        return "letterbox", f"black bars show that the whole image was scaled by {scale:.4f} and centred"
    if bars is False:
        if _is_codec_padding(camera.width, width) and _is_codec_padding(camera.height, height):
            return (
                "crop-corner",
                "taken as the codec's padding to a multiple of 16, cut at the right and bottom",
            )
        if width == camera.width or height == camera.height:
            return "fill", "no black bars, and one side is the same: taken as the middle of the image"
        return "fill", (
            f"no black bars: taken as scaled by {max(width / camera.width, height / camera.height):.4f} and "
            "cut to the middle"
        )
    shape = (width / height) / (camera.width / camera.height)
    if abs(np.log(shape)) <= _SIMILAR_SHAPE:
        return "letterbox", f"taken as the whole image, scaled by {scale:.4f} and centred between thin bars"
    return "fill", "the shapes differ much: taken as another mode of the camera, cut to the middle"


def _is_codec_padding(calibrated: int, video: int) -> bool:
    return calibrated == video or calibrated == -(-video // _CODEC_BLOCK_PX) * _CODEC_BLOCK_PX


def _has_bars(camera: Camera, image: NDArray[Any]) -> bool | None:
    """Whether the image has the bars of a letterbox; None if it is too dark there to decide.

    A bar must be black over nearly all of its rows (or columns) at both ends, and the image beside it must not be.
    """
    height, width = image.shape[:2]
    scale = min(width / camera.width, height / camera.height)
    # Lines run along the bars: rows for bars at the top and bottom, columns for bars at the sides.
    lines = image if scale * camera.width > width - 1 else np.swapaxes(image, 0, 1)
    length = camera.height if lines is image else camera.width
    thickness = int((lines.shape[0] - scale * length) / 2)
    if thickness < 1:
        return None

    def brightness(part: NDArray[Any]) -> float:
        # Nearly all of a line must be black, but not all of it: captions and artefacts reach into bars.
        return float(np.median(np.percentile(part.reshape(part.shape[0], -1), 95, axis=1)))

    if max(brightness(lines[:thickness]), brightness(lines[-thickness:])) > _BLACK:
        return False
    first = lines[thickness + 1 : 2 * thickness + 9]
    last = lines[-2 * thickness - 9 : -thickness - 1]
    return True if max(brightness(first), brightness(last)) > _BLACK else None
