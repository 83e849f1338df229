"""A body fitted to labelled points: to landmarks, or to markers on its skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.fitting.body_fit import BodyFit, FitOptions, fit_body, landmarks_from_motion
from muybridge.geometry.fitting.marker_fit import MarkerFit, fit_markers
from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.skeleton.joint_centres import JointCentres
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.networks.correction import SolverNetwork, correct_joints
from muybridge.infer.reconstruction.motion_arrays import pack_motion, unpack_motion
from muybridge.infer.runtime.stages import Arrays, Facts
from muybridge.models.shipped import shipped_model


@dataclass(frozen=True, eq=False)
class BodySolution:
    """A body in motion, and how well the points agree with it.

    Attributes:
        motion: of its joints.
        landmarks: BODY23 on the body: constant bones, no gaps.
        residual_m: (T, N) metres from each of the N points to the body's; NaN where missing.
        names: (N,) of the points.
        method: fitted to markers or to landmarks.
        stature_m: the body's height, metres.
        noise_scale: factor by which the points' standard deviations had to be scaled to agree with the fit.
        network: version of the network that corrected the joints; None without one.
    """

    motion: Motion
    landmarks: Points3D
    residual_m: FloatArray
    names: tuple[str, ...]
    method: Literal["markers", "landmarks"]
    stature_m: float
    noise_scale: float
    network: str | None = None


def fit_landmarks(points: Points3D, options: FitOptions) -> tuple[Arrays, Facts]:
    """A body fitted to landmarks, as the arrays and facts of a stage."""
    return _pack(fit_body(points, options), points.landmarks.names)


def fit_labelled_markers(
    points_world: FloatArray, surface: IndexArray, names: Sequence[str], fps: float, options: MarkerFitOptions,
    centres: JointCentres | None, corrector: SolverNetwork | None,
) -> tuple[Arrays, Facts]:  # fmt: skip
    """A body fitted to markers, as the arrays and facts of a stage.

    Args:
        points_world: (T, N, 3) metres.
        surface: (N,) positions of the markers in SURFACE.
        names: (N,) what they are called.
        fps: frames per second.
        options: of the fit.
        centres: joint centres that count besides the markers.
        corrector: corrects the fitted joints.
    """
    fit = fit_markers(points_world, surface, fps, options, centres)
    if corrector is None:
        return _pack(fit, names)
    return _pack(correct_joints(fit, points_world, corrector), names, corrector.version)


def open_corrector(network: Path | None, correct: bool, centres: Sequence[str] = ()) -> SolverNetwork | None:
    """The network that corrects fitted joints, if any.

    Args:
        network: its file; None for the shipped one.
        correct: whether joints are corrected at all.
        centres: joint centres that the user asked for; they are not corrected unless a network is named.
    """
    if not correct or (centres and network is None):
        return None
    return SolverNetwork(network or shipped_model("solver"))


def _pack(fit: BodyFit | MarkerFit, names: Sequence[str], network: str | None = None) -> tuple[Arrays, Facts]:
    arrays, facts = pack_motion(fit.motion)
    on_body = {
        "landmarks_world": landmarks_from_motion(fit.motion, fit.body, BODY23),
        "residual_m": fit.residual_m,
    }
    return {**arrays, **on_body}, {
        **facts,
        "points": list(names),
        "method": "markers" if isinstance(fit, MarkerFit) else "landmarks",
        "stature_m": float(fit.body.stature_m),
        "noise_scale": float(fit.noise_scale),
        "network": network,
    }


def unpack_body(arrays: Arrays, facts: Facts) -> BodySolution:
    """The body that a stage of `fit_landmarks` or `fit_labelled_markers` holds."""
    motion, places = unpack_motion(arrays, facts), arrays["landmarks_world"]
    none = (0, *places.shape[:2])
    landmarks = Points3D(BODY23, places, np.full((*places.shape, 3), np.nan), np.empty(none),
                         np.empty(none, dtype=np.bool_), motion.fps)  # fmt: skip
    return BodySolution(
        motion, landmarks, arrays["residual_m"], tuple(facts["points"]), facts["method"], facts["stature_m"],
        facts["noise_scale"], facts["network"],
    )  # fmt: skip


def body_facts(body: BodySolution) -> dict[str, Any]:
    """The body for `run.json`."""
    skeleton = body.motion.skeleton
    return {
        "method": body.method,
        "network": body.network,
        "stature_m": round(body.stature_m, 4),
        "bone_lengths_m": {n: round(float(v), 5) for n, v in zip(skeleton.names, skeleton.bone_lengths, strict=True)},
        "noise_scale": round(body.noise_scale, 4),
        "residual_mm": _percentiles(body.residual_m),
        "residual_mm_by_point": {n: _percentiles(body.residual_m[:, j]) for j, n in enumerate(body.names)},
    }


def _percentiles(residual_m: FloatArray) -> dict[str, float | None]:
    known = residual_m[np.isfinite(residual_m)] * 1e3
    return {
        "median": round(float(np.median(known)), 3) if known.size else None,
        "p95": round(float(np.percentile(known, 95)), 3) if known.size else None,
    }
