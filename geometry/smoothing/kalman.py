"""Cleaning and smoothing of labelled 3D points over time: left-right flips, outliers, gaps and noise.

The smoother is a Kalman filter run forwards and backwards (Rauch, Tung, Striebel 1965) on position and velocity with
white-noise acceleration: it has no lag, weights every point by its covariance, fills gaps with growing uncertainty and
returns a covariance. Its bandwidth depends on the noise: about `sqrt(acceleration / noise) / 2 pi` Hz.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.covariances import between, squared_distances
from muybridge.geometry.numerics.robust import CHI2_3_MEDIAN, median_known, student_weight
from muybridge.geometry.smoothing._kernel import smooth_all
from muybridge.geometry.smoothing.filters import FilterOptions, smooth
from muybridge.geometry.smoothing.left_right import undo_flips

_DOF = 4.0  # degrees of freedom of the Student distribution of the noise

Method = Literal["kalman", "butterworth", "savgol", "gcv_spline", "gaussian", "median", "loess"]


@dataclass(frozen=True)
class SmoothOptions:
    """How points are cleaned and smoothed.

    Attributes:
        unflip: correct temporary flips of left and right landmarks.
        flip_share: prior probability that a pair is flipped in a frame; smaller values leave longer flips uncorrected.
        hampel_window: half width of the running median, seconds; 0 disables outlier removal.
        hampel_sigmas: distance from the median, in robust standard deviations, from which a point is an outlier.
        hampel_floor: smallest distance of an outlier, metres.
        top_speed: a point that a neighbour in time reaches at this speed is no outlier, metres per second.
        max_gap: longest gap that is filled, seconds; the ends beyond the first and last known point are filled only
            with `extrapolate`. Infinity fills everything between known points.
        extrapolate: hold the first and the last known position towards the ends of the take.
        acceleration: standard deviation of a landmark's acceleration, metres per second squared; larger values follow
            faster motion and leave more noise.
        passes: number of runs of the smoother; after each, the noise is estimated again and outliers are downweighted.
        default_sigma: noise of a coordinate where the covariance is unknown, metres.
        method: `kalman`, the smoother described above (recommended), or a filter of
            `muybridge.geometry.smoothing.filters`, applied after outliers are removed and gaps are filled.
        cutoff_hz: of `butterworth`; None: chosen by residual analysis.
    """

    unflip: bool = True
    flip_share: float = 0.1
    hampel_window: float = 0.2
    hampel_sigmas: float = 4.0
    hampel_floor: float = 0.04
    top_speed: float = 8.0
    max_gap: float = 0.5
    extrapolate: bool = False
    acceleration: float = 12.0
    passes: int = 3
    default_sigma: float = 0.03
    method: Method = "kalman"
    cutoff_hz: float | None = None

    def __post_init__(self) -> None:
        if self.cutoff_hz is not None and (self.method != "butterworth" or not self.cutoff_hz > 0):
            raise ValueError(f"cutoff_hz must be above zero and goes with method butterworth, not with {self.method}")


def smooth_points(points: Points3D, options: SmoothOptions | None = None) -> Points3D:
    """Clean and smooth points over time.

    Args:
        points: (T, J, 3) metres, NaN where missing, with their covariance (NaN: unknown).
        options: see SmoothOptions.

    Returns:
        Points of the same landmarks and frames, with the covariance of the smoothed position. Residuals and inliers are
        those of the input, since they belong to the measurement.

    Raises:
        MuybridgeError: the frame rate is too low for the cut-off.
    """
    options = options or SmoothOptions()
    if options.cutoff_hz is not None and options.cutoff_hz >= 0.5 * points.fps:
        raise MuybridgeError(f"a cut-off of {options.cutoff_hz:g} Hz needs more than {2 * options.cutoff_hz:g} frames/s"
                             f" and the take has {points.fps:g}: choose a lower one")  # fmt: skip
    cleaned = clean_points(points, options)
    if not len(points.points_world):
        return cleaned
    xyz, covariance = known_points(cleaned, options.default_sigma)
    out, out_covariance = _smooth(xyz, covariance, points.fps, options)
    known = np.isfinite(xyz[..., 0])
    unknown = ~_within_reach(known, points.fps, options)
    if options.method != "kalman":
        filled = np.where((known & ~unknown)[..., None], xyz, np.where(unknown[..., None], np.nan, out))
        out = smooth(filled, points.fps, options.method, FilterOptions(cutoff_hz=options.cutoff_hz))
    out[unknown], out_covariance[unknown] = np.nan, np.nan
    return replace(points, points_world=out, covariance_world=out_covariance)


def clean_points(points: Points3D, options: SmoothOptions | None = None) -> Points3D:
    """The part of `smooth_points` that moves no point: flips corrected, outliers NaN, gaps left open.

    Residuals and inliers are those of the input, in the input's columns.
    """
    options = options or SmoothOptions()
    if not points.fps > 0:
        raise ValueError(f"fps must be above zero, not {points.fps}")
    xyz, covariance = known_points(points, options.default_sigma)
    if options.unflip:
        xyz, covariance = undo_flips(points.landmarks, xyz, covariance, points.fps, options.flip_share)
    xyz = np.where(_outliers(xyz, points.fps, options)[..., None], np.nan, xyz)
    return replace(points, points_world=xyz, covariance_world=covariance)


def known_points(points: Points3D, default_sigma: float) -> tuple[FloatArray, FloatArray]:
    """Positions (T, J, 3), NaN in all coordinates where missing, and a usable covariance (T, J, 3, 3) for each.

    A covariance that is unknown or not positive is replaced by `default_sigma` squared; one that is too small is raised
    to one square millimetre.
    """
    xyz = np.array(points.points_world, dtype=np.float64)
    xyz[~np.all(np.isfinite(xyz), axis=-1)] = np.nan
    covariance = np.array(points.covariance_world, dtype=np.float64)
    usable = np.all(np.isfinite(covariance), axis=(-2, -1))
    covariance[~usable] = np.eye(3) * default_sigma**2
    covariance = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    odd = ~between(covariance, 1e-6, 1e4)
    values, vectors = np.linalg.eigh(covariance[odd])
    bad = values[..., 2] <= 0
    values = np.clip(values, 1e-6, 1e4)
    values[bad] = default_sigma**2
    covariance[odd] = (vectors * values[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return xyz, covariance


def _outliers(xyz: FloatArray, fps: float, options: SmoothOptions) -> BoolArray:
    """(T, J) points far from their running median (Hampel 1974) that no possible motion explains.

    The threshold is relative to the running median distance. A fast movement is far from the median too, but it is
    connected to its neighbours: points that can be reached from an accepted one are kept.
    """
    half = round(options.hampel_window * fps)
    if half < 1 or len(xyz) < 3:
        return np.zeros(xyz.shape[:2], dtype=np.bool_)
    centre = _running_median(xyz, half)
    distance = np.linalg.norm(xyz - centre, axis=-1)
    # The median length of an isotropic normal vector is 1.54 standard deviations of a coordinate.
    sigma = _running_median(distance[..., None], half)[..., 0] / 1.54
    bound = np.maximum(options.hampel_sigmas * sigma * np.sqrt(3), options.hampel_floor)
    far = distance > bound
    known = np.isfinite(xyz[..., 0])
    for _ in range(2 * half):
        near = known & ~far
        reached = far & (
            _is_reachable(xyz, near, sigma, fps, options.top_speed)
            | _is_reachable(xyz[::-1], near[::-1], sigma[::-1], fps, options.top_speed)[::-1]
        )
        if not reached.any():
            break
        far &= ~reached
    return np.asarray(far)


def _is_reachable(xyz: FloatArray, near: BoolArray, sigma: FloatArray, fps: float, top_speed: float) -> BoolArray:
    """(T, J) whether `top_speed` and the noise explain the distance from the latest `near` point before."""
    frames, columns = np.arange(len(xyz))[:, None], np.arange(xyz.shape[1])
    latest = np.maximum.accumulate(np.where(near, frames, -1), axis=0)
    way = np.linalg.norm(xyz - xyz[latest, columns], axis=-1)
    allowed = top_speed * (frames - latest) / fps + 2 * np.sqrt(3) * sigma
    return np.asarray((latest >= 0) & (way <= allowed) & ((frames - latest) / fps < 0.1))


def _running_median(values: FloatArray, half: int) -> FloatArray:
    """(T, J, K) running median over 2 half + 1 frames, ignoring NaN; in blocks, because the windows are large."""
    padded = np.pad(values, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    block = 1000
    parts = [_window_median(padded[s : s + block + 2 * half], half) for s in range(0, len(values), block)]
    return np.concatenate(parts)


def _window_median(padded: FloatArray, half: int) -> FloatArray:
    windows = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0), axis=-1)
    count = np.isfinite(windows).sum(axis=-1)
    low, high = np.maximum(count - 1, 0) // 2, count // 2
    high = np.minimum(high, windows.shape[-1] - 1)
    picked = [np.take_along_axis(windows, k[..., None], axis=-1)[..., 0] for k in (low, high)]
    return np.where(count > 0, 0.5 * (picked[0] + picked[1]), np.nan)


def _smooth(
    xyz: FloatArray, covariance: FloatArray, fps: float, options: SmoothOptions
) -> tuple[FloatArray, FloatArray]:
    """Run the smoother in `passes`, estimating the noise scale and downweighting outliers between them.

    The scale is one factor per landmark, by which the squared distance from the prediction exceeds the covariances;
    weights are those of Student's t with four degrees of freedom.
    """
    known = np.isfinite(xyz[..., 0])
    scale, weight = np.ones(xyz.shape[1]), np.ones(known.shape)
    out = out_covariance = np.empty(0)
    for k in range(max(options.passes, 1)):
        noise = covariance * (scale / weight)[..., None, None]
        xyz = np.ascontiguousarray(xyz)
        out, out_covariance, surprise = smooth_all(xyz, noise, known, 1 / fps, options.acceleration)
        out = _hold_ends(out, known)
        if k == options.passes - 1:
            break
        with np.errstate(invalid="ignore"):
            ratio = median_known(surprise) / CHI2_3_MEDIAN
        scale = np.clip(scale * np.where(np.isfinite(ratio), ratio, 1.0), 0.02, 400.0)
        error = np.where(known[..., None], xyz - out, 0.0)
        weight = student_weight(squared_distances(error, covariance) / scale, _DOF, 3)
    return out, out_covariance


def _hold_ends(positions: FloatArray, known: BoolArray) -> FloatArray:
    """Hold the position before the first and after the last known point: constant velocity would diverge."""
    out = positions.copy()
    frames, columns = np.arange(len(known))[:, None], np.arange(known.shape[1])
    first = np.argmax(known, axis=0)
    last = len(known) - 1 - np.argmax(known[::-1], axis=0)
    return np.asarray(out[np.clip(frames, first, last), columns])


def _within_reach(known: BoolArray, fps: float, options: SmoothOptions) -> BoolArray:
    """(T, J) whether a point is known, in a gap of at most `max_gap`, or at an end that is extrapolated."""
    t_count = len(known)
    frames = np.arange(t_count)[:, None]
    before = np.maximum.accumulate(np.where(known, frames, -1), axis=0)
    after = np.minimum.accumulate(np.where(known, frames, t_count)[::-1], axis=0)[::-1]
    inside = (before >= 0) & (after < t_count)
    short = inside & (after - before - 1 <= options.max_gap * fps)
    ends = ~inside & ((before >= 0) | (after < t_count))
    return np.asarray(known | short | (ends if options.extrapolate else False))
