"""Leave-one-camera-out errors, a quality figure that needs no ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import (
    TriangulateOptions,
    checked_arrays,
    information,
    kernel_views,
    solve,
    take_noise,
)


def leave_one_out_error(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    options: TriangulateOptions | None = None,
) -> FloatArray:
    """Distance of each camera's 2D points from the prediction of the other cameras.

    For every frame, landmark and camera with a usable 2D point, the point is triangulated robustly from the *other*
    cameras and projected into this one. The only value shared with the left-out camera is the noise level, see
    `take_noise`.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px.
        variance_px2: (C, T, J) px^2.
        options: see `TriangulateOptions`.

    Returns:
        (C, T, J) px; NaN where the camera has no 2D point or the others give no point.
    """
    options = options or TriangulateOptions()
    px, variance = checked_arrays(cameras, points_px, variance_px2, options)
    views = kernel_views(cameras, px, variance)
    info = information(views, *take_noise(cameras, px, variance, options))
    error_px = np.full(variance.shape, np.nan)
    for c, camera in enumerate(cameras):
        others = info.copy()
        others[:, c] = 0.0
        points, _, _ = solve(views, others, options)
        projected = camera.project(points.reshape(*px.shape[1:3], 3))
        error_px[c] = np.linalg.norm(projected - px[c], axis=-1)
    error_px[~np.isfinite(variance)] = np.nan
    return error_px


@dataclass(frozen=True)
class LeaveOneOutSummary:
    """Summary of `leave_one_out_error`; NaN where there are no values.

    Attributes:
        median_px: over all cameras, frames and landmarks.
        camera_median_px: (C,) for each camera.
        no_point_share: share of the usable 2D points for which the other cameras give no point.
        camera_no_point_share: (C,) for each camera.
    """

    median_px: float
    camera_median_px: FloatArray
    no_point_share: float
    camera_no_point_share: FloatArray


def leave_one_out_summary(error_px: FloatArray, usable: BoolArray) -> LeaveOneOutSummary:
    """Medians and shares of a leave-one-camera-out error.

    Args:
        error_px: (C, T, J) from `leave_one_out_error`.
        usable: (C, T, J) whether the camera has a 2D point (finite point and variance).
    """

    def median(values: FloatArray) -> float:
        known = values[np.isfinite(values)]
        return float(np.median(known)) if known.size else float("nan")

    def share(values: FloatArray, counted: BoolArray) -> float:
        return float(np.isnan(values[counted]).mean()) if counted.any() else float("nan")

    return LeaveOneOutSummary(
        median_px=median(error_px),
        camera_median_px=np.array([median(e) for e in error_px]),
        no_point_share=share(error_px, usable),
        camera_no_point_share=np.array([share(e, u) for e, u in zip(error_px, usable, strict=True)]),
    )
