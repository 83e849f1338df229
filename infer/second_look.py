"""People looked for again where the other cameras know that they are: boxes predicted from 3D.

A detector misses people, or a track jumps to a neighbour. Once the others have put the person into 3D, their
landmarks seen from the camera that lacks them say where to crop; what the network finds there counts if it lies
on that prediction.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.clocks import Clock, own_frames
from muybridge.geometry.landmarks import Keypoints2D, Points3D
from muybridge.geometry.robust import row_median
from muybridge.infer.detect import CameraResult, DetectOptions, Models
from muybridge.infer.keypoints import CameraTracks, merge_markers, merge_tracks
from muybridge.infer.other_models import open_keypoints
from muybridge.infer.poses import PoseReader, Poses, body_boxes
from muybridge.infer.progress import Progress
from muybridge.infer.session import Session
from muybridge.infer.stages import StageResult, StageStore, code_digest, digest
from muybridge.infer.upright import upright_for
from muybridge.infer.video import read_chunks

_Floats = NDArray[np.float64]
_CODE = ("muybridge.infer.second_look", "muybridge.infer.poses", "muybridge.infer.onnx", "muybridge.infer.crops")


@dataclass(frozen=True)
class SecondLookOptions:
    """When a person is looked for again, and what counts as found.

    Attributes:
        enabled: look again at all.
        min_known: share of the landmarks that has to be known in 3D, and to lie in the image.
        min_agreeing: a camera whose landmarks fit the others' in a smaller share than this has someone else.
        max_distance: median distance from the prediction, in longer sides of the box, up to which it is them.
    """

    enabled: bool = True
    min_known: float = 0.5
    min_agreeing: float = 0.2
    max_distance: float = 0.12


class Again(NamedTuple):
    """The take with what was found at the second look.

    Attributes:
        keypoints: as before, with one more slot in every camera.
        markers: the same of the markers.
        slots: (C, T) the person's slot in every camera and frame.
        stages: of the cameras that looked again, by name.
    """

    keypoints: Keypoints2D
    markers: Keypoints2D | None
    slots: NDArray[np.int64]
    stages: dict[str, StageResult]


def missing_views(
    session: Session, slots: NDArray[np.int64], points: Points3D, options: SecondLookOptions
) -> NDArray[np.bool_]:
    """(C, T) whether a camera should see the person and has nobody, or somebody else.

    Args:
        session: C cameras.
        slots: (C, T) the person's, -1 where there is none.
        points: the person's landmarks, triangulated.
        options: when to look again.
    """
    known = np.isfinite(points.points_world).all(-1)
    result = np.zeros(slots.shape, dtype=np.bool_)
    for c, camera in enumerate(session.cameras):
        px = camera.project(points.points_world)
        inside = ((px >= 0) & (px <= [camera.width - 1, camera.height - 1])).all(-1) & known
        there = np.isfinite(points.residual_px[c]) & known
        agreeing = (points.inlier[c] & there).sum(1) / np.maximum(there.sum(1), 1)
        wrong = (slots[c] < 0) | (there.any(1) & (agreeing < options.min_agreeing))
        result[c] = wrong & (inside.mean(1) >= options.min_known)
    return result


@dataclass(frozen=True)
class SecondLook:
    """Looks again at a session's videos; see `__call__`.

    Attributes:
        session: C cameras and their videos.
        detected: what the cameras found at first.
        file_names: (C,) the cameras' names as file names.
        models: the networks.
        store: where finished stages are.
        detect: how 2D landmarks are found.
        options: when to look again.
        progress: whom to tell.
        clocks: (C,) of the cameras where they run apart.
        in_step: puts landmarks of cameras that run apart in step.
    """

    session: Session
    detected: Sequence[CameraResult]
    file_names: Sequence[str]
    models: Models
    store: StageStore
    detect: DetectOptions
    options: SecondLookOptions
    progress: Progress
    clocks: Sequence[Clock] | None
    in_step: Callable[[Keypoints2D], Keypoints2D]

    def __call__(self, slots: NDArray[np.int64], points: Points3D) -> Again | None:
        """What the cameras that lack the person find where the others know them; None where nothing is new.

        Args:
            slots: (C, T) the person's, -1 where there is none.
            points: the person's landmarks, triangulated from the first look.
        """
        if not self.options.enabled:
            return None
        missing = missing_views(self.session, slots, points, self.options)
        if not missing.any():
            return None
        tracks = [d.tracks for d in self.detected]
        extra = max(t.points_px.shape[1] for t in tracks)
        tracks = [_with(t, {name: _widened(name, a, extra + 1) for name, a in _arrays(t).items()}) for t in tracks]
        slots, stages = slots.copy(), {}
        for c in np.flatnonzero(missing.any(axis=1)).tolist():
            wanted = np.flatnonzero(missing[c])
            own = own_frames(self.clocks, c, wanted, self.session.fps, len(tracks[c].points_px))
            name = f"2D {self.file_names[c]}, second look"
            stages[name] = stage = self._look(c, own, points.points_world[wanted])
            found = stage.arrays["found"]
            values = _arrays(tracks[c])
            for key in values.keys() & stage.arrays.keys():
                values[key][own[found], extra] = stage.arrays[key][found]
            values["ids"][own[found], extra] = values["ids"].max() + 1
            slots[c, wanted[found]] = extra
            self.progress.say(f"{self.session.cameras.names[c]}: looked again in {len(wanted)} frames, "
                              f"found the person in {int(found.sum())}")  # fmt: skip
        if not any(stage.arrays["found"].any() for stage in stages.values()):
            return None
        frames = range(slots.shape[1])
        tracks = [_with(t, {k: a[: len(frames)] for k, a in _arrays(t).items()}) for t in tracks]
        markers = merge_markers(tracks)
        return Again(
            self.in_step(merge_tracks(tracks)), None if markers is None else self.in_step(markers), slots, stages
        )

    def _look(self, c: int, own: NDArray[np.intp], points_world: _Floats) -> StageResult:
        """One camera's stage: `found` (n,) and the arrays of `CameraTracks` for its own frames `own` (n,)."""
        file, camera = self.file_names[c], self.session.cameras[c]
        key = digest(self.detected[c].stage.key, own, points_world, self.options, code_digest(*_CODE))
        stored = self.store.load(f"again-{file}", key)
        if stored is not None:
            return stored
        start = time.perf_counter()
        network = open_keypoints(
            self.models.keypoints, self.models.model_card, self.detect.keypoints.onnx, self.detect.markers != "none"
        )
        reader = PoseReader(network, camera, upright_for(camera, camera.width, camera.height))
        predicted = camera.project(points_world)
        boxes = body_boxes(reader.upright.to_upright(predicted), network.landmarks)
        frames, order = np.unique(own, return_inverse=True)
        parts, begin = [], 0
        for chunk in read_chunks(self.session.videos[c], self.session.frame_indices[c][frames]):
            here = np.flatnonzero((order >= begin) & (order < begin + len(chunk)))
            parts.append((here, reader(chunk, order[here] - begin, boxes[here])))
            begin += len(chunk)
        at = np.concatenate([here for here, _ in parts])
        poses = Poses(*(np.concatenate([p[k] for _, p in parts]) for k in range(len(parts[0][1]))))
        poses = poses.select(np.argsort(at, kind="stable"))
        away = np.linalg.norm(poses.points_px - predicted, axis=-1)
        side = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
        near = row_median(away, 1) < self.options.max_distance * side  # never where nothing is in both
        arrays = poses._asdict() | {"found": near & (poses.sureness >= self.detect.keypoints.min_sure)}
        arrays["boxes_px"] = reader.upright.around_in_frame(poses.boxes_px)
        return self.store.save(f"again-{file}", key, arrays, {}, time.perf_counter() - start)


def _with(tracks: CameraTracks, arrays: dict[str, NDArray[np.generic]]) -> CameraTracks:
    changed: dict[str, Any] = dict(arrays)
    return replace(tracks, **changed)


def _arrays(tracks: object) -> dict[str, NDArray[np.generic]]:
    """The arrays of `CameraTracks` by name."""
    return {name: value for name, value in vars(tracks).items() if isinstance(value, np.ndarray)}


def _widened(name: str, array: NDArray[np.generic], slots: int) -> NDArray[np.generic]:
    """(T, P, ...) of that name with empty slots added up to `slots`."""
    empty = {"ids": -1, "score": 0.0, "visibility": 0.0, "markers_score": 0.0}.get(name, np.nan)
    result = np.full((len(array), slots, *array.shape[2:]), empty, dtype=array.dtype)
    result[:, : array.shape[1]] = array
    return result
