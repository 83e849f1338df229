"""Top-down refinement: people read again in boxes predicted from 3D.

A detector misses people, or a track jumps to a neighbour; its boxes are rough, and one view alone often cannot separate
an arm from the body behind it, or left from right. Once a person is in 3D, the projections of their landmarks tell
where to crop, and serve as a prior where the network has two hypotheses for a landmark. The new landmarks are accepted
if they lie close to the prediction.
"""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray, IntArray
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.numerics.robust import row_median
from muybridge.geometry.sync.clocks import own_frames, resample_keypoints
from muybridge.infer.detection.crop_reader import Pictures, PoseReader, Poses, body_boxes, join_poses
from muybridge.infer.detection.detect import CODE, CameraResult, DetectOptions
from muybridge.infer.detection.exposure import stretch_frames
from muybridge.infer.detection.orientation import orientation_for
from muybridge.infer.detection.resample import (
    enough_rows,
    interpolate_poses,
    resample_tracks,
    runs_of,
    scatter_poses,
)
from muybridge.infer.detection.tracks import first_frames, merge_tracks, with_slots
from muybridge.infer.networks.external import open_keypoints
from muybridge.infer.networks.keypoints import Expectation
from muybridge.infer.networks.models import Models
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress, Task
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.runtime.threads import Stopped, in_threads
from muybridge.infer.session.session import Session
from muybridge.infer.session.video import read_chunks

# Prefix of arrays that were read without a prior.
_ALONE = "alone."
# A crop may be this much finer than the copy that it is cut from.
_FINE_ENOUGH = 0.9


@dataclass(frozen=True)
class RefinementOptions:
    """Which views of a person are read again, and which results are accepted.

    Attributes:
        enabled: read views again.
        most_fps: frames per second that are read of people who move slowly; the others are interpolated.
        everywhere: in every view, not only in those that lack the person: more accurate landmarks for twice the
            network's time.
        expected_sd: standard deviation of the prior on a landmark, in sides of the crop. It is wide, so that it decides
            between hypotheses and hardly moves a sharp one.
        expected_most: largest penalty of the prior, nats; 0 for no prior.
        min_known: share of the landmarks that must be known in 3D and lie in the image.
        min_agreeing: a camera whose landmarks agree with the others' in a smaller share than this has someone else.
        max_distance: largest median distance from the prediction, in longer sides of the box.
    """

    enabled: bool = True
    everywhere: bool = True
    most_fps: float = 30.0
    expected_sd: float = 0.08
    expected_most: float = 2.0
    min_known: float = 0.5
    min_agreeing: float = 0.2
    max_distance: float = 0.12

    def __post_init__(self) -> None:
        if self.expected_sd <= 0 or self.expected_most < 0:
            raise ValueError("expected_sd must be positive, expected_most not negative")


class RefinedTake(NamedTuple):
    """The take with the refined landmarks.

    Attributes:
        keypoints: by landmark set, with one more slot in every camera.
        alone: the body's landmarks as each view reads them without a prior from the others, for measuring agreement.
        slots: (C, T) the person's slot in every camera and frame.
        stages: of the cameras that were read again, by name.
    """

    keypoints: dict[str, Keypoints2D]
    alone: Keypoints2D
    slots: IntArray
    stages: dict[str, StageResult]


def seeing_views(session: Session, points: Points3D, options: RefinementOptions) -> BoolArray:
    """(C, T) whether a camera should see enough of the person's landmarks."""
    known = np.isfinite(points.points_world).all(-1)
    result = np.zeros((len(session.cameras), points.points_world.shape[0]), dtype=np.bool_)
    for c, camera in enumerate(session.cameras):
        px = camera.project_seen(points.points_world)
        inside = ((px >= 0) & (px <= [camera.width - 1, camera.height - 1])).all(-1) & known
        result[c] = inside.mean(1) >= options.min_known
    return result


def missing_views(session: Session, slots: IntArray, points: Points3D, options: RefinementOptions) -> BoolArray:
    """(C, T) whether a camera should see the person but has nobody, or somebody else.

    Args:
        session: C cameras.
        slots: (C, T) the person's, -1 where there is none.
        points: the person's landmarks, triangulated.
        options: which views are read again.
    """
    known = np.isfinite(points.points_world).all(-1)
    result = seeing_views(session, points, options)
    for c in range(len(result)):
        there = np.isfinite(points.residual_px[c]) & known
        agreeing = (points.inlier[c] & there).sum(1) / np.maximum(there.sum(1), 1)
        result[c] &= (slots[c] < 0) | (there.any(1) & (agreeing < options.min_agreeing))
    return result


@dataclass(frozen=True)
class TopDownRefinement:
    """Reads a person's views again; see `__call__`.

    Attributes:
        session: C cameras and their videos.
        detected: the cameras' results of the first pass.
        file_names: (C,) the cameras' names as file names.
        models: the networks.
        store: where finished stages are.
        detect: how 2D landmarks are detected.
        options: which views are read again.
        progress: receives progress messages.
    """

    session: Session
    detected: Sequence[CameraResult]
    file_names: Sequence[str]
    models: Models
    store: StageStore
    detect: DetectOptions
    options: RefinementOptions
    progress: Progress

    def __call__(
        self, slots: IntArray, points: Points3D, expected: Points3D | None = None, number: str = ""
    ) -> RefinedTake | None:
        """Read the person's views again; None where nothing new was found.

        Args:
            slots: (C, T) the person's, -1 where there is none.
            points: the person's landmarks, triangulated from the first pass.
            expected: the same, smoothed; `points` if absent.
            number: of the person, for the names of files.
        """
        if not self.options.enabled:
            return None
        expected = expected or points
        missing = missing_views(self.session, slots, points, self.options)
        wanted = missing | seeing_views(self.session, expected, self.options) if self.options.everywhere else missing
        frames = np.arange(wanted.shape[1])
        readable = np.stack([~found.unreadable[self._own(c, frames)] for c, found in enumerate(self.detected)])
        missing, wanted = missing & readable, wanted & readable
        if not wanted.any():
            return None
        cameras = np.flatnonzero(wanted.any(axis=1)).tolist()
        stop = threading.Event()
        with self.progress.task("refinement", int(wanted.sum())) as task:
            jobs = [partial(self._read, c, np.flatnonzero(wanted[c]), expected, number, task, stop) for c in cameras]
            results = in_threads(jobs, self.detect.workers, stop)
        return self._merge(slots, missing, wanted, dict(zip(cameras, results, strict=True)), number)

    def _merge(
        self, slots: IntArray, missing: BoolArray, wanted: BoolArray,
        results: dict[int, StageResult], number: str,
    ) -> RefinedTake | None:  # fmt: skip
        """The take with the cameras' new stages merged in."""
        tracks = [d.tracks for d in self.detected]
        extra = max(t.ids.shape[1] for t in tracks)
        tracks = [t.map(lambda name, array: with_slots(name, array, extra + 1)) for t in tracks]
        alone = [t.map(lambda _, array: array.copy()) for t in tracks]
        slots = slots.copy()
        for c, stage in results.items():
            at, found = np.flatnonzero(wanted[c]), stage.arrays["found"]
            own = self._own(c, at)
            for those, kind in ((tracks[c], ""), (alone[c], _ALONE)):
                values = those.arrays()
                for key in values.keys() & stage.arrays.keys():
                    values[key][own[found], extra] = stage.arrays.get(kind + key, stage.arrays[key])[found]
                values["ids"][own[found], extra] = values["ids"].max() + 1
            slots[c, at[found]] = extra
            if missing[c].any():
                self.progress.say(
                    f"{self.session.cameras.names[c]}: lacked the person in {int(missing[c].sum())} frames, "
                    f"and has them now in {int(found[missing[c][at]].sum())}"
                )
        if not any(stage.arrays["found"].any() for stage in results.values()):
            return None
        tracks, alone = (
            [resample_tracks(self.session, c, first_frames(t, slots.shape[1]), self.detected[c].repeats)
             for c, t in enumerate(those)] for those in (tracks, alone)
        )  # fmt: skip
        body = tracks[0].body.set.name
        return RefinedTake(
            {name: self._synchronise(found) for name, found in merge_tracks(tracks).items()},
            self._synchronise(merge_tracks(alone)[body]), slots,
            {f"2D {self.file_names[c]}{number}, refined": stage for c, stage in results.items()},
        )  # fmt: skip

    def _synchronise(self, found: Keypoints2D) -> Keypoints2D:
        """Landmarks of cameras with different clocks at the times of the take."""
        return resample_keypoints(found, self.session.clocks, self.session.fps)

    def _own(self, c: int, frames: IndexArray) -> IndexArray:
        """The camera's own frames for frames of the session."""
        return own_frames(self.session.clocks, c, frames, self.session.fps, self.detected[c].tracks.frames)

    def _every(self, c: int) -> int:
        """In which frames a camera is read; in all where some are repeats of others."""
        if self.session.clocks is not None or self.detected[c].own_repeats.any():
            return 1
        return max(1, int(self.session.fps / self.options.most_fps))

    def _copies_scale(self, c: int, reader: PoseReader, boxes_px: FloatArray) -> int:
        """The scale of the copies that show the boxes (K, 4) of a camera as well as its frames do; 1 where they do
        not, or there are none."""
        scale = self.detected[c].copies_scale
        if scale < 2 or self.detected[c].stretched or not len(boxes_px):
            return 1
        return scale if reader.coarseness(boxes_px).min() >= _FINE_ENOUGH * scale else 1

    def _read(
        self, c: int, wanted: IndexArray, expected: Points3D, number: str, task: Task, stop: threading.Event
    ) -> StageResult:
        """One camera's stage: `found` (n,) and the arrays of `Poses` for the frames `wanted` (n,); the names of arrays
        read without a prior begin with `alone.`."""
        name, camera, world = f"refined{number}-{self.file_names[c]}", self.session.cameras[c], expected.points_world
        own = self._own(c, wanted)
        how = self.options, self.detect.keypoints  # the first pass may not have mirrored the crops
        key = digest(self.detected[c].stage.key, own, world[wanted], how, code_digest(*CODE))
        stored = self.store.load(name, key)
        if stored is not None:
            task.advance(len(wanted))
            return stored
        start = time.perf_counter()
        network = open_keypoints(
            self.models.keypoints, self.models.model_card, self.detect.keypoints.onnx, self.detect.markers != "none"
        )
        backdrop = self.detected[c].background_model()
        level = self.session.level_cameras[c]
        reader = PoseReader(
            network, level, orientation_for(level, level.width, level.height), backdrop, self.session.fps
        )
        predicted = camera.project_seen(world[wanted])
        # The crop covers the part of the person within the image.
        within = np.clip(predicted, 0, [camera.width - 1, camera.height - 1])
        boxes = body_boxes(reader.upright.to_upright(within), network.landmarks)
        chosen = enough_rows(own, predicted, boxes, self._every(c))
        frames, order = np.unique(own[chosen], return_inverse=True)
        looked = np.flatnonzero(chosen)
        parts, begin = [], 0
        scale = self._copies_scale(c, reader, boxes)
        if scale > 1:
            chunks = self.detected[c].read_copies(frames)
        else:
            indices = self.session.frame_indices[c][frames]
            chunks = stretch_frames(read_chunks(self.session.videos[c], indices, reuse=True))
        for chunk in chunks:
            if stop.is_set():
                raise Stopped
            here = np.flatnonzero((order >= begin) & (order < begin + len(chunk)))
            where = Expectation(predicted[looked[here]], self.options.expected_sd, self.options.expected_most)
            pictures = Pictures(chunk, backdrop(chunk) if network.channels > 3 else None, scale=scale)
            parts.append((here, reader.expecting(pictures, order[here] - begin, boxes[looked[here]], where)))
            begin += len(chunk)
            task.advance(len(here))
        back = np.argsort(np.concatenate([here for here, _ in parts]), kind="stable")
        poses, alone = (
            _completed(join_poses(each).select(back), own, chosen, boxes)
            for each in zip(*(both for _, both in parts), strict=True)
        )
        away = np.linalg.norm(poses.body.points_px - predicted, axis=-1)
        side = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
        near = row_median(away, 1) < self.options.max_distance * side  # never where no landmark is in both
        arrays = poses.arrays() | {"found": near & (poses.confidence >= self.detect.keypoints.min_confidence)}
        arrays["boxes_px"] = reader.upright.around_in_frame(poses.boxes_px)
        name_of_body = alone.body.set.name
        for field in ("points_px", "variance_px2", "score"):
            arrays[f"{_ALONE}{name_of_body}.{field}"] = getattr(alone.body, field)
        return self.store.save(name, key, arrays, {}, time.perf_counter() - start)


def _completed(poses: Poses, frames: IndexArray, read: BoolArray, boxes_px: FloatArray) -> Poses:
    """Poses in all `frames` (n,), of which those `read` (n,) have been read, interpolated between these."""
    if read.all():
        return poses
    whole = scatter_poses(poses, read, boxes_px)
    for run in runs_of(frames):
        interpolate_poses(whole, run, read[run])
    return whole
