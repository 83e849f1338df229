"""Sessions of marker videos: bright dots in every camera to named markers in 3D and a moving skeleton.

Blobs to sub-pixel; matched without names by epipolar geometry; trajectories, without ghosts and lamps; names from the
labelling network; every named marker triangulated again from all cameras that see it; cleaned; solved.
"""

import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import SessionError
from muybridge.geometry.cameras.camera import CameraGroup
from muybridge.geometry.landmarks.arrays import LandmarkSet, Points3D
from muybridge.geometry.markers.cleaning import CleanOptions, Sample, clean_markers
from muybridge.geometry.fitting.marker_fit import MarkerFit, MarkerFitOptions, fit_markers
from muybridge.geometry.markers.matching import MatchOptions, follow_points, meet, without_ghosts
from muybridge.geometry.landmarks.marker_sets import MarkerPlan
from muybridge.geometry.markers.tracking import TrackOptions, track_points
from muybridge.geometry.cameras.rays import ray_directions
from muybridge.infer.detection.blobs import BlobOptions, find_blobs, find_threshold
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.labelling.label import LabelOptions, label_points
from muybridge.infer.results.folder import open_output
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import Session, SessionOptions, open_session
from muybridge.infer.networks.correction import SolverNetwork, corrected
from muybridge.infer.session.video import VideoInfo, read_chunks
from muybridge.models.keypoints.metadata import shipped_model
from muybridge.motion.formats.points.marker_protocol import find_marker_set

Array = NDArray[np.float64]

UNNAMED, MARKERS_C3D, MARKERS_TRC, FACTS = "unnamed.c3d", "points.c3d", "points.trc", "markers.json"
MOTION = ("motion.bvh", "motion.glb", "motion.mot")
RESULTS = (UNNAMED, MARKERS_C3D, MARKERS_TRC, *MOTION, FACTS)


@dataclass(frozen=True)
class MarkerVideoOptions:
    """How markers are found in videos.

    Attributes:
        markerset: what the person wears: `pig39`, `cmu41`, ... or a text file of your own.
        shortest_s: seconds that a trajectory must last to be a marker's.
        blobs: markers in an image.
        match: 2D points to 3D points.
        track: trajectories.
        label: names.
        clean: spikes and gaps.
        fit: the skeleton.
        correct: the shipped solver network corrects the fitted joints, as in `muybridge solve`.
    """

    markerset: str = "pig39"
    shortest_s: float = 0.05
    blobs: BlobOptions = field(default_factory=BlobOptions)
    match: MatchOptions = field(default_factory=MatchOptions)
    track: TrackOptions = field(default_factory=TrackOptions)
    label: LabelOptions = field(default_factory=LabelOptions)
    clean: CleanOptions = field(default_factory=CleanOptions)
    fit: MarkerFitOptions = field(default_factory=MarkerFitOptions)
    correct: bool = True


@dataclass(frozen=True, eq=False)
class FoundMarkers:
    """Markers of a take before they have names.

    Attributes:
        points: (T, S, 3) metres in slots, NaN where nothing is: trajectories without ghosts.
        seen: for each frame and camera (K, 3): x, y in pixels and area.
        dropped: trajectories that were ghosts or lamps.
    """

    points: Array
    seen: list[list[Array]]
    dropped: int


def blobs_of(video: VideoInfo, indices: NDArray[np.int64], options: BlobOptions) -> tuple[list[Array], float]:
    """Blobs (K, 3) of every frame of a video, and the threshold that was used."""
    threshold = options.threshold
    found: list[Array] = []
    for chunk in read_chunks(video, indices):
        # Markers are lit in one colour, which need not be the camera's green.
        grey = chunk.max(axis=-1)
        if threshold is None:
            threshold = find_threshold([grey[k] for k in np.linspace(0, len(grey) - 1, min(9, len(grey))).astype(int)])
        found += [find_blobs(image, threshold, options) for image in grey]
    return found, float(threshold or 0.0)


def find_markers(
    cameras: CameraGroup, seen: list[list[Array]], fps: float, options: MarkerVideoOptions
) -> FoundMarkers:
    """Unnamed trajectories from blobs.

    Args:
        cameras: C cameras. seen: for each of T frames C arrays (K, 3). fps: frames a second.
    """
    points, _ = follow_points(cameras, seen, fps, options.match)
    tracks = track_points(points, fps, options.track)
    good = without_ghosts(tracks.points, tracks.track, max(3, round(options.shortest_s * fps)), fps)
    kept = np.where(good[..., None], tracks.points, np.nan)
    dropped = len(np.unique(tracks.track[(tracks.track >= 0) & ~good]))
    used = good.any(0)
    return FoundMarkers(kept[:, used], seen, dropped)


def triangulate_again(cameras: CameraGroup, seen: list[list[Array]], points: Array, reach_px: float = 2.0,
                      longest: int = 12) -> tuple[Array, NDArray[np.intp]]:  # fmt: skip
    """Named markers from all cameras that see them; short gaps are looked at as well, where two cameras see the marker
    within reach of where its path has it.

    Args:
        cameras: C cameras. seen: blobs (K, 3) of every frame and camera.
        points: (T, M, 3) metres. reach_px: how far a blob may be from the projection.
        longest: frames of a gap that is looked at.

    Returns:
        (T, M, 3) metres and (T, M) how many cameras each is from.
    """
    expected, gap = _bridged(points, longest)
    out, views = np.full_like(points, np.nan), np.zeros(points.shape[:2], np.intp)
    centres, count = cameras.centers_world, len(cameras)
    for t, frame in enumerate(seen):
        known = np.nonzero(np.isfinite(expected[t, :, 0]))[0]
        if not len(known):
            continue
        width = max((len(s) for s in frame), default=0)
        if width == 0:
            continue
        px = np.full((count, width, 2), np.nan)
        for c, blobs in enumerate(frame):
            px[c, : len(blobs)] = blobs[:, :2]
        at = cameras.project(expected[t, known])
        far = np.linalg.norm(at[:, :, None] - px[:, None], axis=-1)  # (C, N, K)
        far = np.where(np.isfinite(far), far, np.inf)
        best = far.argmin(2)
        near = np.take_along_axis(far, best[..., None], 2)[..., 0] < np.where(gap[t, known], 3 * reach_px, reach_px)
        # One blob is one marker's: whose projection is nearest.
        nearest = far.argmin(1)
        owner = np.take_along_axis(nearest, best, 1) == np.arange(len(known))
        near &= owner
        rays = ray_directions(cameras, np.take_along_axis(px, best[..., None], 1))
        new = meet(centres, np.nan_to_num(np.moveaxis(rays, 0, 1)), near.T)
        error = np.linalg.norm(cameras.project(new) - np.take_along_axis(px, best[..., None], 1), axis=-1)
        good = near & (error < reach_px)
        enough = (good.sum(0) >= 2) & (good.sum(0) == near.sum(0))
        again = meet(centres, np.nan_to_num(np.moveaxis(rays, 0, 1)), good.T)
        sure = (good.sum(0) >= 2) & (np.linalg.norm(again - expected[t, known], axis=-1) < 0.015)
        sure &= enough | (good.sum(0) >= 3)
        out[t, known[sure]], views[t, known[sure]] = again[sure], good.sum(0)[sure]
    # What was measured stays where two cameras no longer agree.
    lost = np.isnan(out[..., 0]) & np.isfinite(points[..., 0])
    out[lost] = points[lost]
    return out, views


def _bridged(points: Array, longest: int) -> tuple[Array, NDArray[np.bool_]]:
    """Points with straight lines over short gaps, and (T, M) where those are."""
    out, gap = points.copy(), np.zeros(points.shape[:2], bool)
    time = np.arange(len(points))
    for m in range(points.shape[1]):
        known = np.nonzero(np.isfinite(points[:, m, 0]))[0]
        for a, b in zip(known, known[1:], strict=False):
            if 1 < b - a <= longest:
                between = time[a + 1 : b]
                share = ((between - a) / (b - a))[:, None]
                out[between, m] = points[a, m] * (1 - share) + points[b, m] * share
                gap[between, m] = True
    return out, gap


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
               ) -> tuple[list[list[Array]], list[float]]:  # fmt: skip
    columns, thresholds = [], []
    with progress.task("markers in the images", len(session.cameras)) as task:
        for c, video in enumerate(session.videos):
            found, threshold = blobs_of(video, session.frame_indices[c], options.blobs)
            columns.append(found)
            thresholds.append(threshold)
            task.advance()
    frames = min(len(found) for found in columns)
    return [[found[t] for found in columns] for t in range(frames)], thresholds


def _facts(session: Session, plan: MarkerPlan, found: FoundMarkers, confidence: Array, points: Array,
           views: NDArray[np.intp], sample: NDArray[np.uint8], thresholds: list[float], fit: MarkerFit,
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


def _points(names: tuple[str, ...], kind: str, xyz: Array, fps: float) -> Points3D:
    count, size = xyz.shape[:2]
    return Points3D(LandmarkSet(kind, names, ()), xyz, np.full((count, size, 3, 3), np.nan), np.empty((0, count, size)),
                    np.empty((0, count, size), bool), fps)  # fmt: skip


def _write(output: Any, session: Session, plan: MarkerPlan, found: FoundMarkers, points: Array, fit: MarkerFit,
           facts: dict[str, Any]) -> None:  # fmt: skip
    from muybridge.motion.formats.skeletal.bvh import write_bvh
    from muybridge.motion.formats.points.c3d import write_c3d
    from muybridge.motion.formats.gltf.write import write_glb
    from muybridge.motion.formats.skeletal.mot import write_mot
    from muybridge.motion.formats.points.trc import write_trc

    bare = _points(tuple(f"*{k + 1}" for k in range(found.points.shape[1])), "unnamed", found.points, session.fps)
    named = _points(plan.markers.labels, plan.markers.name, points, session.fps)
    output.write(UNNAMED, lambda path: write_c3d(path, bare))
    output.write(MARKERS_C3D, lambda path: write_c3d(path, named))
    output.write(MARKERS_TRC, lambda path: write_trc(path, named))
    output.write("motion.bvh", lambda path: write_bvh(path, fit.motion))
    output.write("motion.glb", lambda path: write_glb(path, fit.motion))
    output.write("motion.mot", lambda path: write_mot(path, fit.motion))
    output.write_text(FACTS, json.dumps(facts, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
