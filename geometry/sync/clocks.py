"""Clocks of cameras: offset and drift against a reference, from delays, and landmarks at other times.

The clock of camera c is `t_c = t + offset_c + drift_c t`: what happens at time `t` of the first (reference)
camera is seen by camera c at `t + offset_c + drift_c t` of its own video. So a camera whose recording was
started 0.5 s before the reference's has an offset of +0.5 s.
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
    """A camera's clock against the reference's.

    Attributes:
        offset: seconds; the camera's time of what the reference sees at its time zero.
        drift: seconds a second that its clock gains.
        offset_sd: standard deviation, seconds; infinite where nothing was found.
        drift_sd: of the drift.
        strength: 0..1, how clearly the method's peak stands out.
    """

    offset: float
    drift: float
    offset_sd: float
    drift_sd: float
    strength: float

    def at(self, times: FloatArray) -> FloatArray:
        """The camera's own times of what the reference sees at `times`, seconds."""
        return np.asarray(times + self.offset + self.drift * times)


UNKNOWN = Clock(0.0, 0.0, np.inf, np.inf, 0.0)


def own_frames(clocks: Sequence[Clock] | None, c: int, frames: IndexArray, fps: float, count: int) -> IndexArray:
    """A camera's own frames nearest to frames of the take.

    Args:
        clocks: (C,) of the cameras; None where all keep the take's time.
        c: the camera.
        frames: (n,) of the take.
        fps: frames a second.
        count: frames that the camera has.
    """
    if clocks is None:
        return frames
    return np.asarray(np.rint(clocks[c].at(frames / fps) * fps).astype(np.intp).clip(0, count - 1))


@dataclass(frozen=True)
class Delays:
    """Delays in windows over a take: `delay[k]` seconds with `sd[k]` about the reference's time `at[k]`."""

    at: FloatArray
    delay: FloatArray
    sd: FloatArray
    strength: FloatArray


def clock_from_delays(delays: Delays, with_drift: bool) -> Clock:
    """A robust line through delays.

    Args:
        delays: in windows.
        with_drift: whether a drift is looked for; it needs windows that lie apart in time.
    """
    good = np.isfinite(delays.delay) & np.isfinite(delays.sd)
    at, delay, sd = delays.at[good], delays.delay[good], np.maximum(delays.sd[good], 1e-6)
    if not len(at):
        return UNKNOWN
    line = with_drift and len(at) >= 3 and np.ptp(at) > 0
    design = np.stack([np.ones_like(at), at], axis=1)[:, : 2 if line else 1]
    # From the median line: a few windows may have heard or seen something else altogether.
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
    """Where between its neighbours the peak at `at` lies, in -0.5..0.5."""
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
    """Landmarks between frames, linearly.

    Args:
        points_px: (T, ..., 2) px by frame; frame k is at `k / fps`.
        variance_px2: (T, ...).
        fps: frames a second.
        times: (n,) seconds.

    Returns:
        (n, ..., 2) and (n, ...); NaN outside of the take and beside a missing point, except on it.
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
    # The mean of two independent readings would be the surer one; they are not independent.
    variance = np.where(on, variance_px2[low], (1 - w) * variance_px2[low] + w * variance_px2[high])
    px[~inside], variance[~inside] = np.nan, np.nan
    return px, variance


def synchronised(keypoints: Keypoints2D, clocks: Sequence[Clock] | None, fps: float) -> Keypoints2D:
    """Landmarks at the take's frames, between each camera's own.

    Args:
        keypoints: each camera by its own frames.
        clocks: (C,); None where all keep the take's time.
        fps: frames a second.
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
