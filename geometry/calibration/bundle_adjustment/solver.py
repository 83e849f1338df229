"""The core of both bundle adjustments: Levenberg-Marquardt on normal equations in arrow form.

Unknowns are of two sorts. A few are shared by many observations: cameras, bone lengths. The others come in blocks
that no observation has in common, so that the blocks are coupled through the shared unknowns alone: world points, board
poses, all landmarks of one frame. The blocks are eliminated (Schur complement; Triggs et al., "Bundle adjustment, a
modern synthesis", 2000), which leaves a dense system of the shared unknowns' size.

The parts of a camera's model that both adjustments share are here too: the derivative by its pose, and the gauge, the
directions in which all cameras move together. A pose is stored as rotation `R` and centre `c`, a point in camera axes
is `y = R (x - c)`, and increments are `R <- exp(w) R`, `c <- c + dc`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from muybridge.arrays import BoolArray, FloatArray

State = TypeVar("State")
Equations = TypeVar("Equations")

POSE_SIZE = 6
"""Unknowns of a camera's pose: rotation about its axes, then shift of its centre along the world's."""
_RIDGE = 1e-12  # share of its own that a diagonal always gets


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations `H step = -b` in arrow form.

    Attributes:
        shared: (G, G) of H, the shared unknowns.
        cross: (L, D, G) of H, each block with the shared unknowns.
        blocks: (L, D, D) of H, each block with itself.
        shared_gradient: (G,) of b.
        block_gradient: (L, D) of b.
    """

    shared: FloatArray
    cross: FloatArray
    blocks: FloatArray
    shared_gradient: FloatArray
    block_gradient: FloatArray

    @staticmethod
    def zeros(shared: int, blocks: int, size: int) -> NormalEquations:
        """Equations without terms, for G shared unknowns and L blocks of D."""
        return NormalEquations(
            np.zeros((shared, shared)), np.zeros((blocks, size, shared)), np.zeros((blocks, size, size)),
            np.zeros(shared), np.zeros((blocks, size)),
        )  # fmt: skip

    def restricted(self, free: BoolArray) -> NormalEquations:
        """The same with those of the shared unknowns alone that are free, (G,)."""
        return NormalEquations(
            self.shared[np.ix_(free, free)], self.cross[:, :, free], self.blocks, self.shared_gradient[free],
            self.block_gradient,
        )  # fmt: skip


@dataclass(frozen=True)
class Reduced:
    """Normal equations without their blocks.

    Attributes:
        matrix: (G, G) Schur complement.
        gradient: (G,) its right side.
        back: (L, D, G + 1) what takes a step of the shared unknowns back to the blocks: each block's inverse times its
            cross terms, and times its gradient.
    """

    matrix: FloatArray
    gradient: FloatArray
    back: FloatArray


def reduce(equations: NormalEquations, damping: float, ridge: float = _RIDGE) -> Reduced:
    """Eliminate the blocks; unknowns of a block that nothing depends on keep their values.

    Args:
        equations: what is reduced.
        damping: share of its own that is added to the blocks' diagonal.
        ridge: the same, added whatever the damping is.
    """
    count, size, shared = equations.cross.shape
    damped = equations.blocks.copy()
    diagonal = np.einsum("lii->li", damped)
    diagonal += np.where(diagonal > 0, (damping + ridge) * diagonal, 1.0)
    right = np.concatenate([equations.cross, equations.block_gradient[..., None]], axis=-1)
    back = np.linalg.solve(damped, right)
    flat = equations.cross.reshape(count * size, shared).T @ back.reshape(count * size, shared + 1)
    return Reduced(equations.shared - flat[:, :-1], equations.shared_gradient - flat[:, -1], back)


def damped_step(equations: NormalEquations, damping: float, ridge: float = _RIDGE) -> tuple[FloatArray, FloatArray]:
    """(G,) and (L, D) step of Levenberg-Marquardt, with `reduce`'s arguments; LinAlgError where there is none."""
    reduced = reduce(equations, damping, ridge)
    diagonal = np.diag(equations.shared)
    step = np.zeros(len(diagonal))
    if len(diagonal):
        damped = reduced.matrix + np.diag((damping + _RIDGE) * diagonal + 1e-30)
        step[:] = -np.linalg.solve(damped, reduced.gradient)
    return step, -(reduced.back[..., -1] + reduced.back[..., :-1] @ step)


@dataclass(frozen=True)
class Damping:
    """How the damping follows success and failure, and when to stop.

    Attributes:
        start: factor on the diagonal that is added to it.
        down: what it is divided by after a step that lowers the cost.
        up: what it is multiplied with after one that does not.
        lowest, highest: its limits; no step is tried from `highest` on.
        tries: steps tried in one iteration at most.
        tolerance: relative decrease of the cost below which to stop.
        iterations: at most.
    """

    start: float
    down: float
    up: float
    lowest: float
    tolerance: float
    iterations: int
    highest: float = 1e8
    tries: int = 1000


def minimise(
    state: State,
    cost: Callable[[State], float],
    linearised: Callable[[State], Equations],
    stepped: Callable[[State, Equations, float], State],
    schedule: Damping,
) -> tuple[State, float, int]:
    """Levenberg-Marquardt.

    Args:
        state: where to begin.
        cost: of a state; inf for one that must not be.
        linearised: the normal equations at a state, in whatever form `stepped` takes.
        stepped: the state one damped step on; may raise LinAlgError.
        schedule: of the damping.

    Returns:
        The best state, its cost, and how many iterations were made.
    """
    value, damping, done = cost(state), schedule.start, 0
    while done < schedule.iterations:
        done += 1
        equations = linearised(state)
        gain, tries = 0.0, 0
        while tries < schedule.tries and damping < schedule.highest:
            tries += 1
            try:
                trial = stepped(state, equations, damping)
                trial_value = cost(trial)
            except np.linalg.LinAlgError:
                trial_value = np.inf
            if trial_value <= value and trial_value < np.inf:
                gain = (value - trial_value) / max(value, 1e-30)
                state, value = trial, trial_value
                damping = max(damping / schedule.down, schedule.lowest)
                break
            damping *= schedule.up
        if gain < schedule.tolerance:
            break
    return state, value, done


def cauchy(square: FloatArray, loss_sigma: float, behind: float = np.inf) -> tuple[float, FloatArray]:
    """Cost under Cauchy's loss, and the weight of each residual in the normal equations.

    Args:
        square: (N,) squared residuals, in standard deviations; NaN for a point behind its camera.
        loss_sigma: where the loss starts to bend; inf for least squares.
        behind: squared residual that a point behind its camera counts as; from there on the weight is zero.
    """
    square = np.where(np.isfinite(square), square, behind)
    if np.isinf(loss_sigma):
        return float(0.5 * square.sum()), np.where(square < behind, 1.0, 0.0)
    bent = square / loss_sigma**2
    return float(0.5 * loss_sigma**2 * np.log1p(bent).sum()), np.where(square < behind, 1 / (1 + bent), 0.0)


def by_pose(points_cam: FloatArray, rotation: FloatArray, by_point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of an image point by the camera's pose and by the world point.

    Args:
        points_cam: (..., 3) in camera axes.
        rotation: (3, 3) cam_from_world.
        by_point: (..., 2, 3) derivatives by the point in camera axes.

    Returns:
        (..., 2, 6) by rotation and centre, and (..., 2, 3) by the world point.
    """
    by_world = (by_point.reshape(-1, 3) @ rotation).reshape(by_point.shape)
    out = np.empty((*by_point.shape[:-1], POSE_SIZE))
    y = points_cam[..., None, :]
    for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):  # d/dw of exp(w) y: the columns of -[y]x
        out[..., axis] = by_point[..., j] * y[..., i] - by_point[..., i] * y[..., j]
    out[..., 3:] = -by_world
    return out, by_world


def gauge(rotations: FloatArray, centers: FloatArray) -> FloatArray:
    """(C, 6, 7) how each camera's pose changes when all are moved, turned and scaled together.

    Args:
        rotations: (C, 3, 3) cam_from_world.
        centers: (C, 3) metres.
    """
    out = np.zeros((len(rotations), POSE_SIZE, 7))
    away = centers - centers.mean(axis=0)
    for axis in range(3):
        omega = np.eye(3)[axis]
        out[:, 3 + axis, axis] = 1.0
        out[:, :3, 3 + axis] = -rotations @ omega
        out[:, 3:, 3 + axis] = np.cross(omega, away)
    out[:, 3:, 6] = away
    return out
