"""Clocks of cameras, offset and drift relative to a reference, and resampling of landmarks to common times.

The clock of camera c is `t_c = t + offset_c + drift_c t`: an event at time `t` of the first (reference) camera is at
`t + offset_c + drift_c t` in camera c's own video. A camera whose recording started 0.5 s before the reference's has an
offset of +0.5 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.numerics.robust import MAD_SIGMA


@dataclass(frozen=True)
class Clock:
    """A camera's clock relative to the reference.

    Attributes:
        offset: the camera's time at the reference's time zero, seconds.
        drift: seconds that the camera's clock gains per second.
        offset_sd: standard deviation of the offset, seconds; infinite where no delay was found.
        drift_sd: standard deviation of the drift.
        strength: prominence of the method's peak, 0 to 1.
    """

    offset: float
    drift: float
    offset_sd: float
    drift_sd: float
    strength: float

    def at(self, times: FloatArray) -> FloatArray:
        """The camera's own times, seconds, at the reference's `times`."""
        return np.asarray(times + self.offset + self.drift * times)


UNKNOWN = Clock(0.0, 0.0, np.inf, np.inf, 0.0)


def own_frames(clocks: Sequence[Clock] | None, c: int, frames: IndexArray, fps: float, count: int) -> IndexArray:
    """A camera's own frames nearest to frames of the take.

    Args:
        clocks: (C,) clocks of the cameras; None where all are synchronised.
        c: index of the camera.
        frames: (n,) frames of the take.
        fps: frames per second.
        count: number of frames of the camera.
    """
    if clocks is None:
        return frames
    return np.asarray(np.rint(clocks[c].at(frames / fps) * fps).astype(np.intp).clip(0, count - 1))


@dataclass(frozen=True)
class Delays:
    """Delays in windows over a take: `delay` seconds with standard deviation `sd` at the reference's times `at`."""

    at: FloatArray
    delay: FloatArray
    sd: FloatArray
    strength: FloatArray


def clock_from_delays(delays: Delays, with_drift: bool) -> Clock:
    """Fit a robust line to delays.

    Args:
        delays: delays in windows.
        with_drift: whether drift is estimated; it needs windows at different times.
    """
    good = np.isfinite(delays.delay) & np.isfinite(delays.sd)
    at, delay, sd = delays.at[good], delays.delay[good], np.maximum(delays.sd[good], 1e-6)
    if not len(at):
        return UNKNOWN
    line = with_drift and len(at) >= 3 and np.ptp(at) > 0
    design = np.stack([np.ones_like(at), at], axis=1)[:, : 2 if line else 1]
    # Start from the median line, because a few windows may be completely wrong.
    estimate = np.zeros(design.shape[1])
    if line:
        slopes = [(delay[j] - delay[i]) / (at[j] - at[i]) for i, j in combinations(range(len(at)), 2) if at[j] != at[i]]
        estimate[1] = np.median(slopes)
    estimate[0] = np.median(delay - (design[:, 1] * estimate[1] if line else 0.0))
    weight = 1 / sd**2
    spread = 1.0
    for _ in range(20):
        residual = (delay - design @ estimate) / sd
        spread = max(MAD_SIGMA * float(np.median(np.abs(residual))), 1.0)
        weight = 1 / (1 + (residual / (2 * spread)) ** 2) ** 2 / sd**2
        information = design.T @ (weight[:, None] * design)
        estimate = np.linalg.solve(information, design.T @ (weight * delay))
    variance = np.diag(np.linalg.inv(information)) * spread**2
    return Clock(
        float(estimate[0]),
        float(estimate[1]) if line else 0.0,
        float(np.sqrt(variance[0])),
        float(np.sqrt(variance[1])) if line else np.inf,
        float(np.median(delays.strength[good])),
    )


def parabola(values: FloatArray, at: int) -> float:
    """Position of the peak at `at` between its neighbours, by a parabola, -0.5 to 0.5."""
    if at <= 0 or at >= len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1], values[at], values[at + 1]
    if not np.isfinite([left, middle, right]).all():
        return 0.0
    bend = left - 2 * middle + right
    return float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0


def resample(
    points_px: FloatArray, variance_px2: FloatArray, fps: float, times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Interpolate landmarks between frames linearly.

    Args:
        points_px: (T, ..., 2) px by frame; frame k is at `k / fps`.
        variance_px2: (T, ...) px^2.
        fps: frames per second.
        times: (n,) seconds.

    Returns:
        (n, ..., 2) px and (n, ...) px^2; NaN outside of the take and beside a missing point, except exactly on a frame.
    """
    position = np.asarray(times, dtype=np.float64) * fps
    nearest = np.round(position)
    position = np.where(np.abs(position - nearest) < 1e-6, nearest, position)
    low = np.clip(np.floor(position).astype(np.intp), 0, max(len(points_px) - 1, 0))
    high = np.minimum(low + 1, len(points_px) - 1)
    share = position - low
    inside = (position >= 0) & (position <= len(points_px) - 1)
    w = share.reshape(-1, *[1] * (variance_px2.ndim - 1))
    on = w == 0
    px = np.where(on[..., None], points_px[low], (1 - w)[..., None] * points_px[low] + w[..., None] * points_px[high])
    # The mean of two independent observations would be more certain; these are not independent.
    variance = np.where(on, variance_px2[low], (1 - w) * variance_px2[low] + w * variance_px2[high])
    px[~inside], variance[~inside] = np.nan, np.nan
    return px, variance


def resample_keypoints(keypoints: Keypoints2D, clocks: Sequence[Clock] | None, fps: float) -> Keypoints2D:
    """Resample each camera's landmarks to the frames of the take.

    Args:
        keypoints: each camera in its own frames.
        clocks: (C,) clocks of the cameras; None where all are synchronised.
        fps: frames per second.
    """
    if clocks is None:
        return keypoints
    times = np.arange(keypoints.points_px.shape[1]) / fps
    px, variance, score = (a.copy() for a in (keypoints.points_px, keypoints.variance_px2, keypoints.score))
    for c, clock in enumerate(clocks):
        if clock.offset == 0 and clock.drift == 0:
            continue
        own = clock.at(times)
        px[c], variance[c] = resample(keypoints.points_px[c], keypoints.variance_px2[c], fps, own)
        _, moved = resample(keypoints.points_px[c], keypoints.score[c], fps, own)
        score[c] = np.where(np.isfinite(variance[c]), np.nan_to_num(moved), 0.0)
    return replace(keypoints, points_px=px, variance_px2=variance, score=score)
