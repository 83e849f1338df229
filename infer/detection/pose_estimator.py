"""2D landmarks of the people in one camera's video: detect, track, crop, run the network, decode."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.detection.background import BackgroundModel
from muybridge.infer.detection.crop_reader import Pictures, PoseReader
from muybridge.infer.detection.orientation import Letterbox, orientation_for
from muybridge.infer.detection.person_detector import PeopleDetector, PeopleOptions
from muybridge.infer.detection.tracker import BoxSmoother, Tracker, TrackOptions
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name, missing_value
from muybridge.infer.networks.external import open_keypoints
from muybridge.infer.networks.keypoints import OnnxOptions, PeopleNetwork

_log = logging.getLogger(__name__)

# Frames processed together: this bounds memory, and the smoothing of boxes looks ahead no further.
_FRAMES_AT_ONCE = 16


@dataclass(frozen=True)
class KeypointOptions:
    """How landmarks are detected in one camera's video.

    Attributes:
        people: the person detector.
        track: tracks from detections.
        onnx: how the networks run.
        refine_crop: crop again where the landmarks' own box differs from the detector's, and keep the result of higher
            confidence.
        refine_change: how much it has to differ, in centre or size, relative to the box.
        most_fps: frames per second in which landmarks are read, the others being interpolated unless people move fast;
            None for all frames. Set in a first pass over views that are all read again.
        min_confidence: mean score from which landmarks count as evidence of a person. A track with less over all its
            frames is dropped, whatever the detector reports, unless there is no better one.
    """

    people: PeopleOptions = field(default_factory=PeopleOptions)
    track: TrackOptions = field(default_factory=TrackOptions)
    onnx: OnnxOptions = field(default_factory=OnnxOptions)
    refine_crop: bool = True
    refine_change: float = 0.15
    most_fps: float | None = None
    min_confidence: float = 0.4


class _Found(NamedTuple):
    """The result of one chunk: K poses with their frame, slot and track; float32 to save memory on long takes.

    Boxes are in px of the frame here, around the upright ones.
    """

    frame: IntArray
    slot: IntArray
    track: IntArray
    seen: BoolArray
    confidence: FloatArray
    arrays: dict[str, Float32Array]


class PoseEstimator:
    """Landmarks of the people in one camera's video, chunk by chunk in order, or frame by frame (see `take`).

    The same chunks give the same results; other chunks may shift a box slightly, because smoothing looks ahead only
    within a chunk.
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
            options: of every step.
            model_card: of a third-party keypoint model: see `networks.external.open_keypoints`.
            markers: detect the virtual markers too.
            fps: frames per second.

        Raises:
            ModelError: a file is missing or cannot be used.
        """
        self._network = open_keypoints(keypoint_model, model_card, options.onnx, markers)
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
        """The body landmarks that the network finds."""
        return self._network.landmarks

    def process(self, frames: ByteArray, half: ByteArray | None = None, thin: bool = True) -> None:
        """Process the next frames.

        Args:
            frames: (n, H, W, 3) RGB, any n, the same size in every call.
            half: the same averaged over two by two pixels, where that is at hand.
            thin: landmarks of some frames may be interpolated (see `KeypointOptions.most_fps`).

        Raises:
            ValueError: frames of another type, or of another size than before or than the camera's.
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
            part = slice(start, start + _FRAMES_AT_ONCE)
            self._process_part(frames[part], None if half is None else half[part], self._parts, thin)

    def _start(self, width: int, height: int) -> _Parts:
        """The parts that depend on the size of the frames."""
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
            PeopleDetector(self._people, letterbox, people, self._fps),
            Tracker(upright.bounds, self._options.track, self._fps),
            PoseReader(self._network, camera, upright, backdrop, self._fps),
        )

    def background(self, tracks: CameraTracks) -> ByteArray | None:
        """(h, w, 3) the background of the frames so far without the people of `tracks`, at the detector's resolution;
        None with too few frames, or for a moving camera."""
        return None if self._parts is None else self._parts.backdrop.without(tracks.body.points_px, tracks.body.set)

    def finish(self) -> CameraTracks:
        """Everything detected so far; T is the number of frames processed, P the number of slots used."""
        passes = 0 if self._parts is None else self._parts.detector.passes
        min_seen = min(self._options.track.min_seen, passes)
        least = min_seen, self._options.min_confidence
        return _assemble(self._found, self._frames, self._network.sets, least)

    def take(self) -> CameraTracks:
        """What was detected since the last call, false detections included, then forgotten: frame by frame, in bounded
        memory.

        T is the number of frames since then; a slot is one track in all of them, `ids` say which.
        """
        found, first = self._found, self._taken
        self._found, self._taken = [], self._frames
        found = [f._replace(frame=f.frame - first) for f in found]
        return _assemble(found, self._frames - first, self._network.sets, (0, 0.0))

    def _process_part(self, frames: ByteArray, half: ByteArray | None, parts: _Parts, thin: bool) -> None:
        backdrop, detector, tracker, reader = parts
        small = backdrop(frames if half is None else half)
        pictures = Pictures(frames, small, half)
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
        most = options.most_fps
        every = max(1, int(self._fps / most)) if thin and most is not None else 1
        poses = reader.thinly(pictures, frame, track, boxes[frame, slot], every, options.min_confidence)
        if options.refine_crop:
            poses = reader.refined(pictures, frame, track, poses, options.min_confidence, options.refine_change)
        missed = np.stack([t.missed for t in tracked])[frame, slot]
        unsure = poses.confidence < options.min_confidence
        duplicate = np.isin(track, reader.duplicates(frame, track, poses))
        # Confident landmarks in the last frame confirm tracks that the detector has lost.
        own = reader.own_boxes(poses)
        for row in np.flatnonzero((frame == len(frames) - 1) & missed & ~unsure):
            if duplicate[row]:
                tracker.end(int(slot[row]))
            else:
                tracker.confirm(int(slot[row]), own[row])
        keep = np.flatnonzero(~duplicate & ~(unsure & missed & ~_seen_later(ids, seen)[frame, slot]))
        frame, slot, poses = frame[keep], slot[keep], poses.select(keep)
        poses = replace(poses, boxes_px=reader.upright.around_in_frame(poses.boxes_px))
        arrays = {name: values.astype(np.float32) for name, values in poses.arrays().items()}
        self._found.append(_Found(frame + first, slot, track[keep], seen[frame, slot], poses.confidence, arrays))


class _Parts(NamedTuple):
    """The steps for one camera's frames, once their size is known."""

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


def _assemble(found: list[_Found], frames: int, sets: Sequence[LandmarkSet], least: tuple[int, float]) -> CameraTracks:
    """Dense arrays from the chunks' poses.

    Args:
        found: of every chunk.
        frames: T.
        sets: landmark sets, the body's first.
        least: a track is dropped if it was seen in fewer frames, or if the mean confidence of its landmarks is lower
            than this and than that of another track.
    """
    frame, slot, track, seen, confidence = (
        np.concatenate([getattr(f, name) for f in found]) if found else np.empty(0, dtype=np.int64)
        for name in ("frame", "slot", "track", "seen", "confidence")
    )
    times_seen = np.bincount(track, weights=seen)
    mean = np.bincount(track, weights=confidence) / np.maximum(np.bincount(track), 1)
    somebody = times_seen >= least[0]
    somebody &= mean >= min(least[1], mean[somebody].max(initial=0))
    if not somebody.all():
        _log.debug("%d of %d tracks dropped: seen too seldom or of low confidence", (~somebody).sum(), len(somebody))
    keep = np.flatnonzero(somebody[track])
    frame, slot, track = frame[keep], slot[keep], track[keep]
    used, slot = np.unique(slot, return_inverse=True)
    slots = max(1, len(used))

    def dense(name: str, shape: tuple[int, ...]) -> FloatArray:
        values = np.full((frames, slots, *shape), missing_value(name.rpartition(".")[2]))
        if found:
            values[frame, slot] = np.concatenate([f.arrays[name] for f in found])[keep]
        return values

    ids = np.full((frames, slots), -1, dtype=np.int64)
    ids[frame, slot] = track
    landmarks = []
    for n, each in enumerate(sets):
        name, count = each.name, len(each)
        landmarks.append(
            LandmarkArrays(
                each,
                dense(f"{name}.points_px", (count, 2)),
                dense(f"{name}.variance_px2", (count,)),
                dense(f"{name}.score", (count,)),
                dense(f"{name}.visibility", (count,)) if n == 0 else None,
            )
        )
    return CameraTracks(by_name(landmarks), dense("boxes_px", (4,)), ids)
