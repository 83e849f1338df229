"""2D landmarks of the people in one camera's video: detect, track, crop, run the network, decode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.cameras import Camera
from muybridge.geometry.crops import Crops, crops_for_boxes
from muybridge.geometry.landmarks import Keypoints2D, LandmarkSet
from muybridge.infer.crops import extract_crops
from muybridge.infer.onnx import KeypointNetwork, OnnxOptions, PeopleNetwork
from muybridge.infer.people import PeopleDetector, PeopleOptions
from muybridge.infer.tracking import BoxSmoother, Tracker, TrackOptions
from muybridge.models.decode import box_overlap, decode_heatmaps

# Frames worked on together: it bounds memory and is how far the boxes' smoothing may look ahead.
_FRAMES_AT_ONCE = 16

# How far a person reaches beyond their landmarks, in longer sides of the landmarks' own box.
_REACH = {"nose": 0.11, "eye": 0.11, "ear": 0.11, "wrist": 0.10}
_REACH_ELSEWHERE = 0.04

# Two poses are of one person if the median distance of their landmarks is below this part of the box, or if
# their boxes overlap by more than this.
_SAME_PERSON = 0.05
_SAME_BOX = 0.85

# Boxes narrower than this are widened: there is nothing to see in them.
_MIN_BOX_PX = 8.0


@dataclass(frozen=True)
class KeypointOptions:
    """How landmarks are found in one camera's video.

    Attributes:
        people: the detector.
        track: tracks from detections.
        onnx: how the networks run.
        refine_crop: crop again where the landmarks' own box differs from the detector's, and keep the surer
            of the two results.
        refine_change: how much it has to differ, in centre or size, relative to the box.
        min_sure: mean score from which a person's landmarks count as evidence that someone is there.
    """

    people: PeopleOptions = field(default_factory=PeopleOptions)
    track: TrackOptions = field(default_factory=TrackOptions)
    onnx: OnnxOptions = field(default_factory=OnnxOptions)
    refine_crop: bool = True
    refine_change: float = 0.15
    min_sure: float = 0.4


@dataclass(frozen=True, eq=False)
class CameraTracks:
    """Landmarks of the people in one camera's video; a slot `p` is one track (see `Keypoints2D`).

    Attributes:
        landmarks: the meaning of the `J` axis.
        points_px: (T, P, J, 2) px of the video; NaN where missing.
        variance_px2: (T, P, J) variance of each coordinate; NaN where missing.
        score: (T, P, J) in 0..1, zero where missing.
        visibility: (T, P, J) probability that the landmark is not hidden; zero where missing.
        boxes_px: (T, P, 4) left, top, right, bottom of the box that was cropped; NaN where there was none.
        ids: (T, P) number of the track, -1 where there is none. A slot may hold several, one after another.
    """

    landmarks: LandmarkSet
    points_px: NDArray[np.float64]
    variance_px2: NDArray[np.float64]
    score: NDArray[np.float64]
    visibility: NDArray[np.float64]
    boxes_px: NDArray[np.float64]
    ids: NDArray[np.int64]


class _Poses(NamedTuple):
    """Landmarks of K boxes, K over frames and slots: the arrays of `CameraTracks` with K for T, P."""

    points_px: NDArray[np.float64]
    variance_px2: NDArray[np.float64]
    score: NDArray[np.float64]
    visibility: NDArray[np.float64]
    boxes_px: NDArray[np.float64]

    @property
    def sureness(self) -> NDArray[np.float64]:
        """(K,) mean score."""
        return np.asarray(self.score.mean(axis=1), dtype=np.float64)

    def select(self, index: NDArray[np.intp]) -> _Poses:
        return _Poses(*(values[index] for values in self))


class _Found(NamedTuple):
    """What one chunk gave: K poses with their frame, slot and track; float32 to keep long takes small."""

    frame: NDArray[np.int64]
    slot: NDArray[np.int64]
    track: NDArray[np.int64]
    seen: NDArray[np.bool_]
    poses: tuple[NDArray[np.float32], ...]


class PoseEstimator:
    """Landmarks of the people in one camera's video, which it is fed chunk by chunk, in order.

    The same chunks give the same results; other chunks may shift a box by a little, since smoothing looks
    ahead only as far as the chunk goes.
    """

    def __init__(
        self,
        keypoint_model: Path,
        people_model: Path,
        camera: Camera | None = None,
        options: KeypointOptions = KeypointOptions(),
    ) -> None:
        """Open the networks.

        Args:
            keypoint_model: ONNX file of the keypoint network.
            people_model: ONNX file of the person detector.
            camera: calibration at the video's size; without it crops are plain squares.
            options: how.

        Raises:
            ModelError: a file is missing or not one of ours.
        """
        self._network = KeypointNetwork(keypoint_model, options.onnx)
        self._camera = camera
        self._options = options
        self._detector = PeopleDetector(PeopleNetwork(people_model, options.onnx), options.people, camera)
        self._smoother = BoxSmoother(options.track)
        self._tracker: Tracker | None = None
        self._frames = 0
        self._size: tuple[int, int] | None = None
        self._found: list[_Found] = []

    @property
    def landmarks(self) -> LandmarkSet:
        """What the network finds."""
        return self._network.card.landmarks

    def process(self, frames: NDArray[np.uint8]) -> None:
        """Work on the next frames.

        Args:
            frames: (n, H, W, 3) RGB, n at will, the same size in every call.

        Raises:
            ValueError: not such frames, or of another size than before or than the camera's.
        """
        if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8:
            raise ValueError(f"frames must be (n, H, W, 3) uint8, not {frames.shape} {frames.dtype}")
        size = (frames.shape[2], frames.shape[1])
        if self._tracker is None:
            if self._camera is not None and size != (self._camera.width, self._camera.height):
                raise ValueError(
                    f"frames of {size[0]}x{size[1]} px for camera {self._camera.name} of "
                    f"{self._camera.width}x{self._camera.height}: fit the calibration to the video first"
                )
            self._size, self._tracker = size, Tracker(*size, self._options.track)
        if size != self._size:
            raise ValueError(f"frames of {size[0]}x{size[1]} px after others of another size")
        for start in range(0, len(frames), _FRAMES_AT_ONCE):
            self._process_part(frames[start : start + _FRAMES_AT_ONCE], self._tracker)

    def finish(self) -> CameraTracks:
        """Everything found so far; T is the number of frames processed, P the slots that were used."""
        looks = -(-self._frames // self._options.people.every)
        min_seen = min(self._options.track.min_seen, looks)
        return _assemble(self._found, self._frames, self.landmarks, min_seen)

    def _process_part(self, frames: NDArray[np.uint8], tracker: Tracker) -> None:
        tracked = [tracker.step(detected) for detected in self._detector(frames)]
        boxes = self._smoother(tracked)
        ids = np.stack([t.ids for t in tracked])
        seen = np.stack([t.seen for t in tracked])
        frame, slot = np.nonzero(ids >= 0)
        first = self._frames
        self._frames += len(frames)
        if not len(frame):
            return
        poses = self._poses(frames, frame, _at_least(boxes[frame, slot]))
        if self._options.refine_crop:
            poses = self._refined(frames, frame, poses)
        missed = np.stack([t.missed for t in tracked])[frame, slot]
        unsure = poses.sureness < self._options.min_sure
        duplicate = _duplicates(poses, frame, missed)
        keep = ~duplicate & ~(unsure & missed & ~_seen_later(ids, seen)[frame, slot])
        last = np.flatnonzero((frame == len(frames) - 1) & missed & ~unsure)
        self._feed_back(tracker, slot[last], poses.select(last), duplicate[last])
        frame, slot, poses = frame[keep], slot[keep], poses.select(np.flatnonzero(keep))
        self._found.append(
            _Found(
                frame + first, slot, ids[frame, slot], seen[frame, slot],
                tuple(values.astype(np.float32) for values in poses),
            )
        )  # fmt: skip

    def _poses(
        self, frames: NDArray[np.uint8], frame: NDArray[np.intp], boxes_px: NDArray[np.float64]
    ) -> _Poses:
        """Landmarks in boxes (K, 4) of the frames with indices (K,)."""
        card = self._network.card
        crops = crops_for_boxes(boxes_px, card.input_size, self._camera, card.box_padding)
        pixels = np.empty((len(crops), card.input_size, card.input_size, 3), dtype=np.uint8)
        for index in np.unique(frame):
            here = np.flatnonzero(frame == index)
            pixels[here] = extract_crops(frames[index], crops.select(here))
        return self._decode(*self._network(pixels), crops, boxes_px)

    def _decode(
        self,
        heatmaps: NDArray[np.float32],
        visibility: NDArray[np.float32],
        crops: Crops,
        boxes_px: NDArray[np.float64],
    ) -> _Poses:
        card = self._network.card
        points_crop, variance_crop, score = decode_heatmaps(heatmaps, card.stride, card.spread)
        points = crops.to_image(points_crop)
        variance = crops.variance_to_image(points_crop, variance_crop)
        score[~np.isfinite(points).all(axis=-1)] = 0.0
        seen = 1 / (1 + np.exp(-np.clip(visibility.astype(np.float64), -50, 50)))
        return _Poses(points, variance, score, seen, boxes_px)

    def _refined(self, frames: NDArray[np.uint8], frame: NDArray[np.intp], poses: _Poses) -> _Poses:
        """The poses, those whose landmarks' box differs much from the cropped one estimated once more."""
        own = body_boxes(poses.points_px, self.landmarks)
        used = poses.boxes_px
        side, own_side = _longer_sides(used), np.maximum(_longer_sides(own), _MIN_BOX_PX)
        moved = np.linalg.norm((own[:, :2] + own[:, 2:] - used[:, :2] - used[:, 2:]) / 2, axis=1) / side
        limit = self._options.refine_change
        differs = (moved > limit) | (np.abs(np.log(own_side / side)) > np.log1p(limit))
        again = np.flatnonzero(differs & (poses.sureness >= self._options.min_sure))
        if not len(again):
            return poses
        second = self._poses(frames, frame[again], _at_least(own[again]))
        better = second.sureness > poses.sureness[again]
        for values, new in zip(poses, second, strict=True):
            values[again[better]] = new[better]
        return poses

    def _feed_back(
        self, tracker: Tracker, slots: NDArray[np.intp], poses: _Poses, duplicate: NDArray[np.bool_]
    ) -> None:
        """Tell the tracker what sure landmarks (K) in a chunk's last frame say of tracks it lost sight of."""
        own = body_boxes(poses.points_px, self.landmarks)
        for index, slot in enumerate(slots):
            if duplicate[index]:
                tracker.end(int(slot))
            else:
                tracker.confirm(int(slot), own[index])


def _seen_later(ids: NDArray[np.int64], seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n, P) whether a slot's track is detected in this or a later one of the n frames."""
    later = seen.copy()
    for index in range(len(ids) - 2, -1, -1):
        later[index] |= later[index + 1] & (ids[index] == ids[index + 1])
    return later


def body_boxes(points_px: NDArray[np.float64], landmarks: LandmarkSet) -> NDArray[np.float64]:
    """Boxes of whole bodies from their landmarks.

    Args:
        points_px: (K, J, 2), NaN where missing.
        landmarks: which are what; heads and hands reach further beyond their landmarks than the rest.

    Returns:
        (K, 4) left, top, right, bottom; NaN where no landmark is known.
    """
    points = np.where(np.isfinite(points_px).all(axis=-1, keepdims=True), points_px, np.nan)
    low, high = _nan_extreme(points, np.fmin), _nan_extreme(points, np.fmax)
    side = (high - low).max(axis=1)
    reach = np.array([_REACH.get(name.rsplit("_", 1)[-1], _REACH_ELSEWHERE) for name in landmarks.names])
    margin = (reach * side[:, None])[..., None]
    return np.concatenate(
        [_nan_extreme(points - margin, np.fmin), _nan_extreme(points + margin, np.fmax)], axis=1
    )


def _nan_extreme(points: NDArray[np.float64], extreme: np.ufunc) -> NDArray[np.float64]:
    """(K, J, 2) to (K, 2) by np.fmin or np.fmax, which pass NaN over without a warning."""
    return np.asarray(extreme.reduce(points, axis=1), dtype=np.float64)


def _longer_sides(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((boxes[:, 2:] - boxes[:, :2]).max(axis=1), dtype=np.float64)


def _at_least(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The boxes, widened about their middle to a least side."""
    center = (boxes[:, :2] + boxes[:, 2:]) / 2
    half = np.maximum(boxes[:, 2:] - boxes[:, :2], _MIN_BOX_PX) / 2
    return np.concatenate([center - half, center + half], axis=1)


def _duplicates(poses: _Poses, frame: NDArray[np.intp], missed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(K,) poses of tracks that were looked for in vain and lie on another track's person in that frame."""
    duplicate = np.zeros(len(frame), dtype=np.bool_)
    for index in np.unique(frame[missed]):
        here = np.flatnonzero(frame == index)
        points, boxes, sureness = poses.points_px[here], poses.boxes_px[here], poses.sureness[here]
        away = np.median(np.linalg.norm(points[:, None] - points[None], axis=-1), axis=-1)
        same = (away < _SAME_PERSON * _longer_sides(boxes)) | (box_overlap(boxes, boxes) > _SAME_BOX)
        for a in np.flatnonzero(missed[here]):
            others = np.delete(np.arange(len(here)), a)
            better = ~missed[here[others]] | (sureness[others] > sureness[a])
            duplicate[here[a]] = bool((same[a, others] & better).any())
    return duplicate


def _assemble(found: list[_Found], frames: int, landmarks: LandmarkSet, min_seen: int) -> CameraTracks:
    """Dense arrays from the chunks' poses, without tracks that were hardly ever seen."""
    frame, slot, track, seen = (
        np.concatenate([getattr(f, name) for f in found]) if found else np.empty(0, dtype=np.int64)
        for name in ("frame", "slot", "track", "seen")
    )
    times_seen = np.bincount(track, weights=seen)
    keep = np.flatnonzero(times_seen[track] >= min_seen)
    frame, slot, track = frame[keep], slot[keep], track[keep]
    used, slot = np.unique(slot, return_inverse=True)
    count, slots = len(landmarks), max(1, len(used))

    def dense(which: int, shape: tuple[int, ...], missing: float) -> NDArray[np.float64]:
        values = np.full((frames, slots, *shape), missing)
        if found:
            values[frame, slot] = np.concatenate([f.poses[which] for f in found])[keep]
        return values

    ids = np.full((frames, slots), -1, dtype=np.int64)
    ids[frame, slot] = track
    return CameraTracks(
        landmarks=landmarks,
        points_px=dense(0, (count, 2), np.nan),
        variance_px2=dense(1, (count,), np.nan),
        score=dense(2, (count,), 0.0),
        visibility=dense(3, (count,), 0.0),
        boxes_px=dense(4, (4,), np.nan),
        ids=ids,
    )


def merge_tracks(tracks: Sequence[CameraTracks]) -> Keypoints2D:
    """The cameras' tracks as one set of arrays, slots padded to the most that a camera has.

    Raises:
        ValueError: no camera, or numbers of frames or landmarks that differ.
    """
    if not tracks:
        raise ValueError("no camera's tracks to merge")
    frames = sorted({len(t.points_px) for t in tracks})
    if len(frames) > 1 or any(t.landmarks != tracks[0].landmarks for t in tracks):
        raise ValueError(f"the cameras differ in frames ({frames}) or landmarks")
    slots = max(t.points_px.shape[1] for t in tracks)

    def merged(parts: list[NDArray[np.float64]], missing: float) -> NDArray[np.float64]:
        result = np.full((len(parts), len(parts[0]), slots, *parts[0].shape[2:]), missing)
        for camera, part in enumerate(parts):
            result[camera, :, : part.shape[1]] = part
        return result

    return Keypoints2D(
        landmarks=tracks[0].landmarks,
        points_px=merged([t.points_px for t in tracks], np.nan),
        variance_px2=merged([t.variance_px2 for t in tracks], np.nan),
        score=merged([t.score for t in tracks], 0.0),
    )
