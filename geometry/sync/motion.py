"""When the cameras' clocks stood where: offsets and drifts by sound, by movement and by epipolar geometry.

See `clocks` for what a clock is, `synchronisation_audio` for sound.

- Movement: how fast landmarks move is much the same from every side; the speeds' profiles are correlated,
  and near the peak the delay is sought at which two views fit an epipolar geometry, whichever it is.
- Epipolar geometry: with calibrated cameras, the time shift at which rays meet. The finest from pictures.

Each gives delays in windows over the take; a robust line through those is offset and drift.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.sync.audio import audio_clock
from muybridge.geometry.sync.clocks import UNKNOWN, Clock, Delays, clock_from_delays, parabola, resample
from muybridge.geometry.sync.epipolar import epipolar_clocks, epipolar_cost, fundamental_cost
from muybridge.geometry.sync.pairwise import FEWEST_MOVING, SPEED_SMOOTHING, all_smoothed, clocks_from_pairs, smoothed

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


_LEAST_OVERLAP = 0.3  # and which share of the shorter take
_CLEARLY = 3.0  # by how much z must exceed that of small delays: neighbouring frames are alike
_MOTION_SEARCH_FRAMES = 15  # about the speeds' delay


# --- movement ---------------------------------------------------------------------------------------------


def movement_profile(points_px: FloatArray, variance_px2: FloatArray) -> FloatArray:
    """(T, J) how fast each landmark moves in the picture, in body sizes a frame, smoothed; NaN where unknown.

    Args:
        points_px: (T, J, 2) px of one person.
        variance_px2: (T, J).
    """
    px = np.where(np.isfinite(variance_px2)[..., None], points_px, np.nan)
    smooth = smoothed(px)
    low, high = np.nanquantile(px.reshape(-1, px.shape[1] * 2), 0.05), np.nanquantile(px, 0.95)
    size = max(float(high - low), 1.0)
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=-1) / size
    # Relative: an arm's swing must not outweigh the rest, and noise must not outweigh the slow.
    return np.asarray(np.sqrt(speed))


def motion_delay(reference: FloatArray, other: FloatArray, fps: float, max_offset: float | None = None) -> Clock:
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
        if len(a) >= max(FEWEST_MOVING, _LEAST_OVERLAP * shorter):
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
    noise = (1 - max(scores[best], 0) ** 2) / np.sqrt(max(frames, 4) / (2 * SPEED_SMOOTHING))
    sd = noise / (max(bend, 1e-6) if np.isfinite(bend) else 1e-6) / fps
    return Clock(float(delay), 0.0, float(max(sd, 0.05 / fps)), np.inf, float(np.clip(scores[best], 0, 1)))


def _overlap(a: FloatArray, b: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """The rows of a and b that are of one moment if b is `lag` rows late."""
    if lag >= 0:
        n = min(len(a), len(b) - lag)
        return a[: max(n, 0)], b[lag : lag + max(n, 0)]
    n = min(len(a) + lag, len(b))
    return a[-lag : -lag + max(n, 0)], b[: max(n, 0)]


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Mean over landmarks of the correlation in time; landmarks that move more count more."""
    good = np.isfinite(a) & np.isfinite(b)
    n = good.sum(axis=0)
    use = n >= max(FEWEST_MOVING, 0.3 * len(a))
    if not use.any():
        return -np.inf
    a, b, good, n = (np.where(good, a, 0.0)[:, use], np.where(good, b, 0.0)[:, use], good[:, use], n[use])
    a = (a - a.sum(axis=0) / n) * good
    b = (b - b.sum(axis=0) / n) * good
    power = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return float((a * b).sum() / max(power.sum(), 1e-12))


def motion_clocks(
    points_px: FloatArray,
    variance_px2: FloatArray,
    fps: float,
    max_offset: float | None = None,
    with_drift: bool = False,
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
    smooth = all_smoothed(points_px, variance_px2)

    def cost(pair: tuple[int, int], first: FloatArray, second: FloatArray) -> float:
        i, j = pair
        return fundamental_cost(
            resample(smooth[i], variance_px2[i], fps, first)[0], resample(smooth[j], variance_px2[j], fps, second)[0]
        )

    fine = clocks_from_pairs(cost, count, points_px.shape[1], fps, coarse, _MOTION_SEARCH_FRAMES / fps, with_drift)
    return tuple(
        Clock(f.offset, f.drift, f.offset_sd, f.drift_sd, c.strength) for f, c in zip(fine, coarse, strict=True)
    )


# --- epipolar geometry --------------------------------------------------------------------------------------
