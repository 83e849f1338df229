"""Robust triangulation: 3D points from the 2D points of several cameras, some of which are wrong.

Every landmark of every frame is solved on its own: pairs of cameras propose a point, all cameras vote on it, the best
proposal is refined by Gauss-Newton on a robust reprojection error, and the cameras within a gate are its inliers. The
number of pairs tried does not grow with the number of cameras (as in RANSAC, it depends on how many agree), so that the
cost is linear in the number of cameras.

Only the relative size of the 2D variances is used; their level is estimated from the take (`take_noise`), because
calibration and synchronisation contribute errors of which a 2D network knows nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import RAYLEIGH_MEDIAN
from muybridge.geometry.triangulation._kernel import Limits, Rig, solve_points

_NOISE_SAMPLE = 1200
_CHUNK = 1024


@dataclass(frozen=True)
class TriangulateOptions:
    """Options of the triangulation.

    Attributes:
        min_views: minimum number of cameras that must agree on a point; otherwise it is NaN.
        min_angle_deg: minimum of the widest angle between the rays of the inliers; below it the depth is unreliable.
        gate_sigma: largest reprojection error of an inlier, in standard deviations per coordinate (calibration noise
            included) ...
        gate_image: ... and as a share of the longer side of its image.
        doubt_sigma: error, in standard deviations, at which a 2D point is as likely wrong as right.
        tail_sigma: typical error of wrong points, in standard deviations.
        noise_px: standard deviation of errors that the 2D variances do not contain (calibration, synchronisation, bias
            of the network), added to every point's variance, px. None: estimated from the take.
        max_pairs: maximum number of camera pairs that propose a point; reached only where few cameras agree.
        threads: number of threads; None for NUMBA_NUM_THREADS or all of the machine's.
    """

    min_views: int = 2
    min_angle_deg: float = 3.0
    gate_sigma: float = 6.0
    gate_image: float = 0.1
    doubt_sigma: float = 3.5
    tail_sigma: float = 20.0
    noise_px: float | None = None
    max_pairs: int = 24
    threads: int | None = None

    def __post_init__(self) -> None:
        if self.min_views < 2:
            raise ValueError(f"min_views must be at least 2, not {self.min_views}")


@dataclass(frozen=True)
class Triangulation:
    """Triangulated points and the agreement of each camera.

    Attributes:
        points_world: (T, J, 3) metres; NaN where fewer than `min_views` cameras agree.
        covariance_world: (T, J, 3, 3) square metres; NaN where the point is. Includes the uncertainty between two
            solutions that fit about equally well.
        residual_px: (C, T, J) distance of the reprojection from the 2D point, through the lens; NaN where the camera
            has no 2D point or the 3D point is NaN.
        inlier: (C, T, J) whether the camera agrees.
        noise_px: standard deviation that was added to the 2D points' own, px.
        variance_scale: factor on the 2D variances; below one where the take shows them to be too large.
    """

    points_world: FloatArray
    covariance_world: FloatArray
    residual_px: FloatArray
    inlier: BoolArray
    noise_px: float
    variance_scale: float


@dataclass(frozen=True)
class _Views:
    """The 2D points of N landmarks in the layout of the kernel."""

    rig: Rig
    seen: FloatArray  # (N, C, 2) normalised
    variance_px2: FloatArray  # (N, C), NaN where missing
    px2_per_unit2: FloatArray  # (N, C) or (1, C) px^2 per square normalised unit
    longer_side_px: float


def triangulate(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    options: TriangulateOptions | None = None,
) -> Triangulation:
    """Triangulate every landmark of every frame robustly.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px; NaN where a camera has no point.
        variance_px2: (C, T, J) variance of each coordinate, px^2; NaN marks the point as missing.
        options: see `TriangulateOptions`.

    Returns:
        The points; NaN where fewer than `min_views` cameras agree, where their rays are nearly parallel, or where the
        rays intersect behind a camera.

    Raises:
        ValueError: shapes that do not match, a variance that is not positive, or options out of range.
    """
    options = options or TriangulateOptions()
    px, variance = checked_arrays(cameras, points_px, variance_px2, options)
    views = kernel_views(cameras, px, variance)
    noise_px, scale = take_noise(cameras, px, variance, options)
    info = information(views, noise_px, scale)
    points, covariances, inliers = solve(views, info, options)
    shape = px.shape[1:3]
    points_world = points.reshape(*shape, 3)
    residual_px = np.linalg.norm(cameras.project(points_world) - px, axis=-1)
    residual_px[~np.isfinite(variance)] = np.nan
    return Triangulation(
        points_world=points_world,
        covariance_world=covariances.reshape(*shape, 3, 3),
        residual_px=residual_px,
        inlier=np.moveaxis(inliers.reshape(*shape, len(cameras)), -1, 0),
        noise_px=noise_px,
        variance_scale=scale,
    )


def take_noise(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    options: TriangulateOptions | None = None,
) -> tuple[float, float]:
    """Estimate the noise of a take beyond its 2D variances, from the median of the residuals.

    A sample of the take is triangulated; the noise is what must be added to the variances so that the median residual
    has its expected size. Where the variances alone exceed the residuals, they are scaled down.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px.
        variance_px2: (C, T, J) px^2.
        options: `noise_px`, where given, is returned unchanged.

    Returns:
        Standard deviation to add, px, and the factor on the variances, 0.01 to 1.
    """
    options = options or TriangulateOptions()
    px, variance = checked_arrays(cameras, points_px, variance_px2, options)
    if options.noise_px is not None:
        return options.noise_px, 1.0
    # Points with three views if there are enough, because two rays always nearly intersect.
    views_of = np.isfinite(variance).sum(axis=0).ravel()
    chosen = np.flatnonzero(views_of >= 3)
    if chosen.size < 50:
        chosen = np.flatnonzero(views_of >= 2)
    if chosen.size == 0:
        return 0.0, 1.0
    chosen = chosen[:: max(1, chosen.size // _NOISE_SAMPLE)]
    flat_px = px.reshape(len(cameras), -1, 2)[:, chosen]
    flat_variance = variance.reshape(len(cameras), -1)[:, chosen]
    views = kernel_views(cameras, flat_px[:, :, None], flat_variance[:, :, None])
    # From loose to strict: starting too strictly, the few points that agree by chance would determine the level.
    noise_px, scale = 0.01 * views.longer_side_px, 1.0
    for _ in range(4):
        points, _, _ = solve(views, information(views, noise_px, scale), options)
        error2 = np.sum((cameras.project(points) - flat_px) ** 2, axis=-1)
        noise_px, scale = _fit_noise(error2, flat_variance)
    return noise_px, scale


def checked_arrays(
    cameras: CameraGroup, points_px: ArrayLike, variance_px2: ArrayLike, options: TriangulateOptions
) -> tuple[FloatArray, FloatArray]:
    """The arrays as float64, both NaN wherever one of them is; ValueError where they are invalid."""
    px = np.asarray(points_px, dtype=np.float64)
    variance = np.asarray(variance_px2, dtype=np.float64)
    if px.ndim != 4 or px.shape[0] != len(cameras) or px.shape[-1] != 2:
        raise ValueError(f"points_px must be ({len(cameras)}, T, J, 2), not {px.shape}")
    if variance.shape != px.shape[:-1]:
        raise ValueError(f"variance_px2 must be {px.shape[:-1]} like points_px, not {variance.shape}")
    usable = usable_points(px, variance)
    if (variance[usable] <= 0).any():
        c, t, j = (int(i[0]) for i in np.nonzero(usable & (variance <= 0)))
        raise ValueError(
            f"variance_px2 must be positive, but is {variance[c, t, j]:g} at camera {cameras[c].name}, "
            f"frame {t}, landmark {j}"
        )
    return np.where(usable[..., None], px, np.nan), np.where(usable, variance, np.nan)


def kernel_views(cameras: CameraGroup, px: FloatArray, variance: FloatArray) -> _Views:
    """Checked (C, T, J, 2) and (C, T, J) arrays in the layout of the kernel; N = T J."""
    count = len(cameras)
    flat_px = px.reshape(count, -1, 2)
    flat_variance = variance.reshape(count, -1)
    seen = np.empty((flat_px.shape[1], count, 2))
    scaled = np.empty((flat_px.shape[1], count))
    px2_per_unit2 = np.empty(count)
    local = []
    for c, camera in enumerate(cameras):
        slopes = camera.unproject(flat_px[c])
        px2_per_unit2[c] = camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]
        local.append(_local_scale(camera, flat_px[c], slopes))
        seen[:, c] = slopes
        scaled[:, c] = flat_variance[c]
        scaled[~np.isfinite(slopes).all(axis=-1), c] = np.nan
    longer_side_px = float(max(max(camera.width, camera.height) for camera in cameras))
    return _Views(
        rig=Rig(
            poses=np.ascontiguousarray(cameras.cam_from_world),
            centers=np.ascontiguousarray(cameras.centers_world),
            px2_per_unit2=px2_per_unit2,
            pairs=_pair_order(cameras),
        ),
        seen=seen,
        variance_px2=scaled,
        px2_per_unit2=np.stack(np.broadcast_arrays(*local), axis=-1),
        longer_side_px=longer_side_px,
    )


def _local_scale(camera: Camera, points_px: FloatArray, slopes: FloatArray) -> FloatArray:
    """(N,) or (1,) area of an image patch in px^2 over its area in normalised units, at each point.

    It is the squared focal length in the centre of every image and, unless the lens is wide-angle, everywhere.
    """

    def scale(px: FloatArray, at: FloatArray) -> FloatArray:
        right, down = camera.unproject(px + [1.0, 0.0]) - at, camera.unproject(px + [0.0, 1.0]) - at
        area: FloatArray = np.abs(right[:, 0] * down[:, 1] - right[:, 1] * down[:, 0])
        return 1.0 / np.maximum(area, 1e-18)

    focal2 = camera.camera_matrix[0, 0] * camera.camera_matrix[1, 1]
    across = np.linspace(0.0, 1.0, 5)
    grid = np.stack(np.meshgrid(across * camera.width, across * camera.height), axis=-1).reshape(-1, 2)
    ratio = scale(grid, camera.unproject(grid)) / focal2
    if (np.abs(np.log(ratio[np.isfinite(ratio)])) < 0.2).all() and np.isfinite(ratio).all():
        return np.array([focal2])
    return scale(points_px, slopes)


def _pair_order(cameras: CameraGroup) -> IntArray:
    """(Q, 2) all pairs of cameras, those with wide angles first, and every camera early.

    The angle is measured at the point nearest to all optical axes, near the subject.
    """
    count = len(cameras)
    centers = cameras.centers_world
    axes = cameras.cam_from_world[:, 2, :3]
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    middle = np.linalg.lstsq(across.sum(0), np.einsum("cij,cj->i", across, centers), rcond=1e-9)[0]
    toward = middle - centers
    toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-9)
    first, second = np.triu_indices(count, k=1)
    gain = np.linalg.norm(np.cross(toward[first], toward[second]), axis=1)
    order = []
    for _ in range(first.size):
        q = int(np.argmax(gain))
        order.append(q)
        # A camera that has proposed waits until all others have.
        taken = (first == first[q]) | (second == first[q]) | (first == second[q]) | (second == second[q])
        gain = gain - taken
        gain[q] = -np.inf
    return np.stack([first[order], second[order]], axis=1).astype(np.int64)


def information(views: _Views, noise_px: float, scale: float) -> FloatArray:
    """(N, C) inverse variance in normalised units, zero where there is no 2D point."""
    total_px2 = scale * views.variance_px2 + noise_px**2
    return np.where(np.isfinite(total_px2), views.px2_per_unit2 / total_px2, 0.0)


def solve(views: _Views, info: FloatArray, options: TriangulateOptions) -> tuple[FloatArray, FloatArray, BoolArray]:
    """(N, 3) points, (N, 3, 3) covariances and (N, C) inliers; runs the kernel on chunks in threads."""
    count, cameras = info.shape
    points = np.full((count, 3), np.nan)
    covariances = np.full((count, 3, 3), np.nan)
    inliers = np.zeros((count, cameras), dtype=np.bool_)
    limits = limits_of(views, options)
    in_chunks(count, options, lambda begin, end: solve_points(
        views.rig, limits, views.seen, info, begin, end, points, covariances, inliers
    ))  # fmt: skip
    return points, covariances, inliers


def limits_of(views: _Views, options: TriangulateOptions) -> Limits:
    """The options in the kernel's units."""
    doubt_u = options.doubt_sigma**2
    tail2 = options.tail_sigma**2
    return Limits(
        # Chosen so that right and wrong are equally likely at `doubt_sigma`.
        kappa=float(np.exp(-0.5 * doubt_u) * (1 + doubt_u / tail2) ** 1.5),
        tail2=tail2,
        gate_u=options.gate_sigma**2,
        gate_px2=(options.gate_image * views.longer_side_px) ** 2,
        agree_u=doubt_u,
        min_sin2=float(np.sin(np.radians(options.min_angle_deg)) ** 2),
        min_views=options.min_views,
        max_pairs=options.max_pairs,
    )


def in_chunks(count: int, options: TriangulateOptions, work: Callable[[int, int], None]) -> None:
    """Call `work(begin, end)` for chunks of `count` points, in threads."""

    def run(begin: int) -> None:
        work(begin, min(begin + _CHUNK, count))

    begins = range(0, count, _CHUNK)
    threads = options.threads or int(os.environ.get("NUMBA_NUM_THREADS", 0)) or os.cpu_count() or 1
    if threads == 1 or len(begins) <= 1:
        for begin in begins:
            run(begin)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(run, begins))


def views_of(
    cameras: CameraGroup, points_px: ArrayLike, variance_px2: ArrayLike, found: Triangulation,
    options: TriangulateOptions,
) -> tuple[_Views, FloatArray]:  # fmt: skip
    """The take in the layout of the kernel, and (N, C) the information of each 2D point at the estimated noise."""
    views = kernel_views(cameras, *checked_arrays(cameras, points_px, variance_px2, options))
    return views, information(views, found.noise_px, found.variance_scale)


def _fit_noise(error2: FloatArray, variance: FloatArray) -> tuple[float, float]:
    """Standard deviation to add, or factor on the variances, so that the median error has its expected size.

    Args:
        error2: (C, N) squared distances, px^2.
        variance: (C, N) px^2.
    """
    known = np.isfinite(error2) & np.isfinite(variance)
    views = known.sum(axis=0)
    # A fitted point uses 3 of the 2n residuals' degrees of freedom, which makes them smaller by this share.
    student_dof = np.where(views >= 2, (2 * views - 3) / np.maximum(2 * views, 1), np.nan)
    ratio2, base = (error2 / student_dof)[known], variance[known]
    if ratio2.size == 0:
        return 0.0, 1.0

    def level(added_px2: float) -> float:
        return float(np.median(ratio2 / (base + added_px2))) / RAYLEIGH_MEDIAN**2

    if level(0.0) <= 1.0:
        return 0.0, float(np.clip(level(0.0), 0.01, 1.0))
    low, high = 0.0, float(np.median(ratio2)) / RAYLEIGH_MEDIAN**2 + 1e-12
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if level(middle) > 1.0 else (low, middle)
    return float(np.sqrt(high)), 1.0


def usable_points(points_px: ArrayLike, variance_px2: ArrayLike) -> BoolArray:
    """(C, T, J) whether a 2D point can be used: its pixels and its variance are finite."""
    point: BoolArray = np.isfinite(np.asarray(points_px)).all(axis=-1)
    variance: BoolArray = np.isfinite(np.asarray(variance_px2))
    usable: BoolArray = point & variance
    return usable
