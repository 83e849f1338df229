"""2D landmarks of every camera; small copies of the frames are kept for what needs them again.

Each camera is a stage of its own. Two cameras are processed in parallel (decoding and the networks release Python's
lock), each in bounded memory.
"""

import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import MarkerChoice
from muybridge.infer.detection.background import BackgroundModel
from muybridge.infer.detection.exposure import stretch_contrast
from muybridge.infer.detection.frozen_frames import RepeatedFrames, find_frozen
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox, orientation_for
from muybridge.infer.detection.pose_estimator import KeypointOptions, PoseEstimator
from muybridge.infer.detection.tracks import CameraTracks, tracks_from, with_rest, without_frames
from muybridge.infer.networks.keypoints import OnnxOptions
from muybridge.infer.networks.models import Models
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress, Task
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.runtime.threads import Stopped, in_threads
from muybridge.infer.session.damage import DamageWatch, damage_notice
from muybridge.infer.session.frame_copies import CopyWriter, halved, holds, read_copies, times_halved
from muybridge.infer.session.session import Session
from muybridge.infer.session.video import read_chunks
from muybridge.models.keypoints.test_time import FIRST_PASS
from muybridge.models.shipped import Precision

# Of a camera's name within a file name, which may have 255 bytes.
_NAME_BYTES = 150
# Landmarks are read so many times a second in a first pass.
FIRST_FPS = 12.0
# Of a stage's arrays and facts.
_PLATE, _REPEATS, _STILL_FROM, _LETTERBOX = "plate", "repeats", "still_from", "frames_width_height_angle_and_long_side"
_DAMAGED, _UNREADABLE = "damaged_frames_of_the_video", "unreadable"
_COPY_ENDS, _COPY_SCALE, _STRETCHED = "copies_end", "copies_scale", "contrast_was_stretched"
# The code that 2D landmarks depend on.
CODE = (
    "muybridge.geometry",
    "muybridge.models",
    "muybridge.infer.detection",
    "muybridge.infer.networks",
    "muybridge.infer.session",
)


@dataclass(frozen=True)
class DetectOptions:
    """How 2D landmarks are detected.

    Attributes:
        precision: of the shipped keypoint network: `int8` reads every crop twice, once mirrored, in the time that
            `fp32` needs for one reading, and is more accurate for it.
        keypoint_model: keypoint network to use in place of the shipped one, whatever its precision.
        model_card: inputs and outputs of that network, where it is not one of muybridge's: a TOML file, or the name of
            a shipped card, such as `rtmpose-coco17`.
        people_model: person detector to use in place of the shipped one.
        markers: virtual markers on the skin, written to `markers.c3d` under a laboratory's names: the 39 of Plug-in
            Gait, the 41 of CMU, or all 72.
        workers: cameras processed at the same time; each takes about half a gigabyte.
        keypoints: how each camera's landmarks are detected.
    """

    precision: Precision = "int8"
    keypoint_model: Path | None = None
    model_card: str | None = None
    people_model: Path | None = None
    markers: MarkerChoice = "none"
    workers: int = 2
    keypoints: KeypointOptions = field(default_factory=KeypointOptions)

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError("workers must be at least 1")

    @property
    def onnx(self) -> OnnxOptions:
        """How the networks run."""
        return self.keypoints.onnx


@dataclass(frozen=True)
class CameraResult:
    """A camera's finished 2D stage.

    Attributes:
        tracks: its landmarks in its own frames.
        copies: file of small copies of its frames.
        stage: key and timing.
        frozen_from: the frame from which its video is frozen to its end, if it is.
    """

    tracks: CameraTracks
    copies: Path
    stage: StageResult
    frozen_from: int | None = None

    @property
    def plate(self) -> ByteArray | None:
        """(h, w, 3) the background of the whole video, at the detector's resolution; None where there is none."""
        return self.stage.arrays.get(_PLATE)

    @property
    def own_repeats(self) -> BoolArray:
        """(T,) which frames of the video repeat the one before, judged by this camera alone."""
        return self.stage.arrays[_REPEATS]

    @property
    def repeats(self) -> BoolArray:
        """(T,) the same, and those in which the video is frozen to its end, judged by the other cameras."""
        own = self.own_repeats
        return own if self.frozen_from is None else own | (np.arange(len(own)) >= self.frozen_from)

    @property
    def damaged(self) -> BoolArray:
        """(frames,) which frames of the video were decoded from broken data."""
        return self.stage.arrays[_DAMAGED]

    @property
    def unreadable(self) -> BoolArray:
        """(T,) frames of the take in which nobody is looked for: the video is damaged there, or has ended."""
        return self.stage.arrays[_UNREADABLE]

    @property
    def still_from(self) -> int:
        """The frame from which all frames to the end look the same; the number of frames if none do."""
        return int(self.stage.arrays[_STILL_FROM])

    @property
    def copies_scale(self) -> int:
        """Over how many by how many pixels the copies are averaged; 0 where there are none: the take is too long for
        them, or its frames are small."""
        return int(self.stage.facts.get(_COPY_SCALE, 0)) if len(self.stage.arrays.get(_COPY_ENDS, ())) else 0

    @property
    def stretched(self) -> bool:
        """Whether the contrast of any frame was stretched: too much for what a copy keeps."""
        return bool(self.stage.facts.get(_STRETCHED, True))

    def read_copies(self, frames: IndexArray | None = None) -> Iterator[ByteArray]:
        """Chunks of the copies of the take's frames (default all), where there are any."""
        return read_copies(self.copies, self.stage.arrays[_COPY_ENDS], frames)

    def background_model(self) -> BackgroundModel:
        """The background of the whole video, for reading it again: in the orientation of the first pass, because the
        camera's pose may have been refined since."""
        width, height, angle, long_side = self.stage.facts[_LETTERBOX]
        letterbox = Letterbox(FrameOrientation(width, height, angle), long_side)
        return BackgroundModel(letterbox, self.plate is not None, self.plate)


def detect(
    session: Session,
    file_names: Sequence[str],
    models: Models,
    store: StageStore,
    options: DetectOptions,
    progress: Progress,
) -> list[CameraResult]:
    """2D landmarks of every camera, from disk where they are there already.

    Args:
        session: C cameras and their videos.
        file_names: (C,) the cameras' names as file names.
        models: the networks.
        store: where finished stages are, and the copies.
        options: of the detection.
        progress: receives progress messages.

    Returns:
        C results. Where a container does not list its frames, a video may have fewer than `session.frames`.

    Raises:
        VideoError: a video cannot be read to its end.
    """
    stop = threading.Event()
    with progress.task("2D landmarks", len(file_names) * session.frames) as task:
        work = [
            _CameraWork(session, c, name, models, store, options, progress, task, stop)
            for c, name in enumerate(file_names)
        ]
        found = in_threads([w.run for w in work], options.workers, stop)
    starts = find_frozen([d.tracks for d in found], [d.still_from for d in found], session.fps)
    return [replace(d, frozen_from=start) for d, start in zip(found, starts, strict=True)]


def damage_notices(session: Session, found: Sequence[CameraResult]) -> list[str]:
    """Sentences about damaged frames of the videos (C,)."""
    notices = (damage_notice(v.path.name, d.damaged) for v, d in zip(session.videos, found, strict=True))
    return [notice for notice in notices if notice is not None]


def is_finished(
    session: Session, file_names: Sequence[str], models: Models, store: StageStore, options: DetectOptions
) -> bool:
    """Whether `detect` with the same arguments would find all of its results in the store."""
    return all(store.holds(_stage(name), _key(session, c, models, options)) for c, name in enumerate(file_names))


def first_pass(options: DetectOptions) -> DetectOptions:
    """Faster options for a first pass over views that are all read again with mirrored and larger crops."""
    keypoints, onnx = options.keypoints, options.keypoints.onnx
    if onnx.flip is None:
        onnx = replace(onnx, flip=False)
    if onnx.size is None:  # a stated size is what the network sees in both passes
        onnx = replace(onnx, size=FIRST_PASS)
    most = FIRST_FPS if keypoints.most_fps is None else keypoints.most_fps
    return replace(options, keypoints=replace(keypoints, onnx=onnx, most_fps=most))


def _stage(name: str) -> str:
    return f"landmarks-{name}"


def _copies(store: StageStore, name: str) -> Path:
    return store.folder / f"frames-{name}.jpegs"


def _key(session: Session, index: int, models: Models, options: DetectOptions) -> str:
    """The key of a camera's 2D stage."""
    video = session.videos[index]
    return digest(
        [video.content, video.rotation_deg],
        session.frame_indices[index],
        session.lasts(index),
        session.fps,
        session.level_cameras[index],
        options.keypoints,
        options.markers != "none",
        models.metadata,
        code_digest(*CODE),
    )


@dataclass(frozen=True)
class _CameraWork:
    """One camera's 2D stage."""

    session: Session
    index: int
    name: str
    models: Models
    store: StageStore
    options: DetectOptions
    progress: Progress
    task: Task
    stop: threading.Event

    @property
    def copies(self) -> Path:
        return _copies(self.store, self.name)

    def run(self) -> CameraResult:
        stage, key = _stage(self.name), _key(self.session, self.index, self.models, self.options)
        stored = self.store.load(stage, key)
        if stored is not None and holds(self.copies, stored.arrays[_COPY_ENDS]):
            self.progress.say(f"{self.name}: 2D landmarks resumed from {self.store.folder / (stage + '.npz')}")
            self.task.advance(self.session.frames)
            return CameraResult(_tracks(stored, self.models), self.copies, stored)
        start = time.perf_counter()
        tracks, others, facts = self._compute()
        arrays: dict[str, NDArray[Any]] = {
            name: values if name == "ids" else values.astype(np.float32) for name, values in tracks.arrays().items()
        }
        arrays |= others
        camera = self.session.level_cameras[self.index]
        long_side = int(self.models.metadata["people"]["input_long_side"])
        upright = orientation_for(camera, camera.width, camera.height)
        facts |= {_LETTERBOX: [upright.width, upright.height, upright.angle, long_side]}
        result = self.store.save(stage, key, arrays, facts, time.perf_counter() - start)
        return CameraResult(_tracks(result, self.models), self.copies, result)

    def _compute(self) -> tuple[CameraTracks, dict[str, NDArray[Any]], dict[str, Any]]:
        """The camera's tracks, and the arrays and facts that its stage keeps besides."""
        video, camera = self.session.videos[self.index], self.session.level_cameras[self.index]
        models = self.models
        estimator = PoseEstimator(
            models.keypoints, models.people, camera, self.options.keypoints, models.model_card,
            self.options.markers != "none", self.session.fps,
        )  # fmt: skip
        repeats, watch = RepeatedFrames(video.width, video.height), DamageWatch(video)
        lasts = self.session.lasts(self.index)
        index = self.session.frame_indices[self.index, :lasts]
        smaller, stretched = times_halved(video.width, video.height), False
        half: ByteArray | None = None
        with CopyWriter(self.copies) as copies:
            for frames in read_chunks(video, index, watch=watch, reuse=True):
                if self.stop.is_set():
                    raise Stopped
                half = _all_halved(frames, half) if smaller else None
                for k, frame in enumerate(frames):
                    repeats.add(frame if half is None else half[k])
                    if half is not None:
                        copies.add(half[k])
                    if stretch_contrast(frame):
                        stretched = True
                        if half is not None:
                            halved(frame, half[k])
                estimator.process(frames, half, not repeats.among_last(len(frames)))
                self.task.advance(len(frames))
        self.task.advance(self.session.frames - lasts)
        tracks = estimator.finish()
        damaged, plate = watch.damaged(), estimator.background(tracks)
        # A video that ends early has nobody in the rest of the take; one that is shorter than its header says is
        # noticed by its number of frames.
        rest = self.session.frames - lasts if tracks.frames == lasts else 0
        still_from = repeats.still_from + (rest if repeats.still_from == tracks.frames else 0)
        confirmed = np.append(repeats.confirmed(tracks), np.zeros(rest, np.bool_))
        unreadable = np.append(damaged[index[: tracks.frames]], np.ones(rest, np.bool_))
        others = {
            _REPEATS: confirmed, _STILL_FROM: np.array(still_from), _DAMAGED: damaged, _UNREADABLE: unreadable,
            _COPY_ENDS: copies.ends,
        } | ({} if plate is None else {_PLATE: plate})  # fmt: skip
        facts = {_COPY_SCALE: 2**smaller, _STRETCHED: stretched}
        return without_frames(with_rest(tracks, rest), unreadable), others, facts


def _all_halved(frames: ByteArray, memory: ByteArray | None) -> ByteArray:
    """(n, H, W, 3) frames averaged over two by two pixels, in the memory of the chunk before where that fits."""
    count, height, width, channels = frames.shape
    shape = count, height // 2, width // 2, channels
    out = np.empty(shape, np.uint8) if memory is None or len(memory) < count else memory[:count]
    for frame, half in zip(frames, out, strict=True):
        halved(frame, half)
    return out


def _tracks(stage: StageResult, models: Models) -> CameraTracks:
    """Tracks from a stored or just computed stage: the same to the bit in both cases."""
    values = {name: a if name == "ids" else a.astype(np.float64) for name, a in stage.arrays.items()}
    return tracks_from(values, models.sets)


def file_names(cameras: Sequence[str]) -> tuple[str, ...]:
    """The cameras' names as file names: special characters replaced, all different."""
    names: list[str] = []
    for camera in cameras:
        kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in camera).lstrip(".") or "camera"
        kept = kept.encode()[:_NAME_BYTES].decode(errors="ignore")
        name, count = kept, 1
        while name.lower() in (n.lower() for n in names):
            count += 1
            name = f"{kept}-{count}"
        names.append(name)
    return tuple(names)
