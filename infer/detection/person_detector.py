"""People in a camera's frames: a small detector that also sees the difference to the background."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import IndexArray
from muybridge.infer.detection.background import SmallFrames
from muybridge.infer.detection.orientation import Letterbox
from muybridge.infer.networks.keypoints import PeopleNetwork
from muybridge.models.people.decode import DetectedPeople, box_overlap, decode_people

# Detections per second where nothing much happens.
_A_SECOND = 15.0
# Somebody detected with this score is clearly there, and stayed where their boxes overlap by this share.
_CLEAR, _SAME_PLACE = 0.5, 0.6


@dataclass(frozen=True)
class PeopleOptions:
    """How people are detected.

    Attributes:
        min_score: least probability of a detection. Weak ones only prolong a track, see `TrackOptions`.
        every: detect in every n-th frame; boxes in between are interpolated. By default some 15 times a second, and in
            every frame while people move fast, appear or leave.
        background: use the difference to the camera's background, here and in the keypoint network; turn it off for
            moving cameras.
    """

    min_score: float = 0.2
    every: int | None = None
    background: bool = True

    def __post_init__(self) -> None:
        if self.every is not None and self.every < 1:
            raise ValueError("every must be at least 1")


class PeopleDetector:
    """Detects people in one camera's frames, given in order.

    Attributes:
        passes: number of frames in which people were looked for.
    """

    def __init__(
        self, network: PeopleNetwork, letterbox: Letterbox, options: PeopleOptions = PeopleOptions(), fps: float = 30.0
    ) -> None:
        """A detector for frames that `letterbox` scaled down, at `fps` frames per second."""
        self._network = network
        self._letterbox = letterbox
        self._options = options
        self._interval = max(1, round(fps / _A_SECOND))
        self._next = 0
        self._last: DetectedPeople | None = None
        self.passes = 0

    def __call__(self, frames: SmallFrames) -> list[DetectedPeople | None]:
        """People in the next frames.

        Returns:
            one entry per frame, boxes in upright px (see `FrameOrientation`); None for frames that were skipped.
        """
        count = len(frames)
        found: list[DetectedPeople | None] = [None] * count
        every, first = self._options.every, self._next == 0
        if every is not None:
            chosen = np.arange(-self._next % every, count, every)
        else:  # the last frame, because boxes after the last detection are predicted
            chosen = np.arange(count - 1, -1, -self._interval)[::-1]
            chosen = np.append(0, chosen) if first and chosen[0] else chosen
        self._next += count
        self._detect(frames, chosen, found)
        if every is None:
            self._detect(frames, self._between(chosen, found), found)
        return found

    def _between(self, chosen: IndexArray, found: list[DetectedPeople | None]) -> IndexArray:
        """The frames between those that were `chosen` in which people have to be looked for too."""
        wanted: list[int] = []
        before, last = -1, self._last
        for at in chosen.tolist():
            now = found[at]
            if last is not None and now is not None and _differ(last, now):
                wanted += range(before + 1, at)
            before, last = at, now
        self._last = last
        return np.array(wanted, dtype=np.intp)

    def _detect(self, frames: SmallFrames, chosen: IndexArray, found: list[DetectedPeople | None]) -> None:
        """Fill in what is found in the chosen frames."""
        if not len(chosen):
            return
        self.passes += len(chosen)
        pixels = np.stack([frames.pixels(t) for t in chosen.tolist()])
        difference = np.stack([frames.difference(t) for t in chosen.tolist()])
        heatmap, box = self._network(pixels, difference)
        people = decode_people(heatmap, box, self._network.card.stride, self._options.min_score)
        for index, detected in zip(chosen, people, strict=True):
            boxes = self._letterbox.boxes_to_upright(detected.boxes_px)
            found[index] = DetectedPeople(boxes, detected.scores)


def _differ(before: DetectedPeople, after: DetectedPeople) -> bool:
    """Whether somebody who was clearly detected has moved far, has come or has gone."""
    overlap = box_overlap(before.boxes_px, after.boxes_px)
    kept, known = overlap.max(axis=1, initial=0.0), overlap.max(axis=0, initial=0.0)
    clear = before.scores >= _CLEAR, after.scores >= _CLEAR
    return bool((kept[clear[0]] < _SAME_PLACE).any() or (known[clear[1]] < _SAME_PLACE).any())
