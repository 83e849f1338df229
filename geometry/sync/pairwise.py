"""Clocks of all cameras from costs of pairs of cameras, and the smoothing of tracks for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.robust import MAD_SIGMA
from muybridge.geometry.sync.clocks import Clock, Delays, clock_from_delays

FEWEST_MOVING = 8  # minimum number of overlapping frames for a meaningful correlation
SPEED_SMOOTHING = 1.5  # frames
_PairCost = Callable[[tuple[int, int], FloatArray, FloatArray], float]


def smooth_track(px: FloatArray) -> FloatArray:
    """Gaussian smoothing over time that ignores NaN; NaN where the value itself is."""
    reach = int(4 * SPEED_SMOOTHING)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SPEED_SMOOTHING) ** 2)
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


def smooth_tracks(points_px: FloatArray, variance_px2: FloatArray) -> list[FloatArray]:
    """Smooth tracks over time, because interpolation alone would smooth between frames but not on them."""
    known = np.isfinite(variance_px2)[..., None]
    return [smooth_track(np.where(known[c], points_px[c], np.nan)) for c in range(len(points_px))]


def clocks_from_pairs(
    cost: _PairCost, count: int, frames: int, fps: float, start: Sequence[Clock], search: float, with_drift: bool
) -> tuple[Clock, ...]:
    """Clocks of `count` cameras from a cost of pairs, in several windows where drift is estimated."""
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


def _window_offsets(
    cost: _PairCost, times: FloatArray, guess: FloatArray, search: float, fps: float
) -> tuple[FloatArray, FloatArray]:
    """(C,) offsets and standard deviations in one window: least squares over pairwise delays."""
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
    student_dof = max(len(value) - base.shape[1], 1)
    chi = max(1.0, float(((residual * w) ** 2).sum()) / student_dof)
    at = 1 + np.flatnonzero(seen)
    offset[at], spread[at] = estimate, np.sqrt(np.diag(inverse) * chi)
    return offset, spread


def _lowest(steps: FloatArray, costs: FloatArray) -> tuple[float, float]:
    """Position of the minimum between the steps, and its standard deviation from the shape of the minimum."""
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
    # Fluctuation of the costs beside the minimum, relative to its slope.
    second = np.diff(filled, 2)
    waver = MAD_SIGMA * float(np.median(np.abs(second - np.median(second)))) / np.sqrt(6)
    sd = np.sqrt(max(waver, 1e-6) / fit[0])
    return float(steps[best] + shift), float(np.clip(sd, 0.02 * width, 20 * width))
