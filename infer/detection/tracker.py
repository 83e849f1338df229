"""Detections of one camera to tracks: slots that hold the same person from frame to frame.

Boxes here are (left, top, right, bottom) in upright px (see `muybridge.infer.detection.orientation`). The tracker
steps frame by frame and keeps a few numbers per slot; smoothing looks ahead within the frames of a chunk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IndexArray, IntArray
from muybridge.models.people.decode import DetectedPeople, box_overlap

# Gain with which a track's velocity follows detections, and its decay per frame without one.
_VELOCITY_GAIN = 0.3
_VELOCITY_DECAY = 0.95

# A detection may belong to a track if the boxes overlap or their centres are close, in longer sides of the track's
# box. The distance may be larger for a track that was not seen for a while, and at low frame rates (per second
# between two frames beyond a thirtieth).
_MIN_OVERLAP = 0.1
_MAX_DISTANCE = 0.3
_MORE_DISTANCE = 0.5
_MAX_DISTANCE_GROWTH = 0.05
_MAX_DISTANCE_EVER = 0.8
# Cost of leaving a track and a detection unassigned: more than a good pair, and less than pulling a track off its
# detection so that another track gets one.
_APART = 1.8

# A new track does not start on a person who already has one.
_MAX_START_OVERLAP = 0.5

# Gain with which a track's score follows its detections. Where all slots are taken, a track with less than this share
# of a new detection's score ends.
_SCORE_GAIN = 0.2
_MUCH_WEAKER = 0.6

# With smoothing wider than this, in frames, boxes change little from one frame to the next.
_SLOW = 0.5

# A track ends when less than this share of its box is in the image.
_MIN_INSIDE = 0.1


@dataclass(frozen=True)
class TrackOptions:
    """How detections become tracks.

    Attributes:
        max_people: slots, i.e. the most people at a time.
        start_score: least probability of a detection that starts a track.
        coast: seconds that a track may continue without detections; never longer than it was detected.
        smooth: standard deviation of the boxes' smoothing over time, seconds; sizes take twice that.
        min_seen: tracks detected in fewer frames are dropped as false detections.
    """

    max_people: int = 6
    start_score: float = 0.35
    coast: float = 1.0
    smooth: float = 0.05
    min_seen: int = 4

    def __post_init__(self) -> None:
        if self.max_people < 1:
            raise ValueError("max_people must be at least 1")


class TrackedFrame(NamedTuple):
    """The slots after one frame.

    Attributes:
        boxes_px: (P, 4) detected or, without a detection, predicted; NaN in free slots.
        ids: (P,) number of the track, -1 in free slots.
        seen: (P,) whether the box was detected in this frame.
        missed: (P,) whether the latest detector pass did not find the track.
    """

    boxes_px: FloatArray
    ids: IntArray
    seen: BoolArray
    missed: BoolArray


class Tracker:
    """Assigns detections to slots, one frame at a time. A slot is reused only after its track has ended."""

    def __init__(self, bounds_px: FloatArray, options: TrackOptions = TrackOptions(), fps: float = 30.0) -> None:
        """A tracker for images with the edges (left, top, right, bottom) px, at `fps` frames per second."""
        self._bounds = np.asarray(bounds_px, dtype=np.float64)
        self._options = options
        self._coast = max(1, round(options.coast * fps))
        self._reach = _MAX_DISTANCE + _MORE_DISTANCE * max(0.0, 1 / fps - 1 / 30)
        slots = options.max_people
        self._boxes = np.full((slots, 4), np.nan)
        self._velocity = np.zeros((slots, 2))
        self._ids = np.full(slots, -1, dtype=np.int64)
        self._hits = np.zeros(slots, dtype=np.int64)
        self._misses = np.zeros(slots, dtype=np.int64)  # frames since the last detection, as far as known
        self._covered = np.zeros(slots, dtype=np.int64)  # frames during which the track was detected
        self._since = 0  # frames since the last pass of the detector
        self._gap = np.zeros(slots, dtype=np.int64)  # frames since the box was last known
        self._ended_at = np.full(slots, -1, dtype=np.int64)
        self._score = np.zeros(slots)  # running mean of the detections' scores, zero where missed
        self._clock = 0
        self._started = 0

    def step(self, detected: DetectedPeople | None) -> TrackedFrame:
        """Advance by one frame; None if the detector skipped it."""
        self._clock += 1
        self._since += 1
        self._gap += 1
        self._boxes += np.tile(self._velocity, 2)
        seen = np.zeros(len(self._ids), dtype=np.bool_)
        if detected is not None:
            slots, found = self._assign(detected)
            self._observe(slots, detected.boxes_px[found], detected.scores[found])
            seen[slots] = True
            self._miss(~seen & (self._ids >= 0))
            unused = np.setdiff1d(np.arange(len(detected.scores)), found)
            for index in unused:
                if detected.scores[index] >= self._options.start_score:
                    slot = self._start(detected.boxes_px[index], float(detected.scores[index]))
                    if slot is not None:
                        seen[slot] = True
            self._since = 0
        self._end(self._outside() & (self._ids >= 0))
        active = self._ids >= 0
        return TrackedFrame(self._boxes.copy(), self._ids.copy(), seen & active, active & (self._misses > 0))

    def confirm(self, slot: int, box_px: FloatArray) -> None:
        """Correct the box of a slot's track by other evidence, such as its landmarks."""
        self._boxes[slot] = box_px
        self._misses[slot] = self._gap[slot] = 0

    def end(self, slot: int) -> None:
        """End a slot's track."""
        self._end(np.arange(len(self._ids)) == slot)

    def _assign(self, detected: DetectedPeople) -> tuple[IndexArray, IndexArray]:
        """Pairs (slots, detections) of least total cost within the gate."""
        active = np.flatnonzero(self._ids >= 0)
        tracks, boxes = self._boxes[active], detected.boxes_px
        overlap = box_overlap(tracks, boxes)
        sides = (tracks[:, 2:] - tracks[:, :2]).max(axis=1)
        away = np.linalg.norm(_centers(tracks)[:, None] - _centers(boxes)[None], axis=-1) / sides[:, None]
        reach = np.minimum(self._reach + _MAX_DISTANCE_GROWTH * (self._gap[active] - 1), _MAX_DISTANCE_EVER)
        allowed = (overlap >= _MIN_OVERLAP) | (away <= reach[:, None])
        cost = np.where(allowed, 1 - overlap + away, _APART)
        rows, columns = scipy.optimize.linear_sum_assignment(cost)
        good = allowed[rows, columns]
        return active[rows[good]], columns[good]

    def _observe(self, slots: IndexArray, boxes: FloatArray, scores: FloatArray) -> None:
        innovation = _centers(boxes) - _centers(self._boxes[slots])
        # A step after a gap is spread over the gap; a young track adapts faster.
        gain = np.maximum(_VELOCITY_GAIN, 1 / (1 + self._hits[slots])) / self._gap[slots]
        self._velocity[slots] += gain[:, None] * innovation
        self._boxes[slots] = boxes
        self._score[slots] += _SCORE_GAIN * (scores - self._score[slots])
        self._hits[slots] += 1
        self._covered[slots] += self._since
        self._misses[slots] = self._gap[slots] = 0

    def _miss(self, slots: BoolArray) -> None:
        self._misses[slots] += self._since
        self._score[slots] *= 1 - _SCORE_GAIN
        self._velocity[slots] *= _VELOCITY_DECAY
        self._end(slots & (self._misses > np.minimum(self._coast, self._covered)))

    def _start(self, box: FloatArray, score: float) -> int | None:
        """Start a track in the slot that was free longest; None if there is none or it is a duplicate.

        Where all slots are taken, the weakest track ends if it is much weaker than this detection.
        """
        active = self._ids >= 0
        if (box_overlap(self._boxes[active], box[None]) > _MAX_START_OVERLAP).any():
            return None
        if active.all():
            weakest = int(self._score.argmin())
            if self._score[weakest] > _MUCH_WEAKER * score:
                return None
            self.end(weakest)
        free = np.flatnonzero(self._ids < 0)
        slot = int(free[np.argmin(self._ended_at[free])])
        self._boxes[slot], self._velocity[slot] = box, 0.0
        self._ids[slot], self._hits[slot], self._score[slot] = self._started, 1, score
        self._covered[slot] = self._since
        self._misses[slot] = self._gap[slot] = 0
        self._started += 1
        return slot

    def _end(self, slots: BoolArray) -> None:
        self._ids[slots] = -1
        self._boxes[slots] = np.nan
        self._velocity[slots] = 0.0
        self._ended_at[slots] = self._clock

    def _outside(self) -> BoolArray:
        low = np.clip(self._boxes[:, :2], self._bounds[:2], self._bounds[2:])
        high = np.clip(self._boxes[:, 2:], self._bounds[:2], self._bounds[2:])
        area = (self._boxes[:, 2:] - self._boxes[:, :2]).prod(axis=1)
        outside: BoolArray = (high - low).prod(axis=1) < _MIN_INSIDE * area
        return outside


def _centers(boxes: FloatArray) -> FloatArray:
    return (boxes[:, :2] + boxes[:, 2:]) / 2


class BoxSmoother:
    """Fills and smooths the boxes of tracks, chunk by chunk, with a short memory across chunks."""

    _MEMORY = 8

    def __init__(self, options: TrackOptions = TrackOptions(), fps: float = 30.0) -> None:
        self._sigma = smoothing_frames(options.smooth, fps)
        self._memory: dict[int, FloatArray] = {}

    def __call__(self, frames: list[TrackedFrame]) -> FloatArray:
        """(n, P, 4) smoothed boxes of n frames, NaN in free slots.

        Frames without a detection are interpolated; after the last detection the tracker's prediction is used.
        """
        boxes = np.stack([frame.boxes_px for frame in frames])
        ids = np.stack([frame.ids for frame in frames])
        seen = np.stack([frame.seen for frame in frames])
        smooth = np.full_like(boxes, np.nan)
        memory: dict[int, FloatArray] = {}
        for track in np.unique(ids[ids >= 0]):
            rows, slots = np.nonzero(ids == track)
            past = self._memory.get(int(track), np.empty((0, 4)))
            known = np.concatenate([np.ones(len(past), dtype=np.bool_), seen[rows, slots]])
            series = filled_boxes(np.concatenate([past, boxes[rows, slots]]), known)
            smooth[rows, slots] = smoothed_boxes(series, self._sigma)[len(past) :]
            memory[int(track)] = series[-self._MEMORY :]
        self._memory = memory
        return smooth


def filled_boxes(series: FloatArray, known: BoolArray) -> FloatArray:
    """(n, 4) boxes with those between known ones interpolated."""
    result = series.copy()
    at = np.flatnonzero(known)
    if len(at):
        inner = np.arange(at[0], at[-1] + 1)
        for column in range(4):
            result[inner, column] = np.interp(inner, at, series[at, column])
    return result


def smoothing_frames(seconds: float, fps: float) -> float:
    """Width of a smoothing in frames, at most that at 30 fps: more frames show much the same, and memory is bounded."""
    return seconds * min(fps, 30.0)


def smoothed_boxes(series: FloatArray, sigma: float) -> FloatArray:
    """(n, 4) boxes of consecutive frames without single outliers, centres and sizes smoothed over time.

    Args:
        series: (n, 4).
        sigma: standard deviation of the centres' smoothing, frames. Below half a frame, where people move far between
            frames, the median filter applies to sizes only.
    """
    center, size = (series[:, :2] + series[:, 2:]) / 2, series[:, 2:] - series[:, :2]
    if len(series) >= 3 and sigma > 0:
        slow = sigma >= _SLOW
        center = scipy.ndimage.median_filter(center, size=(3, 1), mode="nearest") if slow else center
        size = scipy.ndimage.median_filter(size, size=(5 if slow else 3, 1), mode="nearest")
        center = scipy.ndimage.gaussian_filter1d(center, sigma, axis=0, mode="nearest", truncate=3.0)
        size = scipy.ndimage.gaussian_filter1d(size, 2 * sigma, axis=0, mode="nearest", truncate=3.0)
    return np.concatenate([center - size / 2, center + size / 2], axis=1)
