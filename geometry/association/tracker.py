"""Tracking of people in 3D: the detections of every camera are assigned, frame by frame, to the bodies that they fit.

Bodies are predicted from their last frames, projected into every camera and matched to detections there
(`muybridge.geometry.association.matching`). Detections that remain start new bodies where views agree, those with the
most agreeing views first: two rays intersect by chance easily, three do not. No appearance is used, and the cameras'
own tracks only break ties: people who overlap in an image are separate in 3D.

Assigning detections to predicted bodies instead of views to views follows Zhang et al. 2020 (4D Association Graph) and
Chen et al. 2020 (Cross-view tracking), here without appearance and without a graph.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.association.backfill import bridge_gaps, track_backwards
from muybridge.geometry.association.matching import DetectionMatcher, Detections, FrameDetections, detections_of
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.tracks import (
    BodyTrack,
    deduplicate,
    drop_reflections,
    drop_stray_end,
    rejoin,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import extent

# Frames whose rays are computed together.
_CHUNK = 128
# Minimum time, in seconds, for which two cameras see a body, and a person in the whole take: a shadow that is detected
# as a person for a moment agrees between cameras as well as people do. The latter is doubled where three cameras never
# see the person, because two cameras that face each other agree on almost anything between them.
_LEAST_SEEN, _LEAST_IN_ALL, _TWO_ALONE = 0.3, 0.5, 2
# Longest gap in a camera's track that is bridged, seconds.
_BRIDGE = 0.2
# Bodies that share no view and are nearer to each other than this, in body sizes, are the same.
_SAME_BODY = 0.12
# Views that agree this near to a body without any view are assigned to it, in body sizes.
_SAME_PLACE = 0.35


class PeopleTracker:
    """Tracks people through a take, either one frame at a time or in blocks of frames.

    Feed frames with `step` or `extend`, in order; `people` returns the current state after each. `finish` completes
    the tracks with what later frames show and returns them. `track_people` does all of this for a whole take.
    """

    def __init__(
        self,
        cameras: CameraGroup,
        landmarks: LandmarkSet,
        options: TrackingOptions | None = None,
        fps: float = 30.0,
    ) -> None:
        """Start a take.

        Args:
            cameras: C calibrated cameras.
            landmarks: the J landmarks of the detections.
            options: see `TrackingOptions`.
            fps: frames per second.
        """
        self._cameras, self._landmarks, self._fps = cameras, landmarks, fps
        self._options = options or TrackingOptions()
        self._matcher = DetectionMatcher(cameras, landmarks, self._options, fps)
        self._patience = max(3.0, self._options.coast * fps)
        self._bodies: list[BodyTrack] = []
        self._ended: list[BodyTrack] = []
        self._blocks: list[FloatArray] = []
        self._frames = 0
        self._width = 0
        self._block: Detections | None = None

    @property
    def people(self) -> tuple[BodyTrack, ...]:
        """The confirmed bodies after the last frame; `BodyTrack.slots` (C, T) has room for frames to come."""
        return tuple(body for body in self._bodies if body.confirmed)

    def step(self, points_px: FloatArray) -> tuple[BodyTrack, ...]:
        """Process the next frame.

        Args:
            points_px: (C, P, J, 2) detections, px, NaN where missing. P is the same in all frames of a take; a slot is
                a camera's own track where it has one, which need not be correct.

        Returns:
            The confirmed bodies, as `people`.
        """
        self.extend(points_px[:, None])
        return self.people

    def extend(self, points_px: FloatArray) -> None:
        """Process the next K frames, (C, K, P, J, 2) px; see `step`."""
        first, count = self._frames, points_px.shape[1]
        self._blocks.append(points_px)
        self._reserve(first + count)
        self._frames += count
        for start in range(first, first + count, _CHUNK):
            block = detections_of(self._cameras, points_px[:, start - first : start - first + _CHUNK], start)
            for t in range(start, start + block.valid.shape[1]):
                self._process(block.frame(t))

    def finish(self) -> list[BodyTrack]:
        """End the take: drop false positives, extend bodies back to their first appearance and bridge short gaps.

        Returns:
            Everyone whom two cameras see, with `BodyTrack.slots` (C, T); reflections and absences are not resolved yet.
        """
        frames, options = self._frames, self._options
        bodies = [*self._ended, *self._bodies]
        for body in bodies:
            body.slots = body.slots[:, :frames]
        least = _least_frames(options, _LEAST_SEEN * self._fps, frames)
        for body in bodies:
            drop_stray_end(body, options.min_frames, _BRIDGE * self._fps)
        bodies = [b for b in bodies if b.met >= least and (b.confirmed or frames < 2 * options.min_frames)]
        if bodies:
            points_px = self._blocks[0] if len(self._blocks) == 1 else np.concatenate(self._blocks, axis=1)
            self._blocks = [points_px]
            taken = np.zeros(points_px.shape[:3], dtype=np.bool_)
            track_backwards(bodies, self._matcher, self._frame, taken, self._patience)
            bridge_gaps(bodies, points_px, max(2.0, _BRIDGE * self._fps))
        return deduplicate(bodies, self._landmarks)

    def _frame(self, t: int) -> FrameDetections:
        """The detections of a frame of the finished take, computed in blocks."""
        if self._block is None or t not in self._block:
            start = (t // _CHUNK) * _CHUNK
            self._block = detections_of(self._cameras, self._blocks[0][:, start : start + _CHUNK], start)
        return self._block.frame(t)

    def _reserve(self, frames: int) -> None:
        """Make room for so many frames in the slots of all bodies; frame by frame, the room doubles."""
        if frames <= self._width:
            return
        width = max(frames, 2 * self._width)
        for body in (*self._ended, *self._bodies):
            more = np.full((len(self._cameras), width - self._width), -1, dtype=np.int64)
            body.slots = np.concatenate([body.slots, more], axis=1)
        self._width = width

    def _process(self, frame: FrameDetections) -> None:
        free = frame.valid.copy()
        for body in self._bodies:
            body.points = body.points + body.velocity
        for confirmed in (True, False):
            bodies = [b for b in self._bodies if b.confirmed == confirmed]
            if bodies:
                self._matcher.follow(bodies, frame, free)
        self._start_bodies(frame, free)
        self._merge(frame.t)
        self._retire()

    def _start_bodies(self, frame: FrameDetections, free: BoolArray) -> None:
        """Start new bodies from detections that no body took."""
        while (free.any(axis=1)).sum() >= 2:
            found = self._matcher.best_start(frame, free)
            if found is None:
                return
            points, chosen, visible = found
            seen = chosen >= 0
            free[seen, chosen[seen]] = False
            if self._recover(points, chosen, frame.t):
                continue
            if any(_distance(points, b.points) < _SAME_BODY for b in self._bodies if b.confirmed):
                continue
            confirmed = seen.sum() >= 3 or visible <= 2
            slots = np.full((len(self._cameras), self._width), -1, dtype=np.int64)
            slots[:, frame.t] = chosen
            body = BodyTrack(points, slots, bool(confirmed), frame.t, met=1)
            body.track[frame.t] = points
            self._bodies.append(body)

    def _recover(self, points: FloatArray, chosen: IntArray, t: int) -> bool:
        """Assign detections `chosen` (C,), which intersect in `points`, to a nearby body without any view.

        Such a body was led astray by one wrong view. Returns whether there is one.
        """
        lost = [b for b in self._bodies if b.confirmed and (b.slots[:, t] < 0).all()]
        if not lost:
            return False
        nearest = min(lost, key=lambda b: _distance(points, b.points))
        if _distance(points, nearest.points) > _SAME_PLACE:
            return False
        nearest.slots[:, t] = chosen
        nearest.unseen = 0
        self._matcher.move(nearest, points, t)
        return True

    def _merge(self, t: int) -> None:
        """Merge younger bodies into an older one in the same place with which they share no view.

        Not if a camera has seen both side by side before: then one person passes the other and is hidden by them.
        """
        bodies = sorted(self._bodies, key=lambda b: (not b.confirmed, b.first))
        for i, old in enumerate(bodies):
            for young in bodies[i + 1 :]:
                both = (old.slots[:, t] >= 0) & (young.slots[:, t] >= 0)
                if young in self._bodies and not both.any() and _distance(old.points, young.points) < _SAME_BODY:
                    if ((old.slots >= 0) & (young.slots >= 0)).any(0).sum() >= self._options.min_frames:
                        continue
                    self._bodies.remove(young)
                    if (young.slots[:, t] >= 0).sum() >= 2 > (old.slots[:, t] >= 0).sum():
                        old.points, old.velocity, old.unmet, old.unseen = young.points, young.velocity, 0, 0
                        old.track[t] = young.points
                        old.met += 1
                    old.slots[:, t] = np.where(old.slots[:, t] >= 0, old.slots[:, t], young.slots[:, t])

    def _retire(self) -> None:
        """End bodies that were not seen for too long; unconfirmed ones after three frames."""
        kept: list[BodyTrack] = []
        for body in self._bodies:
            patience = self._patience if body.confirmed else 3
            gone = body.unseen > patience or body.unmet > 2 * patience
            (self._ended if gone else kept).append(body)
        self._bodies = kept


def track_people(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions | None = None, fps: float = 30.0
) -> list[IntArray]:
    """Track everyone whom two cameras see through a whole take.

    Args:
        cameras: C calibrated cameras.
        keypoints: their detections; a slot is a camera's own track, which need not be correct.
        options: see `TrackingOptions`.
        fps: frames per second.

    Returns:
        For each person the slots (C, T), -1 where a camera does not see them.
    """
    tracker = PeopleTracker(cameras, keypoints.landmarks, options, fps)
    tracker.extend(keypoints.points_px)
    return identify_people(tracker.finish(), keypoints.landmarks, options, fps)


def identify_people(
    bodies: list[BodyTrack], landmarks: LandmarkSet, options: TrackingOptions | None = None, fps: float = 30.0
) -> list[IntArray]:
    """Join the bodies of a finished take to people: drops reflections, and identifies who reappears.

    Args:
        bodies: what `PeopleTracker.finish` returns.
        landmarks: the landmarks of the detections.
        options: see `TrackingOptions`.
        fps: frames per second.

    Returns:
        For each person the slots (C, T), -1 where a camera does not see them.
    """
    options = options or TrackingOptions()
    found = []
    for group in rejoin(drop_reflections(bodies, landmarks), landmarks, options.coast, options.same_build, fps):
        cameras, frames = group.shape
        views = (group >= 0).sum(axis=0)
        wanted = _LEAST_IN_ALL * fps * (1 if views.max() >= min(3, cameras) else _TWO_ALONE)
        if (views >= 2).sum() >= _least_frames(options, wanted, frames):
            found.append(np.asarray(group))
    return found


def _least_frames(options: TrackingOptions, wanted: float, frames: int) -> float:
    """Minimum number of frames in which two cameras have to see somebody."""
    return min(max(options.min_frames, wanted), max(1, frames // 4))


def _distance(a: FloatArray, b: FloatArray) -> float:
    """Median distance of two bodies' landmarks, in body sizes."""
    size = max(float(np.nan_to_num(extent(a))), 1e-6)
    away = np.linalg.norm(a - b, axis=-1)
    return float(np.nanmedian(away)) / size if np.isfinite(away).any() else np.inf
