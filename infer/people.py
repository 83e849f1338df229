"""Where people are in a camera's frames: a small detector, helped by a static camera's background plate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.infer.onnx import PeopleNetwork
from muybridge.infer.upright import Letterbox, Upright
from muybridge.models.decode import DetectedPeople, decode_people

# With fewer frames than this there is no telling what is background.
_PLATE_MIN_FRAMES = 3


@dataclass(frozen=True)
class PeopleOptions:
    """How people are found.

    Attributes:
        min_score: least probability of a detection. Weak ones only prolong a track, see `TrackOptions`.
        every: look at every n-th frame; boxes in between are interpolated.
        background: use the difference to the camera's background plate; turn it off for moving cameras.
    """

    min_score: float = 0.2
    every: int = 1
    background: bool = True

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ValueError("every must be at least 1")


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

    def difference(self, frames: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(n, h, w) mean over RGB of |frame - plate| in 0..1; zero while there is no plate."""
        plate = self.plate
        result = np.zeros(frames.shape[:3], dtype=np.float32)
        if plate is not None:
            for index, frame in enumerate(frames):
                result[index] = cv2.absdiff(frame, plate).mean(axis=-1, dtype=np.float32) / 255
        return result


class PeopleDetector:
    """Finds people in one camera's frames, which it must see in order."""

    def __init__(self, network: PeopleNetwork, upright: Upright, options: PeopleOptions = PeopleOptions()) -> None:
        """A detector for frames of the size, and hung as, `upright` says."""
        self._network = network
        self._letterbox = Letterbox(upright, network.card.input_long_side)
        self._options = options
        self._plate = BackgroundPlate()
        self._next = 0

    def __call__(self, frames: NDArray[np.uint8]) -> list[DetectedPeople | None]:
        """People in the next frames.

        Args:
            frames: (n, H, W, 3) RGB.

        Returns:
            one entry a frame, boxes in upright px (see `Upright`); None for frames that were not looked at.
        """
        found: list[DetectedPeople | None] = [None] * len(frames)
        first = -self._next % self._options.every
        self._next += len(frames)
        looked_at = range(first, len(frames), self._options.every)
        if not looked_at:
            return found
        small = np.stack([self._letterbox.apply(frames[index]) for index in looked_at])
        if self._options.background:
            self._plate.add(small)
        heatmap, box = self._network(small, self._plate.difference(small))
        people = decode_people(heatmap, box, self._network.card.stride, self._options.min_score)
        for index, detected in zip(looked_at, people, strict=True):
            boxes = self._letterbox.boxes_to_upright(detected.boxes_px)
            found[index] = DetectedPeople(boxes, detected.scores)
        return found
