"""Where people are in a camera's frames: a small detector, helped by a static camera's background plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.infer.detection.background import SmallFrames
from muybridge.infer.detection.orientation import Letterbox
from muybridge.infer.networks.keypoints import PeopleNetwork
from muybridge.models.people.decode import DetectedPeople, decode_people


@dataclass(frozen=True)
class PeopleOptions:
    """How people are found.

    Attributes:
        min_score: least probability of a detection. Weak ones only prolong a track, see `TrackOptions`.
        every: look at every n-th frame; boxes in between are interpolated.
        background: use the difference to the camera's background plate, here and in the keypoint network; turn it off
            for moving cameras.
    """

    min_score: float = 0.2
    every: int = 1
    background: bool = True

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ValueError("every must be at least 1")


class PeopleDetector:
    """Finds people in one camera's frames, which it must see in order."""

    def __init__(self, network: PeopleNetwork, letterbox: Letterbox, options: PeopleOptions = PeopleOptions()) -> None:
        """A detector for frames that `letterbox` made small."""
        self._network = network
        self._letterbox = letterbox
        self._options = options
        self._next = 0

    def __call__(self, frames: SmallFrames) -> list[DetectedPeople | None]:
        """People in the next frames.

        Returns:
            one entry a frame, boxes in upright px (see `FrameOrientation`); None for frames that were not looked at.
        """
        count = len(frames.pixels)
        found: list[DetectedPeople | None] = [None] * count
        looked_at = np.arange(-self._next % self._options.every, count, self._options.every)
        self._next += count
        if not len(looked_at):
            return found
        heatmap, box = self._network(frames.pixels[looked_at], frames.difference[looked_at])
        people = decode_people(heatmap, box, self._network.card.stride, self._options.min_score)
        for index, detected in zip(looked_at, people, strict=True):
            boxes = self._letterbox.boxes_to_upright(detected.boxes_px)
            found[index] = DetectedPeople(boxes, detected.scores)
        return found
