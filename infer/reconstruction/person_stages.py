"""What the stages of one person compute: functions of arrays, without the store."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import PersonSelection, select_person, take_slots
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation.left_right import FlipOptions, repair_flips
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate
from muybridge.geometry.triangulation.plausibility import stretched_limbs, uncertain_points
from muybridge.geometry.triangulation.shape_prior import PosePriorOptions, apply_pose_prior
from muybridge.geometry.triangulation.validation import leave_one_out_error
from muybridge.geometry.triangulation.view_bias import ViewBiasOptions, learn_view_bias, remove_view_bias
from muybridge.infer.reconstruction.virtual_markers import triangulate_markers
from muybridge.infer.runtime.stages import Arrays, Facts


def landmarks_in_slots(keypoints: Keypoints2D, slots: IntArray) -> dict[str, NDArray[Any]]:
    """The landmarks in the slots (C, T) of one person."""
    points_px, variance_px2, score = take_slots(keypoints, slots)
    return {"slots": slots, "points_px": points_px, "variance_px2": variance_px2, "score": score}


@dataclass(frozen=True, eq=False)
class _Selected:
    cameras: CameraGroup
    keypoints: Keypoints2D
    given: tuple[TrackingOptions, float]
    selection: PersonSelection


_latest: _Selected | None = None
_selecting = threading.Lock()


def select_once(cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions, fps: float) -> PersonSelection:
    """`select_person`, whose result for the latest arguments is remembered: the calibration is judged by the same
    person whose motion is computed beside it."""
    global _latest
    given = options, fps
    with _selecting:
        known = _latest
        if known is None or known.cameras is not cameras or known.keypoints is not keypoints or known.given != given:
            known = _Selected(cameras, keypoints, given, select_person(cameras, keypoints, options, fps))
            _latest = known
        return known.selection


def person_of_interest(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions, fps: float
) -> tuple[Arrays, Facts]:
    """The person of interest's landmarks, and the slots (N, C, T) of the `others`."""
    selection = select_once(cameras, keypoints, options, fps)
    others = [p.slots for p in selection.people[1:] if p.rank > 0]
    arrays = landmarks_in_slots(keypoints, selection.slots)
    arrays["others"] = np.array(others, dtype=np.int64).reshape(-1, *selection.slots.shape)
    return arrays, {"reason": selection.reason}


def further_person(keypoints: Keypoints2D, slots: IntArray) -> tuple[Arrays, Facts]:
    """The landmarks of one more person."""
    return landmarks_in_slots(keypoints, slots), {"reason": ""}


def without_flips(
    cameras: CameraGroup, keypoints: Keypoints2D, person: Arrays, options: FlipOptions
) -> tuple[Arrays, Facts]:
    """The person's landmarks with left-right flips repaired."""
    points_px, variance_px2, flipped = repair_flips(
        cameras, person["points_px"], person["variance_px2"], keypoints.landmarks, options
    )
    return {"points_px": points_px, "variance_px2": variance_px2, "flipped": flipped}, {}


def triangulated(
    cameras: CameraGroup, flips: Arrays, landmarks: LandmarkSet, fps: float,
    options: TriangulateOptions, view_bias: ViewBiasOptions, pose_prior: PosePriorOptions,
) -> tuple[Arrays, Facts]:  # fmt: skip
    """The person's landmarks in 3D, without those that no body has."""
    points_px, variance_px2 = flips["points_px"], flips["variance_px2"]
    found = triangulate(cameras, points_px, variance_px2, options)
    bias = learn_view_bias(cameras, points_px, variance_px2, landmarks, fps, found, options, view_bias)
    unbiased = points_px
    if bias is not None:
        unbiased, found = remove_view_bias(cameras, points_px, variance_px2, found, bias, options)
    found = apply_pose_prior(cameras, unbiased, variance_px2, landmarks, fps, found, options, pose_prior)
    wrong = stretched_limbs(found.points_world, landmarks)
    wrong |= uncertain_points(found.points_world, found.covariance_world, landmarks)
    # Residuals are reported against the 2D landmarks as detected, not against the corrected ones.
    residual = np.linalg.norm(cameras.project(found.points_world) - points_px, axis=-1)
    arrays = {
        "points_world": found.points_world,
        "covariance_world": found.covariance_world,
        "residual_px": np.where(np.isfinite(variance_px2), residual, np.nan),
        "inlier": found.inlier,
    }
    facts = {"noise_px": found.noise_px, "view_bias_size_m": 0.0 if bias is None else bias.size_m}
    return only(arrays, ~wrong), facts


def only(measured: Arrays, there: BoolArray) -> dict[str, NDArray[Any]]:
    """The arrays of triangulated points, reduced to those that are `there` (T, J)."""
    return {
        "points_world": np.where(there[..., None], measured["points_world"], np.nan),
        "covariance_world": np.where(there[..., None, None], measured["covariance_world"], np.nan),
        "residual_px": np.where(there, measured["residual_px"], np.nan),
        "inlier": measured["inlier"] & there,
    }


def confident(score: FloatArray, flipped: BoolArray, landmarks: LandmarkSet, least: float) -> BoolArray:
    """(T, J) whether any camera is confident of a landmark, by scores (C, T, J) from before flips were repaired."""
    own = np.where(flipped, score[..., list(landmarks.mirror)], score)
    return np.asarray(own.max(axis=0) >= least)


def leave_one_out(cameras: CameraGroup, flips: Arrays, options: TriangulateOptions) -> tuple[Arrays, Facts]:
    """The leave-one-camera-out error."""
    error = leave_one_out_error(cameras, flips["points_px"], flips["variance_px2"], options)
    return {"leave_one_out_px": error}, {}


def virtual_markers(
    cameras: CameraGroup, person: Arrays, landmarks: LandmarkSet, markers: Keypoints2D, flips: FlipOptions,
    options: TriangulateOptions, least: float,
) -> tuple[Arrays, Facts]:  # fmt: skip
    """The person's virtual markers in 3D, of which a camera is confident by at least `least`."""
    points_px, variance_px2, score = take_slots(markers, person["slots"])
    body = person["points_px"], person["variance_px2"], landmarks
    found = triangulate_markers(cameras, body, (points_px, variance_px2), flips, options)
    return only(found, confident(score, found["flipped"], markers.landmarks, least)), {}


def smoothed(points: Points3D, options: SmoothOptions) -> tuple[Arrays, Facts]:
    """The points over time."""
    smooth = smooth_points(points, options)
    return {"points_world": smooth.points_world, "covariance_world": smooth.covariance_world}, {}


def as_points(landmarks: LandmarkSet, measured: Mapping[str, NDArray[Any]], fps: float) -> Points3D:
    """A stage's arrays as points."""
    return Points3D(
        landmarks=landmarks,
        points_world=measured["points_world"],
        covariance_world=measured["covariance_world"],
        residual_px=measured["residual_px"],
        inlier=measured["inlier"],
        fps=fps,
    )
