"""How a hand-held board moves between the exposures of cameras that are not triggered together.

Webcams and phones that "record at the same time" expose up to tens of milliseconds apart, and their time stamps
are when the frame arrived, not when it was exposed. What is known is how fast the board went: its movement from one
frame to the next. So every view gets an unknown delay, a movement of the board along its own velocity, with a
common spread that is estimated (expectation maximisation of a Student t: a few views are far late), and a
share of it across the velocity, since boards do not move straight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.rotations import log_so3

Floats = NDArray[np.float64]

FIRST_SPREAD = 0.1
_ACROSS = 0.3
_DEGREES_OF_FREEDOM = 4.0
_LONGEST_GAP = 3.5
_SMALLEST_SPREAD = 1e-4


def board_rates(seen: Sequence[Mapping[int, Floats]], middle: Floats) -> list[dict[int, Floats]]:
    """How a board moves, as each camera sees it.

    Args:
        seen: for each camera and time, (4, 4) cam_from_board.
        middle: (3,) of the board.

    Returns:
        For each camera, by time: (6,) rotation and shift of the board's middle a step of time, in camera axes. Only
        where the board was seen just before or after.
    """
    times = sorted(set().union(*seen)) if seen else []
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    rates: list[dict[int, Floats]] = []
    for poses in seen:
        known, mine = sorted(poses), {}
        for k, t in enumerate(known):
            near = [u for u in known[max(k - 1, 0) : k + 2] if u != t and abs(u - t) <= _LONGEST_GAP * step]
            if not near:
                continue
            a, b = (near[0], near[-1]) if len(near) == 2 else sorted((t, near[0]))
            turn = log_so3(poses[b][:3, :3] @ poses[a][:3, :3].T)
            shift = (poses[b] - poses[a])[:3, :3] @ middle + (poses[b] - poses[a])[:3, 3]
            mine[t] = np.concatenate([turn, shift]) * step / (b - a)
        rates.append(mine)
    return rates


def world_rates(rates: Sequence[Mapping[int, Floats]], rotations: Floats, times: Sequence[int]) -> Floats:
    """(B, 6) movement of the board a step of time in world axes, NaN where no camera knows it.

    Args:
        rates: of `board_rates`.
        rotations: (C, 3, 3) cam_from_world.
        times: (B,).
    """
    out = np.full((len(times), 6), np.nan)
    for b, t in enumerate(times):
        known = [np.concatenate([r.T @ mine[t][:3], r.T @ mine[t][3:]])
                 for mine, r in zip(rates, rotations, strict=True) if t in mine]  # fmt: skip
        if known:
            out[b] = np.median(known, axis=0)
    return out


def sway(rates: Floats, spread: Floats) -> Floats:
    """(C, B, 6, 7) movements of one standard deviation between exposures, as `AdjustProblem` takes them.

    Args:
        rates: (B, 6) of `world_rates`.
        spread: (C, B) standard deviation of each view's delay, steps of time.
    """
    known = np.isfinite(rates[:, 0])
    turning, speed = np.linalg.norm(rates[:, :3], axis=1), np.linalg.norm(rates[:, 3:], axis=1)
    usual = [float(np.median(v[known])) if known.any() else 0.0 for v in (turning, speed)]
    out = np.zeros((*spread.shape, 6, 7))
    out[..., 0] = np.where(known[:, None], rates, 0.0) * spread[..., None]
    for k, size in enumerate((turning, speed)):
        # Across its path a board sways with a share of its speed; where the path is unknown, with all of it.
        across = np.where(known, _ACROSS * np.maximum(np.nan_to_num(size), 0.2 * usual[k]), usual[k])
        for axis in range(3):
            out[:, :, 3 * k + axis, 1 + 3 * k + axis] = across * spread
    return out


def next_spread(
    spread: Floats, swayed: Floats, variance: Floats, used: NDArray[np.bool_], common: float
) -> tuple[float, Floats]:
    """The spread of the delays after an adjustment.

    Args:
        spread: (C, B) what it was, steps of time.
        swayed: (C, B, R) of the adjustment, its first the delay in `spread`s.
        variance: (C, B, R) what stayed unknown.
        used: (C, B) views of times that several cameras saw.
        common: (before) the cameras' common spread.

    Returns:
        The common spread and (C, B) each view's: larger for those that are late.
    """
    if not used.any():
        return common, np.full(spread.shape, max(common, _SMALLEST_SPREAD))
    power = (swayed[..., 0] ** 2 + variance[..., 0]) * spread**2
    n = _DEGREES_OF_FREEDOM
    weight = (n + 1) / (n + power / common**2)
    common = max(float(np.sqrt((weight * power)[used].sum() / used.sum())), _SMALLEST_SPREAD)
    weight = (n + 1) / (n + power / common**2)
    return common, np.where(used, common / np.sqrt(weight), common)
