"""Inverse kinematics as constrained nonlinear programming, and one step of it that every method can share.

The goal function is the weighted sum of squares of what the goals are off: a position by its distance, a direction by
the chord between the axis and where it should point. Limits are bounds; joints may be coupled by linear equations and
inequalities. Source: J. Zhao, N. I. Badler, "Inverse kinematics positioning using nonlinear programming for highly
articulated figures", ACM Transactions on Graphics 13, 1994.
"""

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, minimize

from muybridge.arrays import FloatArray
from muybridge.geometry.ik.tree import GoalArrays, KinematicTree, Links, forward, rotate
from muybridge.geometry.numerics._numba import compiled


@compiled
def goal_function(links: Links, targets: GoalArrays, theta: FloatArray, gradient: FloatArray) -> float:
    """Half the sum of squares; fills its gradient (N,)."""
    n = len(theta)
    turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    forward(links, theta, turns, places, axes)
    gradient[:] = 0.0
    point, off = np.empty(3), np.empty(3)
    total = 0.0
    for e in range(len(targets.joint)):
        carrier = targets.joint[e]
        for k in range(-1, targets.pairs[e]):
            if k < 0:
                weight = targets.place_weight[e] ** 2
                if weight == 0:
                    continue
                rotate(turns[carrier], targets.offset[e], point)
                for i in range(3):
                    point[i] += places[carrier, i]
                    off[i] = point[i] - targets.place[e, i]
            else:
                weight = targets.turn_weight[e] ** 2 * (0.5 if targets.pairs[e] == 3 else 1.0)
                rotate(turns[carrier], targets.local[e, k], point)
                for i in range(3):
                    off[i] = point[i] - targets.world[e, k, i]
            total += 0.5 * weight * (off[0] ** 2 + off[1] ** 2 + off[2] ** 2)
            j = carrier
            while j >= 0:
                a = axes[j]
                x, y, z = point[0], point[1], point[2]
                if k < 0:
                    x, y, z = x - places[j, 0], y - places[j, 1], z - places[j, 2]
                gradient[j] += weight * (
                    (a[1] * z - a[2] * y) * off[0] + (a[2] * x - a[0] * z) * off[1] + (a[0] * y - a[1] * x) * off[2]
                )
                j = links.parents[j]
    return total


def solve_nonlinear(
    tree: KinematicTree, targets: GoalArrays, theta: FloatArray, iterations: int, tolerance: float,
    constraint: LinearConstraint | None = None,
) -> tuple[FloatArray, int]:  # fmt: skip
    """Angles and iterations.

    Bounds alone go to L-BFGS-B, linear constraints to SLSQP: both are the quasi-Newton methods with an active set that
    the paper builds by hand.
    """
    gradient = np.empty(len(tree))

    def value(x: FloatArray) -> tuple[float, FloatArray]:
        return float(goal_function(tree.links, targets, np.ascontiguousarray(x), gradient)), gradient.copy()

    bounds = Bounds(tree.lower, tree.upper)
    if constraint is None:
        options = {"maxiter": iterations, "ftol": 1e-15, "gtol": tolerance, "maxcor": 20}
        found = minimize(value, theta, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    else:
        options = {"maxiter": iterations, "ftol": 1e-14}
        found = minimize(
            value, theta, jac=True, method="SLSQP", bounds=bounds, constraints=[constraint], options=options
        )
    return tree.clipped(found.x), int(found.nit)
