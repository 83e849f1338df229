"""Exposure delays of cameras that are not triggered together, from the motion of a hand-held board.

Webcams and phones that record "at the same time" expose up to tens of milliseconds apart, and their time stamps are of
the arrival of the frame, not of its exposure. Known is the velocity of the board, from its motion between frames.
Therefore every view gets an unknown delay, a displacement of the board along its velocity, with a common spread that is
estimated (expectation maximisation of a Student t: a few views are very late), and a share of it across the velocity,
since boards do not move in straight lines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.robust import student_weight
from muybridge.geometry.numerics.rotations import log_so3

FIRST_SPREAD = 0.1
_ACROSS, _ASTRAY = 0.3, 0.3
_DEGREES_OF_FREEDOM = 4.0
_LONGEST_GAP = 3.5
_SMALLEST_SPREAD = 1e-4


@dataclass(frozen=True)
class Delays:
    """Exposure delays of cameras, in time steps.

    Attributes:
        mean: (C,) mean delay of each camera.
        views: (C, B) standard deviation of each view's delay about its camera's mean: larger for those that are late.
        spread: that standard deviation for most views.
    """

    mean: FloatArray
    views: FloatArray
    spread: float


def board_rates(seen: Sequence[Mapping[int, FloatArray]], middle: FloatArray) -> list[dict[int, FloatArray]]:
    """Velocity of a board as seen by each camera.

    Args:
        seen: for each camera and time, (4, 4) cam_from_board.
        middle: (3,) centre of the board, metres.

    Returns:
        For each camera, by time: (2, 6) rotation and translation of the board's centre per time step, and their change
        per step, in camera axes. Only where the board was seen just before or after; the change is zero unless both.
    """
    times = sorted(set().union(*seen)) if seen else []
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    rates: list[dict[int, FloatArray]] = []
    for poses in seen:
        known, mine = sorted(poses), {}
        for k, t in enumerate(known):
            near = [u for u in known[max(k - 1, 0) : k + 2] if abs(u - t) <= _LONGEST_GAP * step]
            if len(near) < 2:
                continue
            ways = [_way(poses[a], poses[b], middle) * step / (b - a) for a, b in pairwise(near)]
            gaps = np.diff(near) / step
            change = (ways[-1] - ways[0]) * 2 / gaps.sum() if len(ways) == 2 else np.zeros(6)
            # Slope, at the middle one, of a parabola through three poses.
            speed = (ways[0] * gaps[-1] + ways[-1] * gaps[0]) / gaps.sum() if len(ways) == 2 else ways[0]
            mine[t] = np.stack([speed, change])
        rates.append(mine)
    return rates


def _way(a: FloatArray, b: FloatArray, middle: FloatArray) -> FloatArray:
    """(6,) rotation and translation of the centre from one pose to another."""
    shift = (b - a)[:3, :3] @ middle + (b - a)[:3, 3]
    return np.concatenate([log_so3(b[:3, :3] @ a[:3, :3].T), shift])


def world_rates(rates: Sequence[Mapping[int, FloatArray]], rotations: FloatArray, times: Sequence[int]) -> FloatArray:
    """(B, 2, 6) velocity of the board per time step and its change, in world axes; NaN where no camera knows it.

    Args:
        rates: result of `board_rates`.
        rotations: (C, 3, 3) cam_from_world.
        times: (B,).
    """
    out = np.full((len(times), 2, 6), np.nan)
    for b, t in enumerate(times):
        known = [np.concatenate([mine[t][:, :3] @ r, mine[t][:, 3:] @ r], axis=1)
                 for mine, r in zip(rates, rotations, strict=True) if t in mine]  # fmt: skip
        if known:
            out[b] = np.median(known, axis=0)
    return out


def sway(rates: FloatArray, delays: Delays) -> tuple[FloatArray, FloatArray]:
    """Motion of the board between exposures, as `AdjustProblem` needs it.

    Args:
        rates: (B, 2, 6) result of `world_rates`.
        delays: current estimate of the delays.

    Returns:
        (C, B, 6, 7) displacements of one standard deviation each, and (C, B, 7) their prior standard deviations.
    """
    spread, mean = delays.views, delays.mean[:, None]
    known = np.isfinite(rates[:, 0, 0])
    speed = np.where(known[:, None], rates[:, 0], 0.0)
    bend = 0.5 * mean[..., None] ** 2 * np.where(known[:, None], rates[:, 1], 0.0)
    moves, expected = np.zeros((*spread.shape, 6, 7)), np.zeros((*spread.shape, 7))
    moves[..., 0], expected[..., 0] = speed * spread[..., None], mean / spread
    for k in (0, 3):  # rotation, translation
        size = np.linalg.norm(speed[:, k : k + 3], axis=1)
        usual = float(np.median(size[known])) if known.any() else 0.0
        # Across its path a board moves with a share of its speed; where the path is unknown, with all of it.
        across = np.where(known, _ACROSS * np.maximum(size, 0.2 * usual), usual)
        across = np.maximum(across * np.hypot(spread, _ASTRAY * mean), 1e-12)
        for axis in range(3):
            moves[:, :, k + axis, 1 + k + axis] = across
            expected[:, :, 1 + k + axis] = bend[..., k + axis] / across
    return moves, expected


def next_delays(before: Delays, swayed: FloatArray, variance: FloatArray, shared: BoolArray) -> Delays:
    """Update the delays after an adjustment.

    Args:
        before: the delays used in it.
        swayed: (C, B, R) estimates of the adjustment, the first one the delay in standard deviations.
        variance: (C, B, R) their posterior variances.
        shared: (C, B) views of times that several cameras saw.
    """
    if not shared.any():
        return before
    delay = swayed[..., 0] * before.views
    weight = np.where(shared, before.views**-2, 0.0)
    mean = (weight * delay).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-30)
    mean -= mean[shared.any(axis=1)].mean()
    power = (delay - mean[:, None]) ** 2 + variance[..., 0] * before.views**2
    weight = student_weight(power / before.spread**2, _DEGREES_OF_FREEDOM, 1)
    spread = max(float(np.sqrt((weight * power)[shared].mean())), _SMALLEST_SPREAD)
    weight = student_weight(power / spread**2, _DEGREES_OF_FREEDOM, 1)
    return Delays(mean, np.where(shared, spread / np.sqrt(weight), spread), spread)
