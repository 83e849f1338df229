"""Where people are in a camera's frames: a small detector, helped by a static camera's background plate."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.cameras import Camera
from muybridge.infer.onnx import PeopleNetwork
from muybridge.models.decode import DetectedPeople, decode_people

# The detector takes sizes that are multiples of this.
_GRID_PX = 32

# A camera whose up is closer to its axis than this (sine) looks down on people: no side of its image is up.
_STEEP = 0.35

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


@dataclass(frozen=True)
class Letterbox:
    """How a frame becomes the detector's input: scaled to its long side, turned upright, at the top left of a
    canvas whose sides are multiples of 32, black elsewhere.

    Attributes:
        width: of the frame, px.
        height: of the frame, px.
        long_side: of the scaled frame, px.
        turns: clockwise quarter turns that put people's heads up.
    """

    width: int
    height: int
    long_side: int
    turns: int = 0

    @property
    def scaled(self) -> tuple[int, int]:
        """Width and height of the scaled frame before it is turned, px."""
        scale = self.long_side / max(self.width, self.height)
        return max(1, round(self.width * scale)), max(1, round(self.height * scale))

    @property
    def canvas(self) -> tuple[int, int]:
        """Width and height of the canvas, px."""
        width, height = self.scaled[:: -1 if self.turns % 2 else 1]
        return -(-width // _GRID_PX) * _GRID_PX, -(-height // _GRID_PX) * _GRID_PX

    def apply(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(H, W, 3) to the canvas."""
        width, height = self.canvas
        result = np.zeros((height, width, 3), dtype=np.uint8)
        shrinks = max(self.width, self.height) >= self.long_side
        small = cv2.resize(frame, self.scaled, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
        upright = np.rot90(small, -self.turns)
        result[: upright.shape[0], : upright.shape[1]] = upright
        return result

    def boxes_to_frame(self, boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K, 4) boxes in canvas px to original px; pixel centres at whole numbers in both."""
        left, top, right, bottom = boxes.T
        for turn in range(self.turns % 4, 0, -1):
            # The inverse of a clockwise turn, which takes (x, y) to (height - 1 - y, x).
            last = self.scaled[1 if turn % 2 else 0] - 1
            left, top, right, bottom = top, last - right, bottom, last - left
        scale = np.array([self.width / self.scaled[0], self.height / self.scaled[1]] * 2)
        return np.asarray((np.stack([left, top, right, bottom], axis=1) + 0.5) * scale - 0.5)


def upright_turns(camera: Camera | None) -> int:
    """Clockwise quarter turns after which world Z points up in the camera's image, as nearly as they can.

    Zero without a camera, and for one that looks so steeply that people's heads point all ways.
    """
    if camera is None:
        return 0
    up_x, up_y = camera.rotation[:2, 2]
    if np.hypot(up_x, up_y) < _STEEP:
        return 0
    # Clockwise from image up: a quarter turn more brings image right to the top than image left.
    return int(-np.round(np.arctan2(up_x, -up_y) / (np.pi / 2))) % 4


class PeopleDetector:
    """Finds people in one camera's frames, which it must see in order."""

    def __init__(
        self,
        network: PeopleNetwork,
        options: PeopleOptions = PeopleOptions(),
        camera: Camera | None = None,
    ) -> None:
        """A detector; with a calibrated camera frames of a sideways or inverted one are turned upright."""
        self._network = network
        self._turns = upright_turns(camera)
        self._options = options
        self._plate = BackgroundPlate()
        self._next = 0

    def __call__(self, frames: NDArray[np.uint8]) -> list[DetectedPeople | None]:
        """People in the next frames.

        Args:
            frames: (n, H, W, 3) RGB.

        Returns:
            one entry a frame, boxes in px of the frame; None for frames that were not looked at.
        """
        found: list[DetectedPeople | None] = [None] * len(frames)
        first = -self._next % self._options.every
        self._next += len(frames)
        looked_at = range(first, len(frames), self._options.every)
        if not looked_at:
            return found
        card = self._network.card
        letterbox = Letterbox(frames.shape[2], frames.shape[1], card.input_long_side, self._turns)
        small = np.stack([letterbox.apply(frames[index]) for index in looked_at])
        if self._options.background:
            self._plate.add(small)
        heatmap, box = self._network(small, self._plate.difference(small))
        people = decode_people(heatmap, box, card.stride, threshold=self._options.min_score)
        for index, detected in zip(looked_at, people, strict=True):
            found[index] = DetectedPeople(letterbox.boxes_to_frame(detected.boxes_px), detected.scores)
        return found
