"""Clocks of cameras from the epipolar geometry of moving landmarks."""

from __future__ import annotations

import warnings

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import MAD_SIGMA
from muybridge.geometry.sync.clocks import Clock, resample
from muybridge.geometry.sync.pairwise import FEWEST_MOVING, clocks_from_pairs, smooth_tracks

_EPIPOLAR_SCALE_PX = 5.0
_EPIPOLAR_SCALE = 0.02


def fundamental_cost(first: FloatArray, second: FloatArray) -> float:
    """Cost of the best epipolar geometry of two views.

    The fundamental matrix is fitted to the points themselves (eight-point algorithm, reweighted by Sampson's distance
    and robustly), so that no calibration is needed. Views of different times do not fit any epipolar geometry well.

    Args:
        first, second: (n, J, 2) px at the same times; NaN where missing.

    Returns:
        Mean log loss of Sampson's distances, relative to the points' spread; NaN where too few points are known.
    """
    both = np.concatenate([first, second], axis=-1).reshape(-1, 4)
    both = both[np.isfinite(both).all(axis=-1)]
    if len(both) < 60:
        return np.nan
    both = (both - both.mean(axis=0)) / np.maximum(both.std(axis=0), 1e-9)
    ones = np.ones((len(both), 1))
    a, b = np.concatenate([both[:, :2], ones], axis=1), np.concatenate([both[:, 2:], ones], axis=1)
    design = (b[:, :, None] * a[:, None, :]).reshape(-1, 9)
    weight, distance = np.ones(len(design)), np.zeros(len(design))
    for _ in range(8):
        _, vectors = np.linalg.eigh((design * weight[:, None]).T @ design)
        matrix = vectors[:, 0].reshape(3, 3)
        line_b, line_a = a @ matrix.T, b @ matrix
        slope = np.sqrt((line_b[:, :2] ** 2).sum(axis=1) + (line_a[:, :2] ** 2).sum(axis=1))
        slope = np.maximum(slope, 1e-9)
        distance = (b * line_b).sum(axis=1) / slope
        scale = max(MAD_SIGMA * float(np.median(np.abs(distance))), 1e-9)
        weight = 1 / (1 + (distance / (2 * scale)) ** 2) / slope**2
    return float(np.mean(np.log1p((distance / _EPIPOLAR_SCALE) ** 2)))


def epipolar_clocks(
    cameras: CameraGroup,
    points_px: FloatArray,
    variance_px2: FloatArray,
    fps: float,
    start: tuple[Clock, ...] | None = None,
    search: float = 0.25,
    with_drift: bool = False,
) -> tuple[Clock, ...]:
    """Estimate every camera's clock from the time shifts at which the rays of calibrated cameras intersect.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person, each camera in its own frames.
        variance_px2: (C, T, J) px^2.
        fps: frames per second.
        start: initial clocks; None for no delay.
        search: search range around them, seconds.
        with_drift: whether drift is estimated.

    Returns:
        (C,) clocks; the first camera's is zero.
    """
    count, frames = len(cameras), points_px.shape[1]
    start = start or tuple(Clock(0.0, 0.0, np.inf, np.inf, 0.0) for _ in range(count))
    rays = cameras.unproject(np.stack(smooth_tracks(points_px, variance_px2)))

    def cost(pair: tuple[int, int], first: FloatArray, second: FloatArray) -> float:
        i, j = pair
        a = resample(rays[i], variance_px2[i], fps, first)[0]
        b = resample(rays[j], variance_px2[j], fps, second)[0]
        return epipolar_cost(cameras[i], cameras[j], a, b)

    return clocks_from_pairs(cost, count, frames, fps, start, search, with_drift)


def epipolar_cost(first: Camera, second: Camera, a: FloatArray, b: FloatArray) -> float:
    """Cost of two cameras' rays: mean log loss of Sampson's distance; NaN where too few points are known.

    Args:
        first, second: two cameras.
        a, b: (n, J, 2) undistorted normalised coordinates in them, one time per row; NaN where missing.
    """
    rotation = second.rotation @ first.rotation.T
    t = second.translation - rotation @ first.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    ones = np.ones((*a.shape[:-1], 1))
    a, b = np.concatenate([a, ones], axis=-1), np.concatenate([b, ones], axis=-1)
    line_b, line_a = a @ (cross @ rotation).T, b @ (cross @ rotation)
    top = (b * line_b).sum(axis=-1)
    bottom = np.sqrt((line_b[..., :2] ** 2).sum(axis=-1) + (line_a[..., :2] ** 2).sum(axis=-1))
    error = top / np.maximum(bottom, 1e-12) * first.camera_matrix[0, 0]
    # Constant errors of a landmark come from calibration and landmark definition, not from time.
    known = np.isfinite(error)
    if known.sum() < 30:
        return np.nan
    with np.errstate(all="ignore"):
        middle = np.where(known.sum(axis=0) >= FEWEST_MOVING, _nanmedian(error), np.nan)
    rest = (error - middle)[known & np.isfinite(middle)]
    if len(rest) < 30:
        return np.nan
    return float(np.mean(np.log1p((rest / _EPIPOLAR_SCALE_PX) ** 2)))


def _nanmedian(values: FloatArray) -> FloatArray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(values, axis=0))
