"""Quality figures of a result that need no ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import usable_points
from muybridge.geometry.triangulation.validation import leave_one_out_summary
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.runtime.wording import join_words, readable

# Landmarks of low confidence in every camera are reported from this share of the frames on.
_OFTEN_UNSURE = 0.25


@dataclass(frozen=True)
class Quality:
    """Figures of a take; NaN where there is nothing to measure.

    Attributes:
        coverage: share of frames x landmarks with a 3D point in the results.
        measured_coverage: the same before gaps were filled.
        reprojection_px: median distance of a 2D point to the 3D point's reprojection.
        leave_one_out_px: median distance of a 2D point to the reprojection of the point from the other cameras.
        no_point_share: share of 2D points for which the other cameras gave no point.
        flipped_share: share of 2D points in left-right flips that were repaired.
        noise_px: noise of the 2D points beyond the network's own estimate, from the take.
        cameras: the same for each camera, by name, with the share of landmarks that it sees.
        landmarks: coverage and median reprojection error of each landmark, by name.
    """

    coverage: float
    measured_coverage: float
    reprojection_px: float
    leave_one_out_px: float
    no_point_share: float
    flipped_share: float
    noise_px: float
    cameras: Mapping[str, Mapping[str, float]]
    landmarks: Mapping[str, Mapping[str, float]]


def median(values: FloatArray) -> float:
    """Median of the finite values; NaN if there is none."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def assess(cameras: CameraGroup, solution: Solution) -> Quality:
    """Quality figures of a solved take."""
    usable = usable_points(solution.points_px, solution.variance_px2)
    left_out = leave_one_out_summary(solution.leave_one_out_px, usable)
    residual = solution.measured.residual_px
    known = np.asarray(np.isfinite(solution.points.points_world).all(axis=-1), dtype=np.bool_)
    measured = np.isfinite(solution.measured.points_world).all(axis=-1)
    by_camera = {
        name: {
            "seen": float(usable[c].mean()),
            "agrees": float(solution.measured.inlier[c][usable[c]].mean()) if usable[c].any() else float("nan"),
            "reprojection_px": median(residual[c]),
            "leave_one_out_px": float(left_out.camera_median_px[c]),
            "no_point_share": float(left_out.camera_no_point_share[c]),
        }
        for c, name in enumerate(cameras.names)
    }
    by_landmark = {
        name: {"coverage": float(known[:, j].mean()), "reprojection_px": median(residual[:, :, j])}
        for j, name in enumerate(solution.points.landmarks.names)
    }
    return Quality(
        coverage=float(known.mean()),
        measured_coverage=float(measured.mean()),
        reprojection_px=median(residual),
        leave_one_out_px=left_out.median_px,
        no_point_share=left_out.no_point_share,
        flipped_share=float(solution.flipped[usable].mean()) if usable.any() else float("nan"),
        noise_px=solution.noise_px,
        cameras=by_camera,
        landmarks=by_landmark,
    )


def unsure_landmarks(solution: Solution) -> list[str]:
    """Notices about landmarks of low confidence in every camera in a large part of the take, one per person."""
    notices = []
    for number, person in enumerate((solution, *solution.others), start=1):
        often = np.flatnonzero(person.unsure.mean(axis=0) > _OFTEN_UNSURE)
        if len(often):
            names = join_words([readable(person.points.landmarks.names[j]) for j in often])
            notices.append(
                f"{f'person {number}: ' if solution.others else ''}no camera is confident of {names} in "
                f"{person.unsure[:, often].mean():.0%} of the frames (outside all images or always hidden): they are "
                "left out there (--min-confidence 0 keeps the guesses)"
            )
    return notices
