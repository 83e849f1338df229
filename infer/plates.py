"""What a static camera sees without the people who move, and how each frame differs from it.

The person detector and the keypoint network are both helped by it: motion tells people from what only looks like them.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.crops import Crops
from muybridge.infer.crops import extract_crops
from muybridge.infer.upright import Letterbox

# With fewer frames than this there is no telling what is background.
_PLATE_MIN_FRAMES = 3


class BackgroundPlate:
    """What a static camera sees without the people who move: a median over frames spaced evenly in time.

    At most `max_frames` frames are kept; when they are full, every other one goes and the spacing doubles.
    Someone who hardly moves melts into the plate: the detector is trained to do without it as well.
    """

    def __init__(self, max_frames: int = 25) -> None:
        if max_frames < _PLATE_MIN_FRAMES:
            raise ValueError(f"max_frames must be at least {_PLATE_MIN_FRAMES}")
        self._max_frames = max_frames
        self._kept: list[NDArray[np.uint8]] = []
        self._spacing = 1
        self._seen = 0
        self._plate: NDArray[np.uint8] | None = None

    def add(self, frames: NDArray[np.uint8]) -> None:
        """Take note of the next (n, h, w, 3) frames, in order."""
        for frame in frames:
            if self._seen % self._spacing == 0:
                self._kept.append(frame.copy())
                self._plate = None
                if len(self._kept) > self._max_frames:
                    self._kept = self._kept[::2]
                    self._spacing *= 2
            self._seen += 1

    @property
    def plate(self) -> NDArray[np.uint8] | None:
        """(h, w, 3), or None while too few frames were seen."""
        if self._plate is None and len(self._kept) >= _PLATE_MIN_FRAMES:
            middle = len(self._kept) // 2
            self._plate = np.partition(np.stack(self._kept, axis=-1), middle, axis=-1)[..., middle]
        return self._plate


class SmallFrames(NamedTuple):
    """Frames at the plate's resolution.

    Attributes:
        pixels: (n, h, w, 3) RGB.
        difference: (n, h, w) to the background plate, 0..1; zero while there is none.
    """

    pixels: NDArray[np.uint8]
    difference: NDArray[np.float32]


class Backdrop:
    """One camera's background plate, which grows with the frames that it is shown in order, or is known already."""

    def __init__(self, letterbox: Letterbox, enabled: bool = True, known: NDArray[np.uint8] | None = None) -> None:
        """A backdrop for frames that `letterbox` makes small.

        Args:
            letterbox: of the person detector.
            enabled: there is a plate; not for moving cameras.
            known: (h, w, 3) a plate that was found before, and is kept.
        """
        self._letterbox = letterbox
        self._enabled = enabled
        self._known = known
        self._plate = BackgroundPlate()

    @property
    def plate(self) -> NDArray[np.uint8] | None:
        """(h, w, 3), or None where there is none (yet)."""
        if not self._enabled:
            return None
        return self._plate.plate if self._known is None else self._known

    def __call__(self, frames: NDArray[np.uint8]) -> SmallFrames:
        """The next (n, H, W, 3) RGB frames made small."""
        small = np.stack([self._letterbox.apply(frame) for frame in frames])
        if self._enabled and self._known is None:
            self._plate.add(small)
        return SmallFrames(small, _difference(small, self.plate))

    def difference_in(self, crops: Crops, small: SmallFrames, index: int) -> NDArray[np.uint8]:
        """(N, S, S) the difference of one of the frames in crops of it, 255 for 1."""
        in_small = Crops(crops.size_px, crops.crop_from_image @ self._letterbox.frame_from_canvas)
        return extract_crops(np.round(255 * small.difference[index]).astype(np.uint8), in_small)


def _difference(frames: NDArray[np.uint8], plate: NDArray[np.uint8] | None) -> NDArray[np.float32]:
    """(n, h, w) mean over RGB of |frame - plate| in 0..1; zero without a plate."""
    result = np.zeros(frames.shape[:3], dtype=np.float32)
    if plate is not None:
        for index, frame in enumerate(frames):
            result[index] = cv2.absdiff(frame, plate).mean(axis=-1, dtype=np.float32) / 255
    return result
