"""Bundle adjustment over cameras and people: reprojection, and bones that keep their lengths.

The same Levenberg-Marquardt as for boards and points (`solver`), on the equations of `articulated`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.articulated import (
    ArticulatedProblem,
    ArticulatedState,
    ArticulatedSystem,
)
from muybridge.geometry.calibration.bundle_adjustment.clustered_covariance import clustered_covariance
from muybridge.geometry.calibration.bundle_adjustment.solver import Damping, minimise

__all__ = ["ArticulatedProblem", "ArticulatedResult", "ArticulatedState", "adjust_articulated"]

_DAMPING = Damping(start=1e-3, down=5.0, up=6.0, lowest=1e-9, tolerance=1e-5, iterations=40, tries=8)


@dataclass(frozen=True)
class ArticulatedResult:
    """A finished adjustment.

    Attributes:
        state: the unknowns.
        cost: half the sum of the losses.
        residual_px: (C, T, K) length of the reprojection error; NaN where nothing was seen.
        error_px: (C, T, K, 2) the same as vectors.
        covariance: (7C, 7C) of rotation (rad), centre, log focal of each camera, the gauge (where the whole
            lies, and its size) taken out so that the cameras as a whole neither move nor grow.
        iterations: done.
    """

    state: ArticulatedState
    cost: float
    residual_px: FloatArray
    error_px: FloatArray
    covariance: FloatArray
    iterations: int


def adjust_articulated(
    problem: ArticulatedProblem, start: ArticulatedState, iterations: int = 40, tolerance: float = 1e-5
) -> ArticulatedResult:
    """The most probable cameras and points.

    Args:
        problem: what was seen.
        start: where to begin; points that are NaN take no part.
        iterations: most of them.
        tolerance: relative decrease of the cost at which to stop.
    """
    system = ArticulatedSystem(problem, start)
    schedule = replace(_DAMPING, iterations=iterations, tolerance=tolerance)
    state, cost, done = minimise(system.begin, system.cost, system.linearised, system.stepped, schedule)
    error = system.reprojection(state)[0]
    return ArticulatedResult(
        state=replace(state, points=np.where(system.known[..., None], state.points, np.nan)), cost=cost,
        residual_px=np.linalg.norm(error, axis=-1), error_px=error,
        covariance=clustered_covariance(system, state, system.linearised(state)), iterations=done,
    )  # fmt: skip
