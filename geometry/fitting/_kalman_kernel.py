"""The compiled tracker of the body fit: each frame from the frames before it.

A Kalman filter on every unknown and its rate, whose measurement is a Gauss-Newton solution of the whole frame: what
the filter predicts is a prior on each unknown, limits are an active set, far landmarks lose weight (Student's t).
Between unknowns the filter keeps no correlations; within a frame the solution has them all.
"""

import math

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.fitting._banded_kernel import log_between
from muybridge.geometry.fitting._chain_kernel import (
    add_landmark,
    exp_one,
    factor,
    forward_one,
    gather,
    inverse_diagonal,
    landmarks_of,
    multiply,
    place_child,
    substitute,
)
from muybridge.geometry.fitting.chain import Chain
from muybridge.geometry.numerics._numba import compiled, subroutine


@subroutine
def frame_equations(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    student_dof: float, widen: float, matrix: FloatArray, slope: FloatArray,
) -> float:  # fmt: skip
    """One frame with scalar information (L,) and robust weights; the robust cost.

    `student_dof` of 0 is least squares; `widen` is the factor on the variance against which far is measured.
    """
    j_count, n = len(chain.parents), len(chain.above)
    turns, places, axes = np.empty((j_count, 3, 3)), np.empty((j_count, 3)), np.empty((n - 6, 3))
    blocks, forces = np.zeros((j_count, 6, 6)), np.zeros((j_count, 6))
    forward_one(chain, turn, angles, turns, places, axes, True)
    r, e, w = np.empty(3), np.empty(3), np.zeros((3, 3))
    total = 0.0
    for landmark in range(len(chain.carrier)):
        certain = information[landmark]
        if certain <= 0:
            continue
        j = chain.carrier[landmark]
        place_child(turns[j], places[j], chain.places[landmark], r)
        square = 0.0
        for i in range(3):
            e[i] = r[i] + root[i] - targets[landmark, i]
            square += e[i] * e[i]
        far = square * certain / widen
        if student_dof > 0:
            total += 0.5 * widen * (student_dof + 3) * math.log1p(far / student_dof)
            certain *= min(1.0, (student_dof + 3) / (student_dof + far))
        else:
            total += 0.5 * widen * far
        w[0, 0] = w[1, 1] = w[2, 2] = certain
        add_landmark(r, w, e, blocks[j], forces[j])
    gather(chain, places, axes, blocks, forces, matrix, slope)
    return total


@subroutine
def hold_at_limits(chain: Chain, angles: FloatArray, matrix: FloatArray, slope: FloatArray) -> None:
    """Remove angles that are pressed against a limit: unit rows, no gradient."""
    n = len(chain.above)
    held = np.zeros(n, dtype=np.bool_)
    some = False
    for k in range(n - 6):
        value = angles[chain.open_joint[k], chain.open_axis[k]]
        g = slope[6 + k]
        if (value <= chain.lower[k] and g > 0) or (value >= chain.upper[k] and g < 0):
            held[6 + k] = some = True
    if not some:
        return
    for k in range(6, n):
        i = chain.above[k]
        while i >= 0:
            if held[k] or held[i]:
                matrix[k, i] = 0.0
            i = chain.above[i]
        if held[k]:
            matrix[k, k], slope[k] = 1.0, 0.0


@subroutine
def move(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, step: FloatArray, longest: float
) -> float:
    """Take a step in place within the limits, no unknown by more than `longest`; returns its largest rotation."""
    largest = 0.0
    for i in range(3, len(step)):
        largest = max(largest, abs(step[i]))
    scale = longest / largest if largest > longest else 1.0
    little, product = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        root[i] += scale * step[i]
    exp_one(scale * step[3], scale * step[4], scale * step[5], little)
    multiply(little, turn, product)
    turn[:] = product
    for k in range(len(step) - 6):
        j, i = chain.open_joint[k], chain.open_axis[k]
        angles[j, i] = min(max(angles[j, i] + scale * step[6 + k], chain.lower[k]), chain.upper[k])
    return scale * largest


@compiled
def settle(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    student_dof: float, iterations: int,
) -> float:  # fmt: skip
    """Levenberg-Marquardt on one frame, in place and without a prediction; the cost reached."""
    n = len(chain.above)
    matrix, slope = np.zeros((n, n)), np.empty(n)
    old_root, old_turn, old_angles = root.copy(), turn.copy(), angles.copy()
    damping, best, again = 1e-3, np.inf, False
    for _ in range(iterations):
        cost = frame_equations(chain, root, turn, angles, targets, information, student_dof, 1.0, matrix, slope)
        for k in range(n - 6):
            off = angles[chain.open_joint[k], chain.open_axis[k]] - chain.rest[k]
            cost += 0.5 * chain.prior[k] * off * off
            slope[6 + k] += chain.prior[k] * off
            matrix[6 + k, 6 + k] += chain.prior[k]
        if cost > best:
            root[:], turn[:], angles[:] = old_root, old_turn, old_angles
            damping, again = min(damping * 10, 1e6), True  # from the same place, more carefully
            continue
        done = not again and best - cost < 1e-6 * cost
        best, again = cost, False
        old_root[:], old_turn[:], old_angles[:] = root, turn, angles
        if done:
            break
        for k in range(n):
            matrix[k, k] += damping * matrix[k, k] + 1e-6
        hold_at_limits(chain, angles, matrix, slope)
        if not factor(chain.above, matrix):
            break
        for k in range(n):
            slope[k] = -slope[k]
        substitute(chain.above, matrix, slope)
        move(chain, root, turn, angles, slope, 1.0)
        damping = max(damping * 0.2, 1e-9)
    root[:], turn[:], angles[:] = old_root, old_turn, old_angles
    return best


@compiled
def track_one(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, rate: FloatArray, spread: FloatArray,
    targets: FloatArray, information: FloatArray, dt: float, jerkiness: FloatArray, student_dof: float, iterations: int,
) -> None:  # fmt: skip
    """One frame ahead, in place.

    Args:
        chain: the skeleton.
        root, turn, angles: the pose of the frame before; becomes this one's.
        rate: (N,) of every unknown, per second.
        spread: (N, 3) variance of the unknown, its covariance with the rate, the rate's variance.
        targets: (L, 3) metres; information: (L,) inverse variance, 0 where missing.
        dt: seconds since the frame before.
        jerkiness: (N,) variance of the acceleration.
        student_dof: of the robust loss. iterations: Gauss-Newton steps.
    """
    n = len(chain.above)
    matrix, slope, rows = np.zeros((n, n)), np.empty(n), np.empty((n, n))
    ahead, variance = np.empty(n), np.empty(n)
    for i in range(n):
        a = jerkiness[i]
        spread[i, 0] += 2 * dt * spread[i, 1] + dt * dt * spread[i, 2] + 0.25 * a * dt**4 + 1e-12
        spread[i, 1] += dt * spread[i, 2] + 0.5 * a * dt**3
        spread[i, 2] += a * dt * dt
        ahead[i] = rate[i] * dt
    move(chain, root, turn, angles, ahead, 1.0)
    first_root, first_turn, first_angles = root.copy(), turn.copy(), angles.copy()
    off = np.zeros(n)
    for k in range(iterations):
        frame_equations(
            chain, root, turn, angles, targets, information, student_dof, 4.0 if k == 0 else 1.0, matrix, slope
        )
        if k:
            difference(chain, first_root, first_turn, first_angles, root, turn, angles, off)
        for i in range(n):
            matrix[i, i] += 1.0 / spread[i, 0]
            slope[i] += off[i] / spread[i, 0]
            if i >= 6:
                value = angles[chain.open_joint[i - 6], chain.open_axis[i - 6]]
                matrix[i, i] += chain.prior[i - 6]
                slope[i] += chain.prior[i - 6] * (value - chain.rest[i - 6])
        hold_at_limits(chain, angles, matrix, slope)
        if not factor(chain.above, matrix):
            break
        for i in range(n):
            slope[i] = -slope[i]
        substitute(chain.above, matrix, slope)
        if move(chain, root, turn, angles, slope, 0.6) < 1e-4 and k:
            break
    inverse_diagonal(chain.above, matrix, rows, variance)
    difference(chain, first_root, first_turn, first_angles, root, turn, angles, off)
    for i in range(n):
        p, pv = spread[i, 0], spread[i, 1]
        after = min(variance[i], p)
        gain = (p - after) / p
        rate[i] += pv / p * off[i]
        spread[i, 0] = after
        spread[i, 1] = pv * (1 - gain)
        spread[i, 2] -= gain * pv * pv / p
        if i >= 6:
            value = angles[chain.open_joint[i - 6], chain.open_axis[i - 6]]
            at_limit = (value <= chain.lower[i - 6] and rate[i] < 0) or (value >= chain.upper[i - 6] and rate[i] > 0)
            if at_limit:
                rate[i] = 0.0


@subroutine
def difference(
    chain: Chain,
    root: FloatArray,
    turn: FloatArray,
    angles: FloatArray,
    root2: FloatArray,
    turn2: FloatArray,
    angles2: FloatArray,
    out: FloatArray,
) -> None:
    """(N,) from one pose to another."""
    for i in range(3):
        out[i] = root2[i] - root[i]
    log_between(turn, turn2, out[3:6])
    for k in range(len(out) - 6):
        j, i = chain.open_joint[k], chain.open_axis[k]
        out[6 + k] = angles2[j, i] - angles[j, i]


@compiled
def count_far(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray
) -> tuple[int, int]:
    """Number of points, and of those farther than five standard deviations from the body."""
    at = landmarks_of(chain, root.reshape(1, 3), turn.reshape(1, 3, 3), angles.reshape((1, *angles.shape)))
    known = far = 0
    for landmark in range(len(targets)):
        if information[landmark] > 0:
            known += 1
            square = 0.0
            for i in range(3):
                square += (at[0, landmark, i] - targets[landmark, i]) ** 2
            far += square * information[landmark] > 75.0
    return known, far


@compiled
def track(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, rate: FloatArray, spread: FloatArray,
    targets: FloatArray, information: FloatArray, dt: float, jerkiness: FloatArray, student_dof: float,
    iterations: int, patience: int,
    roots: FloatArray, turns: FloatArray, all_angles: FloatArray,
) -> int:  # fmt: skip
    """`track_one` over (T, L, 3) targets, until the body seems lost: a quarter of the points are outliers.

    Args, besides those of `track_one`:
        patience: number of frames at the start that are not checked.
        roots, turns, all_angles: (T, 3), (T, 3, 3) and (T, J, 3), filled.

    Returns:
        The frame at which it was lost (filled all the same), or T.
    """
    for t in range(len(targets)):
        track_one(
            chain, root, turn, angles, rate, spread, targets[t], information[t], dt, jerkiness, student_dof, iterations
        )
        roots[t], turns[t], all_angles[t] = root, turn, angles
        if t >= patience:
            known, far = count_far(chain, root, turn, angles, targets[t], information[t])
            if known >= 4 and 4 * far > known:
                return t
    return len(targets)
