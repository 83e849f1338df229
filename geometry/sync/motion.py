"""Clocks of cameras from the motion of landmarks; no calibration is needed.

The speed of a landmark is similar from every side: speed profiles are correlated, and near the peak the delay is
searched at which two views fit an epipolar geometry best. This gives delays in windows over the take, and a robust line
through them is offset and drift.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.sync.clocks import UNKNOWN, Clock, parabola, resample
from muybridge.geometry.sync.epipolar import fundamental_cost
from muybridge.geometry.sync.pairwise import (
    FEWEST_MOVING,
    SPEED_SMOOTHING,
    clocks_from_pairs,
    smooth_track,
    smooth_tracks,
)

_LEAST_OVERLAP = 0.3  # minimum overlap as a share of the shorter take
_CLEARLY = 3.0  # minimum excess of z over that of small delays, since neighbouring frames are similar
_MOTION_SEARCH_FRAMES = 15  # search range around the delay of the speed profiles


def movement_profile(points_px: FloatArray, variance_px2: FloatArray) -> FloatArray:
    """(T, J) speed of each landmark in the image, in body sizes per frame, smoothed; NaN where unknown.

    Args:
        points_px: (T, J, 2) px of one person.
        variance_px2: (T, J) px^2.
    """
    px = np.where(np.isfinite(variance_px2)[..., None], points_px, np.nan)
    smooth = smooth_track(px)
    low, high = np.nanquantile(px.reshape(-1, px.shape[1] * 2), 0.05), np.nanquantile(px, 0.95)
    size = max(float(high - low), 1.0)
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=-1) / size
    # Relative speeds: an arm's swing must not outweigh the rest, and noise must not outweigh slow motion.
    return np.asarray(np.sqrt(speed))


def motion_delay(reference: FloatArray, other: FloatArray, fps: float, max_offset: float | None = None) -> Clock:
    """Estimate a camera's clock from motion (offset only).

    Args:
        reference: (T, J) `movement_profile` of the reference's view of a person.
        other: (T', J) that of the camera.
        fps: frames per second of both.
        max_offset: largest offset, seconds; None for half of the shorter take.

    Returns:
        The clock; `UNKNOWN` where the motion or the overlap is too small.
    """
    shorter = min(len(reference), len(other))
    reach = shorter // 2 if max_offset is None else int(np.ceil(max_offset * fps))
    lags = np.arange(-reach, reach + 1)
    scores, weighed = np.full(len(lags), -np.inf), np.full(len(lags), -np.inf)
    for k, lag in enumerate(lags):
        a, b = _overlap(reference, other, int(lag))
        if len(a) >= max(FEWEST_MOVING, _LEAST_OVERLAP * shorter):
            scores[k] = _correlation(a, b)
            # Fisher's z: with a short overlap, correlations are large by chance.
            weighed[k] = np.arctanh(np.clip(scores[k], -0.99, 0.99)) * np.sqrt(len(a))
    if not np.isfinite(scores).any():
        return UNKNOWN
    best = int(np.argmax(weighed))
    near = np.flatnonzero(np.abs(lags) <= _MOTION_SEARCH_FRAMES)
    nearest = int(near[np.argmax(weighed[near])])
    if weighed[best] - weighed[nearest] < _CLEARLY:  # a short take: more likely chance than a large offset
        best = nearest
    delay = (lags[best] + parabola(scores, best)) / fps
    frames = shorter - abs(int(lags[best]))
    # Noise of the correlation divided by its curvature at the peak.
    bend = 2 * scores[best] - scores[max(best - 1, 0)] - scores[min(best + 1, len(scores) - 1)]
    noise = (1 - max(scores[best], 0) ** 2) / np.sqrt(max(frames, 4) / (2 * SPEED_SMOOTHING))
    sd = noise / (max(bend, 1e-6) if np.isfinite(bend) else 1e-6) / fps
    return Clock(float(delay), 0.0, float(max(sd, 0.05 / fps)), np.inf, float(np.clip(scores[best], 0, 1)))


def _overlap(a: FloatArray, b: FloatArray, lag: int) -> tuple[FloatArray, FloatArray]:
    """The rows of a and b at the same times if b is `lag` rows late."""
    if lag >= 0:
        n = min(len(a), len(b) - lag)
        return a[: max(n, 0)], b[lag : lag + max(n, 0)]
    n = min(len(a) + lag, len(b))
    return a[-lag : -lag + max(n, 0)], b[: max(n, 0)]


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Mean over landmarks of the correlation over time; landmarks with more motion have more weight."""
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
    """Estimate every camera's clock from the motion of one person's landmarks; no calibration is needed.

    Correlated speeds of the landmarks give the search range (`motion_delay`); the delay at which the views of a pair of
    cameras fit an epipolar geometry best (`fundamental_cost`) gives the result.

    Args:
        points_px: (C, T, J, 2) px of one person, each camera in its own frames.
        variance_px2: (C, T, J) px^2.
        fps: frames per second.
        max_offset: largest offset, seconds; None for half of the take.
        with_drift: whether drift is estimated.

    Returns:
        (C,) clocks; the first camera's is zero.
    """
    count = len(points_px)
    profiles = [movement_profile(points_px[c], variance_px2[c]) for c in range(count)]
    coarse = [Clock(0.0, 0.0, 0.0, 0.0, 1.0)]
    coarse += [motion_delay(profiles[0], profiles[c], fps, max_offset) for c in range(1, count)]
    smooth = smooth_tracks(points_px, variance_px2)

    def cost(pair: tuple[int, int], first: FloatArray, second: FloatArray) -> float:
        i, j = pair
        return fundamental_cost(
            resample(smooth[i], variance_px2[i], fps, first)[0], resample(smooth[j], variance_px2[j], fps, second)[0]
        )

    fine = clocks_from_pairs(cost, count, points_px.shape[1], fps, coarse, _MOTION_SEARCH_FRAMES / fps, with_drift)
    return tuple(
        Clock(f.offset, f.drift, f.offset_sd, f.drift_sd, c.strength) for f, c in zip(fine, coarse, strict=True)
    )
