"""The background of a static camera's video, and how each frame differs from it.

The person detector and the keypoint network both take the difference as input: it separates moving people from
objects that only look like them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IndexArray
from muybridge.geometry.cameras.crops import Crops
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.detection.crop_pixels import extract_crops
from muybridge.infer.detection.orientation import Letterbox

_T = TypeVar("_T", bound=np.integer)

# With fewer frames than this the background is unknown.
_PLATE_MIN_FRAMES = 3
# Exposure is compared on every n-th pixel that is neither dark nor saturated; on at least so many, which agree within
# this share.
_STRIDE, _DARK, _BRIGHT, _LEAST_PIXELS, _AGREEMENT = 5, 20, 235, 200, 0.08
# Thickness of people, in longer sides of their landmarks' own box: limbs, and the disc around each landmark.
_LIMB, _JOINT, _HEAD = 0.13, 0.05, 0.1


class BackgroundPlate:
    """The median over frames spaced evenly in time: what a static camera sees without moving people.

    At most `max_frames` frames are kept; when there are more, every other one is dropped and the spacing doubles.
    Someone who hardly moves becomes part of the plate; the detector is trained to work without it as well.
    """

    def __init__(self, max_frames: int = 25) -> None:
        if max_frames < _PLATE_MIN_FRAMES:
            raise ValueError(f"max_frames must be at least {_PLATE_MIN_FRAMES}")
        self._max_frames = max_frames
        self._kept: list[ByteArray] = []
        self._spacing = 1
        self._seen = 0
        self._plate: ByteArray | None = None

    @property
    def frames(self) -> IndexArray:
        """(K,) numbers of the frames that are kept."""
        return self._spacing * np.arange(len(self._kept))

    def add(self, frames: SmallFrames) -> None:
        """Add the next frames, in order."""
        for index in range(len(frames)):
            if self._seen % self._spacing == 0:
                self._kept.append(frames.pixels(index))
                self._plate = None
                if len(self._kept) > self._max_frames:
                    self._kept = self._kept[::2]
                    self._spacing *= 2
            self._seen += 1

    @property
    def plate(self) -> ByteArray | None:
        """(h, w, 3), or None while there are too few frames."""
        if self._plate is None and len(self._kept) >= _PLATE_MIN_FRAMES:
            self._plate = sort_images(np.stack(self._kept))[len(self._kept) // 2]
        return self._plate

    def without(self, people: BoolArray) -> ByteArray | None:
        """(h, w, 3) the plate without the pixels of people in the kept frames.

        Someone who sways or steps in one place covers a pixel in most frames, but not in all.

        Args:
            people: (K, h, w) where people are; where too few frames are free, the pixel stays as in `plate`.
        """
        plate = self.plate
        if plate is None:
            return None
        free = (~people).sum(axis=0)
        kept = np.stack(self._kept).astype(np.int16)
        kept[people] = 256  # sorted to the end
        kept = sort_images(kept)
        seen = free >= _PLATE_MIN_FRAMES
        middle = np.where(seen, free // 2, 0)[None, :, :, None]
        median = np.take_along_axis(kept, middle, axis=0)[0]
        return np.where(seen[..., None], median, plate).astype(np.uint8)


def sort_images(images: NDArray[_T]) -> NDArray[_T]:
    """Sort the values of every pixel over the images.

    Batcher's odd-even merge sort (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M): a fixed list of pairs
    of images, of which the smaller and the larger value of every pixel are taken. Whole images are compared at once,
    which is some twenty times as fast as sorting a few values for each pixel.

    Args:
        images: (K, ...) integers, overwritten.

    Returns:
        (K, ...) the same array, ascending along its first axis.
    """
    count = len(images)
    top = 1 << max(count - 1, 0).bit_length() - 1 if count > 1 else 0
    step = top
    lower = np.empty_like(images[0])
    while step > 0:
        other, pattern, distance = top, 0, step
        while True:
            for i in range(count - distance):
                if i & step == pattern:
                    np.minimum(images[i], images[i + distance], out=lower)
                    np.maximum(images[i], images[i + distance], out=images[i + distance])
                    images[i] = lower
            if other == step:
                break
            distance, other, pattern = other - step, other >> 1, step
        step >>= 1
    return images


@dataclass(eq=False)
class SmallFrames:
    """Frames at the plate's resolution. Each is scaled down, and compared with the plate, when it is first asked for:
    few are where people are detected some 15 times a second and move little.

    Attributes:
        frames: (n, H, W, 3) RGB, which may be halved already.
        letterbox: scales them down.
        plate: (h, w, 3) the background; None while there is none.
    """

    frames: ByteArray
    letterbox: Letterbox
    plate: ByteArray | None = None
    _pixels: dict[int, ByteArray] = field(init=False, default_factory=dict)
    _difference: dict[int, Float32Array] = field(init=False, default_factory=dict)

    def __len__(self) -> int:
        return len(self.frames)

    def pixels(self, index: int) -> ByteArray:
        """(h, w, 3) RGB of a frame."""
        if index not in self._pixels:
            self._pixels[index] = self.letterbox.apply(self.frames[index])
        return self._pixels[index]

    def difference(self, index: int) -> Float32Array:
        """(h, w) of a frame from the background plate, 0..1; zero while there is none."""
        if index not in self._difference:
            self._difference[index] = _difference(self.pixels(index), self.plate)
        return self._difference[index]


class BackgroundModel:
    """One camera's background plate, built from its frames in order, or known already."""

    def __init__(self, letterbox: Letterbox, enabled: bool = True, known: ByteArray | None = None) -> None:
        """A model for frames that `letterbox` scales down.

        Args:
            letterbox: of the person detector.
            enabled: build a plate; not for moving cameras.
            known: (h, w, 3) a plate from an earlier pass, used as it is.
        """
        self._letterbox = letterbox
        self._enabled = enabled
        self._known = known
        self._plate = BackgroundPlate()

    @property
    def plate(self) -> ByteArray | None:
        """(h, w, 3), or None where there is none (yet)."""
        if not self._enabled:
            return None
        return self._plate.plate if self._known is None else self._known

    def __call__(self, frames: ByteArray) -> SmallFrames:
        """The next (n, H, W, 3) RGB frames, which may be halved already, scaled down."""
        small = SmallFrames(frames, self._letterbox)
        if self._enabled and self._known is None:
            self._plate.add(small)
        small.plate = self.plate
        return small

    def without(self, tracks: FloatArray, landmarks: LandmarkSet) -> ByteArray | None:
        """(h, w, 3) the background of the frames so far, without the people found in them.

        Args:
            tracks: (T, P, J, 2) px of the frames.
            landmarks: the meaning of the J axis.
        """
        if self.plate is None or self._known is not None:
            return self.plate
        canvas_from_frame = np.linalg.inv(self._letterbox.frame_from_canvas)
        px = tracks[self._plate.frames] @ canvas_from_frame[:2, :2].T + canvas_from_frame[:2, 2]
        return self._plate.without(silhouettes(px, landmarks, self._letterbox.canvas))

    def difference_in(self, crops: Crops, small: SmallFrames, index: int) -> ByteArray:
        """(N, S, S) the difference of one of the frames in crops, 255 for 1."""
        in_small = Crops(crops.size_px, crops.crop_from_image @ self._letterbox.frame_from_canvas)
        return extract_crops(np.round(255 * small.difference(index)).astype(np.uint8), in_small)


def _difference(frame: ByteArray, plate: ByteArray | None) -> Float32Array:
    """(h, w) mean over RGB of |frame - plate| in 0..1, after matching the exposure; zero without a plate."""
    if plate is None:
        return np.zeros(frame.shape[:2], dtype=np.float32)
    red, green, blue = cv2.split(cv2.absdiff(cv2.LUT(frame, _exposure(frame, plate)), plate))
    # A mean over the last axis would take ten times as long.
    return np.asarray((red.astype(np.float32) + green + blue) / 765, dtype=np.float32)


def _exposure(frame: ByteArray, plate: ByteArray) -> ByteArray:
    """(256, 1, 3) the frame's values in the plate's exposure, because cameras adjust theirs: by the gain that most of
    the image agrees on, unchanged where there is none."""
    values = np.arange(256.0)[:, None, None] * _gain(frame, plate)
    return np.asarray(values.round().clip(0, 255), dtype=np.uint8)


def _gain(frame: ByteArray, plate: ByteArray) -> FloatArray:
    """(3,) gain of the channels from the frame to the plate."""
    some = plate[::_STRIDE, ::_STRIDE].reshape(-1, 3), frame[::_STRIDE, ::_STRIDE].reshape(-1, 3)
    usable = ((some[0] > _DARK) & (some[0] < _BRIGHT) & (some[1] > _DARK) & (some[1] < _BRIGHT)).all(axis=1)
    if usable.sum() < _LEAST_PIXELS:
        return np.ones(3)
    ratio = some[0][usable].astype(np.float32) / some[1][usable]
    gain = np.median(ratio, axis=0)
    agree = (np.abs(ratio / gain - 1) < _AGREEMENT).all(axis=1).mean()
    return np.asarray(gain if agree > 0.5 else np.ones(3), dtype=np.float64)


def silhouettes(points_px: FloatArray, landmarks: LandmarkSet, size: tuple[int, int]) -> BoolArray:
    """Masks of people, a little too wide.

    Args:
        points_px: (K, P, J, 2) px of K images, NaN where missing.
        landmarks: the meaning of the J axis.
        size: width and height of the images.

    Returns:
        (K, height, width).
    """
    masks = np.zeros((len(points_px), size[1], size[0]), np.uint8)
    head = {"nose", "left_eye", "right_eye", "left_ear", "right_ear"}
    reach = np.array([_HEAD if name in head else _JOINT for name in landmarks.names])
    trunk = [i for i, name in enumerate(landmarks.names) if name.endswith(("_shoulder", "_hip"))]
    for mask, people in zip(masks, points_px, strict=True):
        for body in people:
            known = np.isfinite(body).all(axis=-1)
            if not known.any():
                continue
            long_side = float(np.ptp(body[known], axis=0).max())
            at = np.where(known[:, None], body, 0).round().astype(int).tolist()
            for a, b in landmarks.edge_indices:
                if known[a] and known[b]:
                    cv2.line(mask, at[a], at[b], 1, max(1, round(_LIMB * long_side)))
            for i in np.flatnonzero(known):
                cv2.circle(mask, at[i], max(1, round(reach[i] * long_side)), 1, -1)
            if len(trunk) > 2 and known[trunk].all():
                cv2.fillConvexPoly(mask, cv2.convexHull(np.array([at[i] for i in trunk], np.int32)), 1)
    return masks.astype(np.bool_)
