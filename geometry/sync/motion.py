"""When the cameras' clocks stood where: offsets and drifts by sound, by movement and by epipolar geometry.

See `clocks` for what a clock is, `synchronisation_audio` for sound.

- Movement: how fast landmarks move is much the same from every side; the speeds' profiles are correlated,
  and near the peak the delay is sought at which two views fit an epipolar geometry, whichever it is.
- Epipolar geometry: with calibrated cameras, the time shift at which rays meet. The finest from pictures.

Each gives delays in windows over the take; a robust line through those is offset and drift.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.cameras.camera import Camera, CameraGroup
from muybridge.geometry.sync.clocks import MAD_SIGMA, UNKNOWN, Clock, Delays, clock_from_delays, parabola, resample
from muybridge.geometry.sync.audio import audio_clock

__all__ = [
    "UNKNOWN",
    "Clock",
    "Delays",
    "audio_clock",
    "clock_from_delays",
    "epipolar_clocks",
    "epipolar_cost",
    "fundamental_cost",
    "motion_clocks",
    "motion_delay",
    "movement_profile",
    "resample",
]

Floats = NDArray[np.float64]

_FEWEST_MOVING = 8  # frames that must overlap for a correlation to mean anything
_LEAST_OVERLAP = 0.3  # and which share of the shorter take
_CLEARLY = 3.0  # by how much z must exceed that of small delays: neighbouring frames are alike
_SPEED_SMOOTHING = 1.5  # frames
_MOTION_SEARCH_FRAMES = 15  # about the speeds' delay
_EPIPOLAR_SCALE_PX = 5.0
_EPIPOLAR_SCALE = 0.02


# --- movement ---------------------------------------------------------------------------------------------


def movement_profile(points_px: Floats, variance_px2: Floats) -> Floats:
    """(T, J) how fast each landmark moves in the picture, in body sizes a frame, smoothed; NaN where unknown.

    Args:
        points_px: (T, J, 2) px of one person.
        variance_px2: (T, J).
    """
    px = np.where(np.isfinite(variance_px2)[..., None], points_px, np.nan)
    smooth = _smoothed(px)
    low, high = np.nanquantile(px.reshape(-1, px.shape[1] * 2), 0.05), np.nanquantile(px, 0.95)
    size = max(float(high - low), 1.0)
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=-1) / size
    # Relative: an arm's swing must not outweigh the rest, and noise must not outweigh the slow.
    return np.asarray(np.sqrt(speed))


def _smoothed(px: Floats) -> Floats:
    """Gaussian over time that passes NaN over; NaN where the middle is."""
    reach = int(4 * _SPEED_SMOOTHING)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / _SPEED_SMOOTHING) ** 2)
    good = np.asarray(np.isfinite(px).all(axis=-1))
    flat = np.where(good[..., None], px, 0.0)
    total = sum(
        k * np.roll(np.pad(flat, ((reach, reach), (0, 0), (0, 0))), s, axis=0)
        for k, s in zip(kernel, range(-reach, reach + 1), strict=True)
    )
    weight = sum(
        k * np.roll(np.pad(good.astype(float), ((reach, reach), (0, 0))), s, axis=0)
        for k, s in zip(kernel, range(-reach, reach + 1), strict=True)
    )
    out = np.asarray(total)[reach:-reach] / np.maximum(np.asarray(weight)[reach:-reach], 1e-9)[..., None]
    out[~good] = np.nan
    return np.asarray(out)


def motion_delay(reference: Floats, other: Floats, fps: float, max_offset: float | None = None) -> Clock:
    """A camera's clock by movement (offset only).

    Args:
        reference: (T, J) `movement_profile` of the reference's view of a person.
        other: (T', J) the camera's.
        fps: frames a second of both.
        max_offset: seconds; None for half of the shorter take.

    Returns:
        `UNKNOWN` where too little moved or overlapped.
    """
    shorter = min(len(reference), len(other))
    reach = shorter // 2 if max_offset is None else int(np.ceil(max_offset * fps))
    lags = np.arange(-reach, reach + 1)
    scores, weighed = np.full(len(lags), -np.inf), np.full(len(lags), -np.inf)
    for k, lag in enumerate(lags):
        a, b = _overlap(reference, other, int(lag))
        if len(a) >= max(_FEWEST_MOVING, _LEAST_OVERLAP * shorter):
            scores[k] = _correlation(a, b)
            # Fisher's z: in a short overlap chance makes correlations large.
            weighed[k] = np.arctanh(np.clip(scores[k], -0.99, 0.99)) * np.sqrt(len(a))
    if not np.isfinite(scores).any():
        return UNKNOWN
    best = int(np.argmax(weighed))
    near = np.flatnonzero(np.abs(lags) <= _MOTION_SEARCH_FRAMES)
    nearest = int(near[np.argmax(weighed[near])])
    if weighed[best] - weighed[nearest] < _CLEARLY:  # a short take: chance, rather than a late start
        best = nearest
    delay = (lags[best] + parabola(scores, best)) / fps
    frames = shorter - abs(int(lags[best]))
    # The correlation's noise over its bend at the peak.
    bend = 2 * scores[best] - scores[max(best - 1, 0)] - scores[min(best + 1, len(scores) - 1)]
    noise = (1 - max(scores[best], 0) ** 2) / np.sqrt(max(frames, 4) / (2 * _SPEED_SMOOTHING))
    sd = noise / (max(bend, 1e-6) if np.isfinite(bend) else 1e-6) / fps
    return Clock(float(delay), 0.0, float(max(sd, 0.05 / fps)), np.inf, float(np.clip(scores[best], 0, 1)))


def _overlap(a: Floats, b: Floats, lag: int) -> tuple[Floats, Floats]:
    """The rows of a and b that are of one moment if b is `lag` rows late."""
    if lag >= 0:
        n = min(len(a), len(b) - lag)
        return a[: max(n, 0)], b[lag : lag + max(n, 0)]
    n = min(len(a) + lag, len(b))
    return a[-lag : -lag + max(n, 0)], b[: max(n, 0)]


def _correlation(a: Floats, b: Floats) -> float:
    """Mean over landmarks of the correlation in time; landmarks that move more count more."""
    good = np.isfinite(a) & np.isfinite(b)
    n = good.sum(axis=0)
    use = n >= max(_FEWEST_MOVING, 0.3 * len(a))
    if not use.any():
        return -np.inf
    a, b, good, n = (np.where(good, a, 0.0)[:, use], np.where(good, b, 0.0)[:, use], good[:, use], n[use])
    a = (a - a.sum(axis=0) / n) * good
    b = (b - b.sum(axis=0) / n) * good
    power = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return float((a * b).sum() / max(power.sum(), 1e-12))


def fundamental_cost(first: Floats, second: Floats) -> float:
    """How badly two views fit any epipolar geometry: that of the best fundamental matrix.

    The matrix is fitted to the points themselves (eight-point algorithm, reweighted by Sampson's distance and
    robustly), so no calibration is needed. Views of different moments fit none well.

    Args:
        first, second: (n, J, 2) px of the same moments; NaN where missing.

    Returns:
        Mean log loss of Sampson's distances, in spreads of the points; NaN where too little was seen.
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


def motion_clocks(
    points_px: Floats, variance_px2: Floats, fps: float, max_offset: float | None = None, with_drift: bool = False
) -> tuple[Clock, ...]:
    """Every camera's clock by how the landmarks of one person move; no calibration is needed.

    Speeds of landmarks, correlated, say where to look (`motion_delay`); for every pair of cameras the delay at
    which the views fit an epipolar geometry best (`fundamental_cost`) says where exactly.

    Args:
        points_px: (C, T, J, 2) px of one person, each camera by its own frames.
        variance_px2: (C, T, J).
        fps: frames a second.
        max_offset: largest offset, seconds; None for half of the take.
        with_drift: whether drift is looked for too.

    Returns:
        (C,) clocks, the first camera's zero.
    """
    count = len(points_px)
    profiles = [movement_profile(points_px[c], variance_px2[c]) for c in range(count)]
    coarse = [Clock(0.0, 0.0, 0.0, 0.0, 1.0)]
    coarse += [motion_delay(profiles[0], profiles[c], fps, max_offset) for c in range(1, count)]
    smooth = _all_smoothed(points_px, variance_px2)

    def cost(pair: tuple[int, int], first: Floats, second: Floats) -> float:
        i, j = pair
        return fundamental_cost(
            resample(smooth[i], variance_px2[i], fps, first)[0], resample(smooth[j], variance_px2[j], fps, second)[0]
        )

    fine = _clocks(cost, count, points_px.shape[1], fps, coarse, _MOTION_SEARCH_FRAMES / fps, with_drift)
    return tuple(
        Clock(f.offset, f.drift, f.offset_sd, f.drift_sd, c.strength) for f, c in zip(fine, coarse, strict=True)
    )


def _all_smoothed(points_px: Floats, variance_px2: Floats) -> list[Floats]:
    """Tracks smoothed over time: interpolation alone would smooth between frames and not on them."""
    known = np.isfinite(variance_px2)[..., None]
    return [_smoothed(np.where(known[c], points_px[c], np.nan)) for c in range(len(points_px))]


# --- epipolar geometry --------------------------------------------------------------------------------------


def epipolar_clocks(
    cameras: CameraGroup,
    points_px: Floats,
    variance_px2: Floats,
    fps: float,
    start: tuple[Clock, ...] | None = None,
    search: float = 0.25,
    with_drift: bool = False,
) -> tuple[Clock, ...]:
    """Every camera's clock by the time shifts at which rays meet.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person, each camera by its own frames.
        variance_px2: (C, T, J).
        fps: frames a second.
        start: where to look; None for no delay.
        search: seconds about the start.
        with_drift: whether drift is looked for too.

    Returns:
        (C,) clocks, the first camera's zero.
    """
    count, frames = len(cameras), points_px.shape[1]
    start = start or tuple(Clock(0.0, 0.0, np.inf, np.inf, 0.0) for _ in range(count))
    rays = cameras.unproject(np.stack(_all_smoothed(points_px, variance_px2)))

    def cost(pair: tuple[int, int], first: Floats, second: Floats) -> float:
        i, j = pair
        a = resample(rays[i], variance_px2[i], fps, first)[0]
        b = resample(rays[j], variance_px2[j], fps, second)[0]
        return epipolar_cost(cameras[i], cameras[j], a, b)

    return _clocks(cost, count, frames, fps, start, search, with_drift)


_PairCost = Callable[[tuple[int, int], Floats, Floats], float]


def _clocks(
    cost: _PairCost, count: int, frames: int, fps: float, start: Sequence[Clock], search: float, with_drift: bool
) -> tuple[Clock, ...]:
    """Clocks of `count` cameras by a cost of pairs, in windows where drift is wanted."""
    windows = np.array_split(np.arange(frames), max(1, min(8, frames // 150)) if with_drift else 1)
    offsets = []
    for window in windows:
        middle = float(window.mean() / fps)
        guess = np.array([c.offset + c.drift * middle for c in start])
        offsets.append((middle, *_window_offsets(cost, window / fps, guess, search, fps)))
    clocks = [Clock(0.0, 0.0, 0.0, 0.0, 1.0)]
    for c in range(1, count):
        delays = Delays(
            np.array([o[0] for o in offsets]),
            np.array([o[1][c] for o in offsets]),
            np.array([o[2][c] for o in offsets]),
            np.ones(len(offsets)),
        )
        clocks.append(clock_from_delays(delays, with_drift))
    return tuple(clocks)


def _window_offsets(cost: _PairCost, times: Floats, guess: Floats, search: float, fps: float) -> tuple[Floats, Floats]:
    """(C,) offsets and standard deviations in one window: pairwise delays, put together by least squares."""
    count = len(guess)
    rows, right, weight = [], [], []
    steps = np.arange(-np.round(search * fps), np.round(search * fps) + 1) / fps
    for i, j in combinations(range(count), 2):
        costs = [cost((i, j), times + guess[i], times + guess[j] + s) for s in steps]
        delay, sd = _lowest(steps, np.array(costs))
        if np.isfinite(delay):
            row = np.zeros(count)
            row[i], row[j] = -1.0, 1.0
            rows.append(row)
            right.append(delay + guess[j] - guess[i])
            weight.append(1 / sd)
    offset, spread = np.full(count, np.nan), np.full(count, np.nan)
    offset[0], spread[0] = 0.0, 1e-6
    if not rows:
        return offset, spread
    design, value, first = np.stack(rows)[:, 1:], np.array(right), np.array(weight)
    seen = np.abs(design).sum(axis=0) > 0
    base, w = design[:, seen], first
    for _ in range(10):
        estimate, *_ = np.linalg.lstsq(base * w[:, None], value * w, rcond=None)
        residual = np.abs(value - base @ estimate)
        scale = max(MAD_SIGMA * float(np.median(residual)), 0.05 / fps)
        w = first / (1 + (residual / (2 * scale)) ** 2)
    inverse = np.linalg.pinv((base * w[:, None]).T @ (base * w[:, None]))
    freedom = max(len(value) - base.shape[1], 1)
    chi = max(1.0, float(((residual * w) ** 2).sum()) / freedom)
    at = 1 + np.flatnonzero(seen)
    offset[at], spread[at] = estimate, np.sqrt(np.diag(inverse) * chi)
    return offset, spread


def epipolar_cost(first: Camera, second: Camera, a: Floats, b: Floats) -> float:
    """How far rays of two cameras pass each other: mean log loss of Sampson's distance; NaN where too few meet.

    Args:
        first, second: two cameras.
        a, b: (n, J, 2) undistorted normalised coordinates in them, of one moment a row; NaN where missing.
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
    # What is constant in a landmark's error is calibration and definition, not time.
    known = np.isfinite(error)
    if known.sum() < 30:
        return np.nan
    with np.errstate(all="ignore"):
        middle = np.where(known.sum(axis=0) >= _FEWEST_MOVING, _nanmedian(error), np.nan)
    rest = (error - middle)[known & np.isfinite(middle)]
    if len(rest) < 30:
        return np.nan
    return float(np.mean(np.log1p((rest / _EPIPOLAR_SCALE_PX) ** 2)))


def _nanmedian(values: Floats) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(values, axis=0))


def _lowest(steps: Floats, costs: Floats) -> tuple[float, float]:
    """Where the costs are lowest, between the steps, and a standard deviation from the valley's shape."""
    if np.isfinite(costs).sum() < 5:
        return np.nan, np.nan
    filled = np.where(np.isfinite(costs), costs, np.nanmax(costs))
    best = int(np.argmin(filled))
    if best in (0, len(steps) - 1):
        return np.nan, np.nan
    near = slice(max(best - 2, 0), min(best + 3, len(steps)))
    fit = np.polyfit(steps[near] - steps[best], filled[near], 2)
    width = float(steps[1] - steps[0])
    if fit[0] <= 0:
        return float(steps[best]), 4 * width
    shift = float(np.clip(-fit[1] / (2 * fit[0]), -width, width))
    # How much the costs waver beside the valley, against how steep it is.
    second = np.diff(filled, 2)
    waver = MAD_SIGMA * float(np.median(np.abs(second - np.median(second)))) / np.sqrt(6)
    sd = np.sqrt(max(waver, 1e-6) / fit[0])
    return float(steps[best] + shift), float(np.clip(sd, 0.02 * width, 20 * width))
