"""2D landmarks of the people in one camera's video: detect, track, crop, run the network, decode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.detection.background import BackgroundModel
from muybridge.infer.detection.crop_reader import Pictures, PoseReader
from muybridge.infer.detection.orientation import Letterbox, orientation_for
from muybridge.infer.detection.person_detector import PeopleDetector, PeopleOptions
from muybridge.infer.detection.tracker import BoxSmoother, Tracker, TrackOptions
from muybridge.infer.networks.external import open_keypoints
from muybridge.infer.networks.keypoints import OnnxOptions, PeopleNetwork

# Frames worked on together: it bounds memory and is how far the boxes' smoothing may look ahead.
_FRAMES_AT_ONCE = 16


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
        min_confidence: mean score from which a person's landmarks count as evidence that someone is there. A track that has
            less over all its frames is nobody's, whatever the detector says, unless there is no better one.
    """

    people: PeopleOptions = field(default_factory=PeopleOptions)
    track: TrackOptions = field(default_factory=TrackOptions)
    onnx: OnnxOptions = field(default_factory=OnnxOptions)
    refine_crop: bool = True
    refine_change: float = 0.15
    min_confidence: float = 0.4


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
        markers_px, markers_variance_px2, markers_score: (T, P, M, 2) and (T, P, M), the same of the virtual markers
            on the skin; None where they were not asked for.
    """

    landmarks: LandmarkSet
    points_px: FloatArray
    variance_px2: FloatArray
    score: FloatArray
    visibility: FloatArray
    boxes_px: FloatArray
    ids: IntArray
    markers_px: FloatArray | None = None
    markers_variance_px2: FloatArray | None = None
    markers_score: FloatArray | None = None


class _Found(NamedTuple):
    """What one chunk gave: K poses with their frame, slot and track; float32 to keep long takes small.

    Boxes are in px of the frame here, those around the upright ones.
    """

    frame: IntArray
    slot: IntArray
    track: IntArray
    seen: BoolArray
    sure: FloatArray
    poses: tuple[Float32Array, ...]


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
        model_card: str | None = None,
        markers: bool = False,
        fps: float = 30.0,
    ) -> None:
        """Open the networks.

        Args:
            keypoint_model: ONNX file of the keypoint network.
            people_model: ONNX file of the person detector.
            camera: calibration at the video's size; without it crops are plain squares.
            options: how.
            model_card: of the keypoint model, where it is not one of ours: see `other_models.open_keypoints`.
            markers: find the virtual markers too.
            fps: frames a second.

        Raises:
            ModelError: a file is missing or not one of ours.
        """
        self._network = open_keypoints(keypoint_model, model_card, options.onnx, markers)
        self._markers = len(SURFACE) if markers else 0
        self._people = PeopleNetwork(people_model, options.onnx)
        self._camera = camera
        self._options = options
        self._smoother = BoxSmoother(options.track, fps)
        self._fps = fps
        self._parts: _Parts | None = None
        self._frames = self._taken = 0
        self._found: list[_Found] = []

    @property
    def landmarks(self) -> LandmarkSet:
        """What the network finds."""
        return self._network.landmarks

    def process(self, frames: ByteArray) -> None:
        """Work on the next frames.

        Args:
            frames: (n, H, W, 3) RGB, n at will, the same size in every call.

        Raises:
            ValueError: not such frames, or of another size than before or than the camera's.
        """
        if frames.ndim != 4 or frames.shape[-1] != 3 or frames.dtype != np.uint8:
            raise ValueError(f"frames must be (n, H, W, 3) uint8, not {frames.shape} {frames.dtype}")
        width, height = frames.shape[2], frames.shape[1]
        if self._parts is None:
            self._parts = self._start(width, height)
        upright = self._parts.reader.upright
        if (width, height) != (upright.width, upright.height):
            raise ValueError(f"frames of {width}x{height} px after others of {upright.width}x{upright.height}")
        for start in range(0, len(frames), _FRAMES_AT_ONCE):
            self._process_part(frames[start : start + _FRAMES_AT_ONCE], self._parts)

    def _start(self, width: int, height: int) -> _Parts:
        """What depends on the frames' size."""
        camera = self._camera
        if camera is not None and (width, height) != (camera.width, camera.height):
            raise ValueError(
                f"frames of {width}x{height} px for camera {camera.name} of {camera.width}x{camera.height}: "
                "fit the calibration to the video first"
            )
        upright = orientation_for(camera, width, height)
        letterbox, people = Letterbox(upright, self._people.card.input_long_side), self._options.people
        backdrop = BackgroundModel(letterbox, people.background)
        return _Parts(
            backdrop,
            PeopleDetector(self._people, letterbox, people),
            Tracker(upright.bounds, self._options.track, self._fps),
            PoseReader(self._network, camera, upright, backdrop, self._fps),
        )

    def background(self, tracks: CameraTracks) -> ByteArray | None:
        """(h, w, 3) what the frames so far show without the people of `tracks`, at the detector's resolution; None
        where too few frames tell, or a moving camera has none."""
        return None if self._parts is None else self._parts.backdrop.without(tracks.points_px, tracks.landmarks)

    def finish(self) -> CameraTracks:
        """Everything found so far; T is the number of frames processed, P the slots that were used."""
        looks = -(-self._frames // self._options.people.every)
        min_seen = min(self._options.track.min_seen, looks)
        least = min_seen, self._options.min_confidence
        return _assemble(self._found, self._frames, self.landmarks, self._markers, least)

    def take(self) -> CameraTracks:
        """What was found since the last call, accidents and all, and forget it: frame by frame, in bounded memory.

        T is the number of frames since then; a slot is one track in all of them, `ids` say which.
        """
        found, first = self._found, self._taken
        self._found, self._taken = [], self._frames
        found = [f._replace(frame=f.frame - first) for f in found]
        return _assemble(found, self._frames - first, self.landmarks, self._markers, (0, 0.0))

    def _process_part(self, frames: ByteArray, parts: _Parts) -> None:
        backdrop, detector, tracker, reader = parts
        small = backdrop(frames)
        pictures = Pictures(frames, small)
        tracked = [tracker.step(detected) for detected in detector(small)]
        boxes = self._smoother(tracked)
        ids = np.stack([t.ids for t in tracked])
        seen = np.stack([t.seen for t in tracked])
        frame, slot = np.nonzero(ids >= 0)
        first = self._frames
        self._frames += len(frames)
        if not len(frame):
            return
        options, track = self._options, ids[frame, slot]
        poses = reader(pictures, frame, track, boxes[frame, slot])
        if options.refine_crop:
            poses = reader.refined(pictures, frame, track, poses, options.min_confidence, options.refine_change)
        missed = np.stack([t.missed for t in tracked])[frame, slot]
        unsure = poses.confidence < options.min_confidence
        duplicate = np.isin(track, reader.duplicates(frame, track, poses))
        # What sure landmarks in the last frame say of tracks that the detector has lost sight of.
        own = reader.own_boxes(poses)
        for row in np.flatnonzero((frame == len(frames) - 1) & missed & ~unsure):
            if duplicate[row]:
                tracker.end(int(slot[row]))
            else:
                tracker.confirm(int(slot[row]), own[row])
        keep = np.flatnonzero(~duplicate & ~(unsure & missed & ~_seen_later(ids, seen)[frame, slot]))
        frame, slot, poses = frame[keep], slot[keep], poses.select(keep)
        poses = poses._replace(boxes_px=reader.upright.around_in_frame(poses.boxes_px))
        arrays = tuple(values.astype(np.float32) for values in poses)
        self._found.append(_Found(frame + first, slot, track[keep], seen[frame, slot], poses.confidence, arrays))


class _Parts(NamedTuple):
    """What works on one camera's frames, once their size is known."""

    backdrop: BackgroundModel
    detector: PeopleDetector
    tracker: Tracker
    reader: PoseReader


def _seen_later(ids: IntArray, seen: BoolArray) -> BoolArray:
    """(n, P) whether a slot's track is detected in this or a later one of the n frames."""
    later = seen.copy()
    for index in range(len(ids) - 2, -1, -1):
        later[index] |= later[index + 1] & (ids[index] == ids[index + 1])
    return later


def _assemble(
    found: list[_Found], frames: int, landmarks: LandmarkSet, markers: int, least: tuple[int, float]
) -> CameraTracks:
    """Dense arrays from the chunks' poses, without tracks that were seen in fewer than `least` frames, or whose
    landmarks were less sure on average, and less than those of another one."""
    frame, slot, track, seen, sure = (
        np.concatenate([getattr(f, name) for f in found]) if found else np.empty(0, dtype=np.int64)
        for name in ("frame", "slot", "track", "seen", "sure")
    )
    times_seen = np.bincount(track, weights=seen)
    confidence = np.bincount(track, weights=sure) / np.maximum(np.bincount(track), 1)
    somebody = times_seen >= least[0]
    somebody &= confidence >= min(least[1], confidence[somebody].max(initial=0))
    keep = np.flatnonzero(somebody[track])
    frame, slot, track = frame[keep], slot[keep], track[keep]
    used, slot = np.unique(slot, return_inverse=True)
    count, slots = len(landmarks), max(1, len(used))

    def dense(which: int, shape: tuple[int, ...], missing: float) -> FloatArray:
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
        markers_px=dense(5, (markers, 2), np.nan) if markers else None,
        markers_variance_px2=dense(6, (markers,), np.nan) if markers else None,
        markers_score=dense(7, (markers,), 0.0) if markers else None,
    )


def first_frames(tracks: CameraTracks, frames: int) -> CameraTracks:
    """The tracks in the first `frames` frames."""
    if len(tracks.points_px) == frames:
        return tracks
    values = {f.name: getattr(tracks, f.name) for f in fields(tracks) if f.name != "landmarks"}
    return replace(tracks, **{name: array[:frames] for name, array in values.items() if array is not None})


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
    return Keypoints2D(
        landmarks=tracks[0].landmarks,
        points_px=_merged([t.points_px for t in tracks], np.nan),
        variance_px2=_merged([t.variance_px2 for t in tracks], np.nan),
        score=_merged([t.score for t in tracks], 0.0),
    )


def merge_markers(tracks: Sequence[CameraTracks]) -> Keypoints2D | None:
    """The virtual markers of the same people in the same slots as `merge_tracks`; None where there are none."""
    parts = [(t.markers_px, t.markers_variance_px2, t.markers_score) for t in tracks]
    points, variances, scores = ([p for p in part if p is not None] for part in zip(*parts, strict=True))
    if len(points) < len(tracks):
        return None
    return Keypoints2D(SURFACE, _merged(points, np.nan), _merged(variances, np.nan), _merged(scores, 0.0))


def _merged(parts: list[FloatArray], missing: float) -> FloatArray:
    """(C, T, P, ...) of the cameras' (T, p, ...), p padded to the most that one has."""
    slots = max(part.shape[1] for part in parts)
    result = np.full((len(parts), len(parts[0]), slots, *parts[0].shape[2:]), missing)
    for camera, part in enumerate(parts):
        result[camera, :, : part.shape[1]] = part
    return result
