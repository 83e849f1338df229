"""People in a camera's frames: a small detector that also sees the difference to the background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.infer.detection.background import SmallFrames
from muybridge.infer.detection.orientation import Letterbox
from muybridge.infer.networks.keypoints import PeopleNetwork
from muybridge.models.people.decode import DetectedPeople, decode_people


@dataclass(frozen=True)
class PeopleOptions:
    """How people are detected.

    Attributes:
        min_score: least probability of a detection. Weak ones only prolong a track, see `TrackOptions`.
        every: detect in every n-th frame; boxes in between are interpolated.
        background: use the difference to the camera's background, here and in the keypoint network; turn it off for
            moving cameras.
    """

    min_score: float = 0.2
    every: int = 1
    background: bool = True

    def __post_init__(self) -> None:
        if self.every < 1:
            raise ValueError("every must be at least 1")


class PeopleDetector:
    """Detects people in one camera's frames, given in order."""

    def __init__(self, network: PeopleNetwork, letterbox: Letterbox, options: PeopleOptions = PeopleOptions()) -> None:
        """A detector for frames that `letterbox` scaled down."""
        self._network = network
        self._letterbox = letterbox
        self._options = options
        self._next = 0

    def __call__(self, frames: SmallFrames) -> list[DetectedPeople | None]:
        """People in the next frames.

        Returns:
            one entry per frame, boxes in upright px (see `FrameOrientation`); None for frames that were skipped.
        """
        count = len(frames.pixels)
        found: list[DetectedPeople | None] = [None] * count
        chosen = np.arange(-self._next % self._options.every, count, self._options.every)
        self._next += count
        if not len(chosen):
            return found
        heatmap, box = self._network(frames.pixels[chosen], frames.difference[chosen])
        people = decode_people(heatmap, box, self._network.card.stride, self._options.min_score)
        for index, detected in zip(chosen, people, strict=True):
            boxes = self._letterbox.boxes_to_upright(detected.boxes_px)
            found[index] = DetectedPeople(boxes, detected.scores)
        return found
