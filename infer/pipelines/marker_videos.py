"""Videos of bright markers to labelled markers and a solved skeleton."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import ByteArray, FloatArray, IndexArray
from muybridge.errors import SessionError
from muybridge.geometry.fitting.marker_fit import MarkerFit, fit_markers
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import MarkerPlan
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.markers.cleaning import Sample, clean_markers
from muybridge.infer.labelling.label import label_points
from muybridge.infer.networks.correction import SolverNetwork, corrected
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.reconstruction.marker_videos import (
    FACTS,
    MARKERS_C3D,
    MARKERS_TRC,
    UNNAMED,
    FoundMarkers,
    MarkerVideoOptions,
    blobs_of,
    find_markers,
    triangulate_again,
)
from muybridge.infer.results.folder import open_output
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import Session, SessionOptions, open_session
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set

MOTION = ("motion.bvh", "motion.glb", "motion.mot")


RESULTS = (UNNAMED, MARKERS_C3D, MARKERS_TRC, *MOTION, FACTS)


def run_marker_session(path: Path, out: Path | None, session_options: SessionOptions, options: MarkerVideoOptions,
                       overwrite: bool, progress: Progress) -> str:  # fmt: skip
    """Works on one session of marker videos; returns what to tell the user.

    Raises:
        MuybridgeError: of some kind, for everything that the user can mend.
    """
    began = time.perf_counter()
    plan = find_marker_set(options.markerset)
    session = open_session(path, session_options)
    place = path / "muybridge" if out is None else out
    output = open_output(place, RESULTS, [session.calibration, *(v.path for v in session.videos)], overwrite, path)
    for notice in session.notices:
        progress.notice(notice)
    seen, thresholds = _all_blobs(session, options, progress)
    progress.say("matching between the cameras")
    found = find_markers(session.cameras, seen, session.fps, options)
    most = int(np.isfinite(found.points[..., 0]).sum(1).max(initial=0))
    if most < 6:
        raise SessionError(
            f"{path}: no frame has more than {most} markers in 3D; are these videos of bright markers on a dark "
            "picture, and is the calibration these cameras'?"
        )
    network = LabelNetwork(shipped_model("labels"))
    labelled = label_points(found.points, session.fps, plan.markers, network, options.label)
    for note in labelled.notes:
        progress.notice(note)
    again, views = triangulate_again(session.cameras, seen, labelled.points, options.match.error_px)
    cleaned = clean_markers(again, session.fps, options.clean)
    surface = np.array(plan.markers.surface_indices)
    worn = np.isfinite(cleaned.points[..., 0]).any(0)
    progress.say("fitting the body")
    fit = fit_markers(cleaned.points[:, worn], surface[worn], session.fps, options.fit)
    corrector = SolverNetwork(shipped_model("solver")) if options.correct else None
    if corrector is not None:
        fit = corrected(fit, cleaned.points[:, worn], corrector)
    facts = _facts(session, plan, found, labelled.confidence, again, views, cleaned.sample, thresholds, fit,
                   labelled.notes)  # fmt: skip
    facts["network"] = corrector.version if corrector else None
    _write(output, session, plan, found, cleaned.points, fit, facts)
    return (
        f"{place}: {session.frames} frames at {session.fps:.4g} fps, {len(session.cameras)} cameras; "
        f"{facts['markers_found']} of {len(plan.markers)} markers of {plan.markers.name} named, seen in "
        f"{facts['seen']:.1%} of the frames; they lie {facts['residual_mm']['median']:.1f} mm (median) from the "
        f"body's; {time.perf_counter() - began:.0f} s"
    )


def _all_blobs(session: Session, options: MarkerVideoOptions, progress: Progress
               ) -> tuple[list[list[FloatArray]], list[float]]:  # fmt: skip
    columns, thresholds = [], []
    with progress.task("markers in the images", len(session.cameras)) as task:
        for c, video in enumerate(session.videos):
            found, threshold = blobs_of(video, session.frame_indices[c], options.blobs)
            columns.append(found)
            thresholds.append(threshold)
            task.advance()
    frames = min(len(found) for found in columns)
    return [[found[t] for found in columns] for t in range(frames)], thresholds


def _facts(session: Session, plan: MarkerPlan, found: FoundMarkers, confidence: FloatArray, points: FloatArray,
           views: IndexArray, sample: ByteArray, thresholds: list[float], fit: MarkerFit,
           notes: list[str]) -> dict[str, Any]:  # fmt: skip
    from muybridge import __version__

    there = np.isfinite(points[..., 0])
    residual = fit.residual_m[np.isfinite(fit.residual_m)] * 1e3
    return {
        "muybridge": __version__, "session": session.name, "frames": len(points), "fps": session.fps,
        "marker_set": plan.markers.name, "notes": [*session.notices, *notes],
        "thresholds": {n: round(v, 1) for n, v in zip(session.cameras.names, thresholds, strict=True)},
        "markers_found": int(there.any(0).sum()), "seen": round(float(there[:, there.any(0)].mean()), 4),
        "filled": round(float((sample >= Sample.CURVE).mean()), 4), "trajectories_dropped": found.dropped,
        "cameras_a_marker": round(float(views[views > 0].mean()), 2) if (views > 0).any() else 0.0,
        "stature_m": round(fit.body.stature_m, 4),
        "residual_mm": {"median": round(float(np.median(residual)), 3),
                        "p95": round(float(np.percentile(residual, 95)), 3)},
        "markers": {label: {"found": round(float(there[:, m].mean()), 4),
                            "confidence": round(float(confidence[:, m].mean()), 4)}
                    for m, label in enumerate(plan.markers.labels)},
    }  # fmt: skip


def _points(names: tuple[str, ...], kind: str, xyz: FloatArray, fps: float) -> Points3D:
    count, size = xyz.shape[:2]
    return Points3D(LandmarkSet(kind, names, ()), xyz, np.full((count, size, 3, 3), np.nan), np.empty((0, count, size)),
                    np.empty((0, count, size), bool), fps)  # fmt: skip


def _write(output: Any, session: Session, plan: MarkerPlan, found: FoundMarkers, points: FloatArray, fit: MarkerFit,
           facts: dict[str, Any]) -> None:  # fmt: skip
    from muybridge.motion.formats.gltf.write import write_glb
    from muybridge.motion.formats.points.c3d import write_c3d
    from muybridge.motion.formats.points.trc import write_trc
    from muybridge.motion.formats.skeletal.bvh import write_bvh
    from muybridge.motion.formats.skeletal.mot import write_mot

    bare = _points(tuple(f"*{k + 1}" for k in range(found.points.shape[1])), "unnamed", found.points, session.fps)
    named = _points(plan.markers.labels, plan.markers.name, points, session.fps)
    output.write(UNNAMED, lambda path: write_c3d(path, bare))
    output.write(MARKERS_C3D, lambda path: write_c3d(path, named))
    output.write(MARKERS_TRC, lambda path: write_trc(path, named))
    output.write("motion.bvh", lambda path: write_bvh(path, fit.motion))
    output.write("motion.glb", lambda path: write_glb(path, fit.motion))
    output.write("motion.mot", lambda path: write_mot(path, fit.motion))
    output.write_text(FACTS, json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
