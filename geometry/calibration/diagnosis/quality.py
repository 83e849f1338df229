"""Quality of a calibration: residuals over the image, coverage, and the precision of each parameter.

A small residual is not sufficient: with few or badly placed points any focal length fits. The decisive figures are the
standard deviations of focal length and position from the bundle adjustment, the observed share of the image and of the
room, and which camera disagrees with the others (`diagnosis`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, adjust
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import ADJUSTABLE_MODELS
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult, Misfit, image_cells, misfits
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.diagnosis.findings import CalibrationDiagnosis, DiagnosisOptions
from muybridge.geometry.calibration.diagnosis.hypotheses import frames_per_observation
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import RAYLEIGH_MEDIAN
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.geometry.triangulation.validation import leave_one_out_error

_PLAN_CELLS = 40
_ADJUST_FRAMES = 40
_ADJUST_LANDMARKS = 25


@dataclass(frozen=True)
class ImagePicture:
    """Residuals of one camera over its image, in a grid of square cells.

    Attributes:
        count: (R, Q) number of observations in each cell.
        median_px: (R, Q) median length of the residual, px; NaN in empty cells.
        mean_px: (R, Q, 2) median of observed minus projected, px; NaN in empty cells.
        covered: share of cells with observations.
    """

    count: IntArray
    median_px: FloatArray
    mean_px: FloatArray
    covered: float


@dataclass(frozen=True)
class Plan:
    """Top view of the room.

    Attributes:
        low: (2,) corner of the first cell, metres.
        cell: side of a cell, metres.
        cameras: (R, Q) number of cameras that see a point in the middle of the cell at `height`; rows along y.
        height: metres.
        points: (N, 2) positions of points, metres.
        seen_by_three: share of the points that three cameras or more see.
    """

    low: FloatArray
    cell: float
    cameras: IntArray
    height: float
    points: FloatArray
    seen_by_three: float


@dataclass(frozen=True)
class CalibrationQuality:
    """Quality figures of a calibration.

    Attributes:
        cameras: C cameras.
        source: the observations, as a phrase ("the person's landmarks in 100 frames").
        count: (C,) number of observations.
        residual_px: (C,) median reprojection error.
        p95_px: (C,) its 95th percentile.
        leave_one_out_px: (C,) median leave-one-camera-out error; NaN where not computed.
        focal_sd: (C,) relative standard deviation of the focal length; NaN where unknown.
        position_sd: (C,) standard deviation of the position, metres; NaN where unknown.
        pictures: residuals over each image.
        plan: top view of the room.
        fitted: whether the calibration was computed from these observations.
        diagnosis: faults of cameras; None where not computed.
        misfits: cameras with views that do not fit.
    """

    cameras: CameraGroup
    source: str
    count: IntArray
    residual_px: FloatArray
    p95_px: FloatArray
    leave_one_out_px: FloatArray
    focal_sd: FloatArray
    position_sd: FloatArray
    pictures: tuple[ImagePicture, ...]
    plan: Plan
    fitted: bool = False
    diagnosis: CalibrationDiagnosis | None = None
    misfits: tuple[Misfit, ...] = ()


def residual_picture(camera: Camera, points_px: FloatArray, error_px: FloatArray) -> ImagePicture:
    """Residuals over a camera's image.

    Args:
        camera: the camera.
        points_px: (N, 2) observed px; NaN where missing.
        error_px: (N, 2) observed minus projected, px.
    """
    columns, rows = image_cells(camera)
    use = np.isfinite(points_px).all(-1) & np.isfinite(error_px).all(-1)
    at, error = points_px[use], error_px[use]
    column = np.floor((at[:, 0] + 0.5) / camera.width * columns).astype(int)
    row = np.floor((at[:, 1] + 0.5) / camera.height * rows).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = (row * columns + column)[inside]
    error = error[inside]
    count = np.bincount(cell, minlength=rows * columns)
    median, mean = np.full(rows * columns, np.nan), np.full((rows * columns, 2), np.nan)
    for k in np.flatnonzero(count):
        here = error[cell == k]
        median[k], mean[k] = np.median(np.linalg.norm(here, axis=1)), np.median(here, axis=0)
    return ImagePicture(
        count.reshape(rows, columns), median.reshape(rows, columns), mean.reshape(rows, columns, 2),
        float((count > 0).mean()),
    )  # fmt: skip


def plan_of(cameras: CameraGroup, points_world: FloatArray, views: IntArray) -> Plan:
    """Top view of the room.

    Args:
        cameras: C cameras.
        points_world: (N, 3) observed points, metres.
        views: (N,) number of cameras that see each point.
    """
    known = np.isfinite(points_world).all(-1)
    points, views = points_world[known], views[known]
    everything = np.concatenate([cameras.centers_world[:, :2], points[:, :2]]) if len(points) else (
        cameras.centers_world[:, :2]
    )  # fmt: skip
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.1 * max(float((high - low).max()), 0.5)
    low, high = low - margin, high + margin
    cell = float((high - low).max()) / _PLAN_CELLS
    columns, rows = (np.ceil((high - low) / cell).astype(int)).tolist()
    height = float(np.median(points[:, 2])) if len(points) else float(np.median(cameras.centers_world[:, 2])) / 2
    x, y = low[0] + (np.arange(columns) + 0.5) * cell, low[1] + (np.arange(rows) + 0.5) * cell
    grid = np.stack([*np.meshgrid(x, y), np.full((rows, columns), height)], axis=-1)
    px = cameras.project_seen(grid)
    size = np.array([(c.width, c.height) for c in cameras])[:, None, None]
    with np.errstate(invalid="ignore"):
        inside = ((px >= -0.5) & (px <= size - 0.5)).all(-1)
    step = max(1, len(points) // 1500)
    three = float((views[views >= 2] >= 3).mean()) if (views >= 2).any() else float("nan")
    return Plan(low, cell, inside.sum(axis=0), height, points[::step, :2], three)


def check_take(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    diagnosis: DiagnosisOptions | None = DiagnosisOptions(),  # noqa: B008 - frozen
    source: str = "",
) -> CalibrationQuality:
    """Check a calibration by the landmarks of a take.

    Args:
        cameras: C cameras.
        points_px: (C, T, J, 2) px of one person, NaN where missing.
        variance_px2: (C, T, J) px^2.
        diagnosis: options of the diagnosis; None: no diagnosis.
        source: phrase that describes the landmarks.

    Raises:
        ValueError: arrays that do not match the cameras.
    """
    found = triangulate(cameras, points_px, variance_px2)
    error = np.asarray(points_px - cameras.project(found.points_world))
    error[~np.isfinite(found.residual_px)] = np.nan
    loo = leave_one_out_error(cameras, points_px, variance_px2)
    focal_sd, position_sd = _known_to(cameras, points_px, variance_px2, found.points_world)
    seen = np.isfinite(found.residual_px)
    pictures = tuple(
        residual_picture(c, points_px[k].reshape(-1, 2), error[k].reshape(-1, 2)) for k, c in enumerate(cameras)
    )
    views = np.isfinite(variance_px2).sum(axis=0)
    return CalibrationQuality(
        cameras=cameras,
        source=source or f"landmarks in {points_px.shape[1]} frames",
        count=seen.sum(axis=(1, 2)),
        residual_px=_quantile(found.residual_px, 0.5),
        p95_px=_quantile(found.residual_px, 0.95),
        leave_one_out_px=_quantile(loo, 0.5),
        focal_sd=focal_sd,
        position_sd=position_sd,
        pictures=pictures,
        plan=plan_of(cameras, found.points_world.reshape(-1, 3), views.reshape(-1)),
        diagnosis=None if diagnosis is None else diagnose(cameras, points_px, variance_px2, diagnosis),
    )


def check_solved(result: CalibrationResult, source: str, cameras: CameraGroup | None = None) -> CalibrationQuality:
    """Check a calibration by the adjustment that it results from (a board, or known points).

    Args:
        result: the adjustment.
        source: phrase that describes the observations.
        cameras: the same cameras, if they were transformed to another world afterwards.
    """
    world = result.points_world
    if cameras is None:
        cameras = result.cameras
    else:  # transform the points with the first camera
        seen = world @ result.cameras[0].rotation.T + result.cameras[0].translation
        world = (seen - cameras[0].translation) @ cameras[0].rotation
    error = -result.residuals_px
    length = np.linalg.norm(error, axis=1)
    rows = [result.camera == c for c in range(len(cameras))]
    pictures = tuple(residual_picture(c, result.pixels[r], error[r]) for c, r in zip(cameras, rows, strict=True))
    _, place = np.unique(np.stack([result.point, result.time]), axis=1, return_inverse=True)
    views = np.bincount(place.ravel())[place.ravel()]
    focal, known = np.array([c.params[0] for c in cameras]), result.focal_std_px
    return CalibrationQuality(
        cameras=cameras,
        source=source,
        count=np.array([r.sum() for r in rows]),
        residual_px=np.array([_quantile(length[None, r], 0.5)[0] for r in rows]),
        p95_px=np.array([_quantile(length[None, r], 0.95)[0] for r in rows]),
        leave_one_out_px=np.full(len(cameras), np.nan),
        focal_sd=np.where(known > 0, known / focal, np.nan),
        position_sd=np.where(result.position_std > 0, result.position_std, np.nan),
        pictures=pictures,
        plan=plan_of(cameras, world, views),
        fitted=True,
        misfits=misfits(result),
    )


def _quantile(values: FloatArray, q: float) -> FloatArray:
    """(C,) quantiles over all but the first axis; NaN where there are no values."""
    flat = values.reshape(len(values), -1)
    known = [row[np.isfinite(row)] for row in flat]
    return np.array([np.quantile(k, q) if k.size else np.nan for k in known])


def _known_to(
    cameras: CameraGroup, points_px: FloatArray, variance_px2: FloatArray, points_world: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Precision of each focal length and position from these landmarks alone: standard deviations (share, metres).

    Lens and pose of all cameras are adjusted together with the points; correlation of errors over time is considered.
    """
    nothing = np.full(len(cameras), np.nan)
    if any(c.model not in ADJUSTABLE_MODELS for c in cameras):
        return nothing, nothing
    usable = np.isfinite(points_world).all(-1) & ((np.isfinite(variance_px2)).sum(axis=0) >= 2)
    frames = np.flatnonzero(usable.sum(axis=1) >= 4)
    if len(frames) < 3:
        return nothing, nothing
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _ADJUST_FRAMES)).round().astype(int))]
    landmarks = np.sort(np.argsort(-usable[frames].sum(axis=0), kind="stable")[:_ADJUST_LANDMARKS])
    chosen = np.ix_(frames, landmarks)
    px, variance = points_px[:, frames][:, :, landmarks], variance_px2[:, frames][:, :, landmarks]
    known = usable[chosen]
    index = np.cumsum(known.ravel()).reshape(known.shape) - 1
    seen = np.isfinite(px).all(-1) & np.isfinite(variance) & known
    camera, t, j = np.nonzero(seen)
    if np.bincount(camera, minlength=len(cameras)).min() < 20:
        return nothing, nothing
    error = cameras.project(points_world[chosen]) - px
    relative = np.sqrt(variance / np.nanmedian(variance))
    level = float(np.median(np.linalg.norm(error, axis=-1)[seen] / relative[seen])) / RAYLEIGH_MEDIAN
    problem = AdjustProblem(
        cameras, camera, index[t, j], px[seen], np.maximum(level * relative[seen], 0.05), points_world[chosen][known],
        np.ones(int(known.sum()), dtype=bool), tuple(FreeCamera(focal=True) for _ in cameras), max_iterations=8,
    )  # fmt: skip
    result = adjust(problem)
    errors = np.full((*seen.shape, 2), np.nan)
    errors[seen] = result.residuals_px / problem.sigma_px[:, None]
    grown = np.sqrt(frames_per_observation(errors))
    focal = np.array([c.params[0] for c in result.cameras])
    return result.focal_std / focal * grown, result.position_std * grown
