"""From videos of bright markers to labelled markers, a moving skeleton, files and a report."""

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import SessionError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import MarkerPlan, MarkerSet
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.markers.cleaning import Sample, clean_markers
from muybridge.infer.detection.blobs import BlobOptions
from muybridge.infer.detection.detect import file_names
from muybridge.infer.labelling.label import label_points
from muybridge.infer.networks.correction import SolverNetwork
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.reconstruction.body import (
    BodySolution,
    body_facts,
    fit_labelled_markers,
    open_corrector,
    unpack_body,
)
from muybridge.infer.reconstruction.marker_videos import (
    MarkerVideoOptions,
    blobs_of,
    find_markers,
    nearest_blobs,
    pack_blobs,
    triangulate_again,
    unpack_blobs,
)
from muybridge.infer.report.data import ReportData
from muybridge.infer.report.page import problems, write_report
from muybridge.infer.results.names import (
    DEFAULT_OUT,
    MOTION_BVH,
    MOTION_GLB,
    MOTION_MOT,
    POINTS_C3D,
    POINTS_TRC,
    REPORT,
)
from muybridge.infer.results.provenance import session_facts, versions
from muybridge.infer.results.record import json_value
from muybridge.infer.results.run import Run
from muybridge.infer.runtime.digests import code_digest, file_digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import Arrays, Facts, StageResult, Stages
from muybridge.infer.runtime.threads import opencv_in_one_thread
from muybridge.infer.session.damage import DamageWatch, damage_notice
from muybridge.infer.session.probe import VideoInfo
from muybridge.infer.session.session import Session, SessionOptions, open_session, with_frames, with_notice
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set

UNNAMED = "unnamed.c3d"
MOTIONS = MOTION_BVH, MOTION_GLB, MOTION_MOT
RESULTS = (UNNAMED, POINTS_C3D, POINTS_TRC, *MOTIONS, REPORT)
_FEWEST_MARKERS = 6
# The code that the stages depend on.
_CODE = ("muybridge.geometry", "muybridge.models", "muybridge.infer.detection", "muybridge.infer.labelling",
         "muybridge.infer.networks", "muybridge.infer.reconstruction", "muybridge.infer.session")  # fmt: skip


@dataclass(frozen=True)
class MarkerVideoResult:
    """A finished run on marker videos.

    Attributes:
        out: the results folder.
        session: the session.
        plan: the marker set.
        facts: figures of the markers, as in `run.json`.
        body: the fitted body.
        seconds: how long it took.
    """

    out: Path
    session: Session
    plan: MarkerPlan
    facts: dict[str, Any]
    body: BodySolution
    seconds: float

    @property
    def summary(self) -> str:
        """One line about the result."""
        session, markers = self.session, self.plan.markers
        return (
            f"{self.out}: {session.frames} frames at {session.fps:.4g} fps, {len(session.cameras)} cameras; "
            f"{self.facts['found']} of {len(markers)} markers of {markers.name} named, seen in "
            f"{self.facts['seen']:.1%} of the frames; they lie {body_facts(self.body)['residual_mm']['median']:.1f} mm "
            f"(median) from the body's; {self.seconds:.0f} s"
        )


@dataclass(frozen=True)
class _Markers:
    """Stages of the labelled markers.

    Attributes:
        trajectories: unnamed.
        names: points by label, with their confidence.
        cleaned: triangulated again from all cameras, without spikes and gaps.
    """

    trajectories: StageResult
    names: StageResult
    cleaned: StageResult


@opencv_in_one_thread()
def run_marker_session(
    path: Path, out: Path | None, session_options: SessionOptions, options: MarkerVideoOptions, overwrite: bool,
    progress: Progress,
) -> MarkerVideoResult:  # fmt: skip
    """Process one session of marker videos.

    Args:
        path: the session's folder.
        out: the results folder; None for `muybridge/` inside the session.
        session_options: how the session folder is read.
        options: of every stage.
        overwrite: replace files in the results folder that muybridge did not write.
        progress: receives progress messages.

    Raises:
        MuybridgeError: of some kind, for everything that the user can fix.
    """
    plan = find_marker_set(options.markerset)
    session = open_session(path, session_options)
    labeller = LabelNetwork(shipped_model("labels"))
    corrector = open_corrector(None, options.correct)
    inputs = [session.calibration, *(v.path for v in session.videos)]
    run = Run("marker_videos", path / DEFAULT_OUT if out is None else out, RESULTS, inputs, overwrite, progress, path)
    for notice in session.notices:
        progress.notice(notice)
    stage = Stages(run.store, progress, [code_digest(*_CODE), session.cameras.cameras, session.fps])
    blobs = _blob_stages(session, options, stage, progress)
    seen = _by_frame(blobs)
    session = _with_frames(session, len(seen))
    for damage in (stage.facts["damage"] for stage in blobs):
        session = session if damage is None else with_notice(session, damage, progress)
    markers = _marker_stages(session, plan, options, stage, blobs, seen, labeller)
    for note in markers.names.facts["notes"]:
        progress.notice(note)
    fitted = _body_stage(plan, session, options, stage, markers.cleaned, corrector)
    body = unpack_body(fitted.arrays, fitted.facts)
    run.stages |= stage.done
    facts = _marker_facts(session, plan, markers, blobs)
    notices = (*session.notices, *markers.names.facts["notes"])
    found_problems = _write(run, session, plan, markers, seen, body, options, notices)
    seconds = run.finish(
        frames=session.frames, fps=session.fps, session=session_facts(session), notices=notices,
        problems=found_problems, options=asdict(options) | {"session": asdict(session_options)},
        models=_model_facts(labeller, corrector), markers=facts, body=body_facts(body),
        quality={"coverage": float(np.isfinite(markers.cleaned.arrays["points_world"][..., 0]).mean())},
    )  # fmt: skip
    return MarkerVideoResult(run.output.path, session, plan, facts, body, seconds)


def _with_frames(session: Session, frames: int) -> Session:
    return session if frames == session.frames else with_frames(session, frames)


def _blob_stages(session: Session, options: MarkerVideoOptions, stage: Stages, progress: Progress) -> list[StageResult]:
    """(C,) stages of the markers in each camera's images."""
    stages = []
    with progress.task("markers in the images", len(session.cameras)) as task:
        for c, name in enumerate(file_names(session.cameras.names)):
            video, indices = session.videos[c], session.frame_indices[c, : session.lasts(c)]
            given = [video.content, video.rotation_deg, indices, session.frames, options.blobs]
            stages.append(stage(f"blobs-{name}", given, partial(_blobs, video, indices, session.frames, options.blobs)))
            task.advance()
    return stages


def _blobs(video: VideoInfo, indices: IntArray, frames: int, options: BlobOptions) -> tuple[Arrays, Facts]:
    watch = DamageWatch(video)
    blobs, threshold = blobs_of(video, indices, options, watch)
    if len(blobs) == len(indices):  # none in the frames after the video's end
        blobs += [np.empty((0, 3))] * (frames - len(indices))
    arrays, facts = pack_blobs(blobs, threshold)
    return arrays, {**facts, "damage": damage_notice(video.path.name, watch.damaged())}


def _by_frame(stages: list[StageResult]) -> list[list[FloatArray]]:
    """For each frame the blobs (K, 3) of every camera."""
    columns = [unpack_blobs(stage.arrays) for stage in stages]
    frames = min(len(column) for column in columns)
    return [[column[t] for column in columns] for t in range(frames)]


def _marker_stages(
    session: Session, plan: MarkerPlan, options: MarkerVideoOptions, stage: Stages, blobs: list[StageResult],
    seen: list[list[FloatArray]], network: LabelNetwork,
) -> _Markers:  # fmt: skip
    """Trajectories, names and cleaned markers."""
    cameras, fps = session.cameras, session.fps

    def find() -> tuple[Arrays, Facts]:
        found = find_markers(cameras, seen, fps, options)
        return {"points_world": found.points}, {"dropped": found.dropped}

    given = [[b.key for b in blobs], options.shortest_s, options.match, options.track]
    trajectories = stage("trajectories", given, find)
    points = trajectories.arrays["points_world"]
    most = int(np.isfinite(points[..., 0]).sum(1).max(initial=0))
    if most < _FEWEST_MARKERS:
        raise SessionError(
            f"{session.path}: no frame has more than {most} markers in 3D; are these videos of bright markers on a "
            "dark background, and is the calibration these cameras'?"
        )

    def label() -> tuple[Arrays, Facts]:
        labelled = label_points(points, fps, plan.markers, network, options.label)
        return {"points_world": labelled.points, "confidence": labelled.confidence}, {"notes": list(labelled.notes)}

    named = stage("names", [trajectories.key, plan.markers, options.label, file_digest(network.path)], label)

    def clean() -> tuple[Arrays, Facts]:
        again, views = triangulate_again(cameras, seen, named.arrays["points_world"], options.match.error_px)
        cleaned = clean_markers(again, fps, options.clean)
        arrays: Arrays = {
            "points_world": cleaned.points, "sample": cleaned.sample, "triangulated_world": again, "views": views,
        }  # fmt: skip
        return arrays, {}

    return _Markers(trajectories, named, stage("cleaned markers", [named.key, options.match, options.clean], clean))


def _body_stage(
    plan: MarkerPlan, session: Session, options: MarkerVideoOptions, stage: Stages, cleaned: StageResult,
    corrector: SolverNetwork | None,
) -> StageResult:  # fmt: skip
    points = cleaned.arrays["points_world"]
    worn = np.asarray(np.isfinite(points[..., 0]).any(0))
    surface = np.array(plan.markers.surface_indices)
    labels = [label for label, known in zip(plan.markers.labels, worn, strict=True) if known]
    return stage(
        "body", [cleaned.key, options.fit, None if corrector is None else file_digest(corrector.path)],
        lambda: fit_labelled_markers(
            points[:, worn], surface[worn], labels, session.fps, options.fit, None, corrector),
    )  # fmt: skip


def _marker_facts(session: Session, plan: MarkerPlan, markers: _Markers, blobs: list[StageResult]) -> dict[str, Any]:
    """The markers for `run.json`."""
    there = np.isfinite(markers.cleaned.arrays["triangulated_world"][..., 0])
    views, sample = markers.cleaned.arrays["views"], markers.cleaned.arrays["sample"]
    confidence = markers.names.arrays["confidence"]
    return {
        "set": plan.markers.name,
        "thresholds": {n: round(b.facts["threshold"], 1) for n, b in zip(session.cameras.names, blobs, strict=True)},
        "found": int(there.any(0).sum()),
        "seen": round(float(there[:, there.any(0)].mean()), 4),
        "filled": round(float((sample >= Sample.CURVE).mean()), 4),
        "trajectories_dropped": markers.trajectories.facts["dropped"],
        "cameras_per_marker": round(float(views[views > 0].mean()), 2) if (views > 0).any() else 0.0,
        "by_label": {
            label: {"found": round(float(there[:, m].mean()), 4),
                    "confidence": round(float(confidence[:, m].mean()), 4)}
            for m, label in enumerate(plan.markers.labels)
        },
    }  # fmt: skip


def _model_facts(labeller: LabelNetwork, corrector: SolverNetwork | None) -> dict[str, Any]:
    models = {"labels": {"file": labeller.path.name, "sha256": file_digest(labeller.path)}}
    if corrector is not None:
        models["solver"] = {"file": corrector.path.name, "sha256": file_digest(corrector.path),
                            "version": corrector.version}  # fmt: skip
    return models


def _write(
    run: Run, session: Session, plan: MarkerPlan, markers: _Markers, seen: list[list[FloatArray]],
    body: BodySolution, options: MarkerVideoOptions, notices: tuple[str, ...],
) -> tuple[str, ...]:  # fmt: skip
    """Write every result but `run.json`; returns what spoils the result, as sentences."""
    unnamed, points = markers.trajectories.arrays["points_world"], markers.cleaned.arrays["points_world"]
    labels = MarkerSet(plan.markers.name, plan.markers.labels, (), plan.markers.labels)
    bare = LandmarkSet("unnamed", tuple(f"*{k + 1}" for k in range(unnamed.shape[1])), ())
    named = _as_points(labels, points, session.fps)
    run.write_points({UNNAMED: _as_points(bare, unnamed, session.fps), POINTS_C3D: named, POINTS_TRC: named})
    run.write_motion(MOTIONS, body.motion)
    measured = markers.cleaned.arrays["triangulated_world"]
    px, residual = nearest_blobs(session.cameras, seen, measured, options.match.error_px)
    skeleton = body.motion.skeleton
    data = ReportData(
        title=session.name,
        cameras=session.cameras,
        points=replace(_as_points(labels, measured, session.fps), residual_px=residual, inlier=np.isfinite(residual)),
        delivered=named,
        keypoints_px=px,
        joint_positions_world=body.motion.joint_positions_world(),
        joint_names=skeleton.names,
        joint_parents=tuple(skeleton.parents),
        warnings=notices,
        timings_s=run.timings_s,
        options=json_value(asdict(options)),
        versions=versions(),
        files=tuple(run.written),
    )
    run.write(REPORT, partial(write_report, data=data))
    return problems(data)


def _as_points(landmarks: LandmarkSet, points_world: FloatArray, fps: float) -> Points3D:
    """Points of which no camera's residual is known."""
    count, size = points_world.shape[:2]
    return Points3D(landmarks, points_world, np.full((count, size, 3, 3), np.nan), np.empty((0, count, size)),
                    np.empty((0, count, size), bool), fps)  # fmt: skip
