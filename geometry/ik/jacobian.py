"""The methods that follow the Jacobian: transpose, pseudo-inverse, damped least squares, null space.

Sources: S. R. Buss, "Introduction to inverse kinematics with Jacobian transpose, pseudoinverse and damped least
squares methods", 2009 (step of the transpose, clamped goals); Y. Nakamura, H. Hanafusa, 1986, and A. A. Maciejewski,
C. A. Klein, 1988 (damping that grows as the smallest singular value goes to zero), T. Sugihara, 2011 (and with the
error); R. Parent, Computer Animation, 3rd edition, 2012, section 5.3 (secondary goals with gains in the null space);
R. Baerlocher, R. Boulic, 2004 (limits by locking joints and solving again).
"""

import math

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.ik.tree import GoalArrays, Links, errors, forward, rotate, rotation_error
from muybridge.geometry.numerics._numba import compiled

TRANSPOSE, PSEUDO_INVERSE, DAMPED, NULL_SPACE = range(4)


@compiled
def rows_of(targets: GoalArrays) -> int:
    """Number of scalar equations of the goals."""
    count = 0
    for e in range(len(targets.joint)):
        count += 3 * (targets.place_weight[e] > 0) + 3 * (targets.pairs[e] > 0)
    return count


@compiled
def equations(
    links: Links, targets: GoalArrays, theta: FloatArray, longest: float, jacobian: FloatArray, wanted: FloatArray
) -> None:
    """Weighted Jacobian (M, N) and the wanted motion of the effectors (M,), no goal by more than `longest` metres."""
    n = len(links.parents)
    turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    forward(links, theta, turns, places, axes)
    point, v, axis = np.empty(3), np.empty(3), np.empty(3)
    jacobian[:] = 0.0
    row = 0
    for e in range(len(targets.joint)):
        carrier = targets.joint[e]
        rotate(turns[carrier], targets.offset[e], point)
        point += places[carrier]
        if targets.place_weight[e] > 0:
            w = targets.place_weight[e]
            length = 0.0
            for i in range(3):
                v[i] = targets.place[e, i] - point[i]
                length += v[i] * v[i]
            scale = w * min(1.0, longest / max(math.sqrt(length), 1e-12))
            for i in range(3):
                wanted[row + i] = scale * v[i]
            j = carrier
            while j >= 0:
                a = axes[j]
                x, y, z = point[0] - places[j, 0], point[1] - places[j, 1], point[2] - places[j, 2]
                jacobian[row, j] = w * (a[1] * z - a[2] * y)
                jacobian[row + 1, j] = w * (a[2] * x - a[0] * z)
                jacobian[row + 2, j] = w * (a[0] * y - a[1] * x)
                j = links.parents[j]
            row += 3
        if targets.pairs[e] > 0:
            w = targets.turn_weight[e]
            angle = rotation_error(turns[carrier], targets.local[e], targets.world[e], targets.pairs[e], v)
            scale = w * min(1.0, 0.8 / max(angle, 1e-12))
            rotate(turns[carrier], targets.local[e, 0], axis)
            free = targets.pairs[e] == 1  # a direction does not mind a turn about itself
            for i in range(3):
                wanted[row + i] = scale * v[i]
            j = carrier
            while j >= 0:
                a = axes[j]
                along = (a[0] * axis[0] + a[1] * axis[1] + a[2] * axis[2]) if free else 0.0
                for i in range(3):
                    jacobian[row + i, j] = w * (a[i] - along * axis[i])
                j = links.parents[j]
            row += 3


@compiled
def inverses(jacobian: FloatArray, damping: float, near: float) -> tuple[FloatArray, FloatArray]:
    """(N, M) pseudo-inverse of the Jacobian, damped where its smallest singular value falls below `near`, and plain.

    lambda^2 = (1 - (s_min / near)^2) damping^2 there, and zero elsewhere; the plain one only drops singular values of
    nothing.
    """
    values, vectors = np.linalg.eigh(jacobian @ jacobian.T)
    m = len(values)
    smallest = math.sqrt(max(values[0], 0.0))
    square = (1 - (smallest / near) ** 2) * damping**2 if smallest < near else 0.0
    gains, plain = np.zeros(m), np.zeros(m)
    for i in range(m):
        if values[i] > 1e-10 * max(values[m - 1], 1e-10):
            gains[i] = 1.0 / (values[i] + square)
            plain[i] = 1.0 / values[i]
    return jacobian.T @ ((vectors * gains) @ vectors.T), jacobian.T @ ((vectors * plain) @ vectors.T)


@compiled
def step_of(
    jacobian: FloatArray, wanted: FloatArray, theta: FloatArray, method: int, damping: float, near: float,
    preferred: FloatArray, gains: FloatArray, locked: BoolArray,
) -> FloatArray:  # fmt: skip
    """(N,) step of the angles; zero for those that are locked."""
    free = jacobian.copy()
    for j in range(len(locked)):
        if locked[j]:
            free[:, j] = 0.0
    if method == TRANSPOSE:
        back = free.T @ wanted
        along = free @ back
        square = along @ along
        return back * ((wanted @ along) / square) if square > 1e-18 else back
    # What is nearly there needs no damping: its steps are short anyway (Sugihara 2011).
    near_goal = min(1.0, math.sqrt(wanted @ wanted) / 0.1)
    damped, plain = inverses(free, damping * near_goal, near)
    step = (plain if method == PSEUDO_INVERSE else damped) @ wanted
    if method == NULL_SPACE:
        gradient = 2 * gains * (theta - preferred)
        for j in range(len(locked)):
            if locked[j]:
                gradient[j] = 0.0
        step += plain @ (free @ gradient) - gradient
    return step


@compiled
def limited_step(
    links: Links, jacobian: FloatArray, wanted: FloatArray, theta: FloatArray, method: int, damping: float, near: float,
    preferred: FloatArray, gains: FloatArray, longest: float,
) -> FloatArray:  # fmt: skip
    """(N,) new angles within the limits: a joint that would leave them is put there and locked, then solved again."""
    n = len(theta)
    locked, fixed = np.zeros(n, dtype=np.bool_), np.zeros(n)
    out = theta.copy()
    right = wanted.copy()
    for _ in range(n):
        step = step_of(jacobian, right, theta, method, damping, near, preferred, gains, locked)
        largest = max(np.max(np.abs(step)), 1e-12)
        if largest > longest:
            step *= longest / largest
        worst, which = 1e-12, -1
        for j in range(n):
            out[j] = theta[j] + (fixed[j] if locked[j] else step[j])
            over = max(links.lower[j] - out[j], out[j] - links.upper[j])
            if not locked[j] and over > worst:
                worst, which = over, j
        if which < 0 or method == TRANSPOSE:
            break
        locked[which] = True
        fixed[which] = min(max(out[which], links.lower[which]), links.upper[which]) - theta[which]
        right = right - jacobian[:, which] * fixed[which]
    for j in range(n):
        out[j] = min(max(out[j], links.lower[j]), links.upper[j])
    return out


@compiled
def uniform(state: NDArray[np.uint64]) -> float:
    """A number in 0..1."""
    state[0] = state[0] * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
    return float(state[0] >> np.uint64(11)) / 9007199254740992.0


@compiled
def perturb(links: Links, theta: FloatArray, size: float, state: NDArray[np.uint64]) -> FloatArray:
    """Another start nearby, within the limits. `state` (1,) is that of a linear congruential generator (Knuth)."""
    out = theta.copy()
    for j in range(len(theta)):
        reach = min(links.upper[j] - links.lower[j], 2 * math.pi)
        out[j] = min(max(out[j] + size * reach * (uniform(state) - 0.5), links.lower[j]), links.upper[j])
    return out


@compiled
def good_enough(place: FloatArray, turn: FloatArray, near: float, straight: float) -> bool:
    """Whether all goals are within `near` metres and `straight` radians."""
    return bool(np.max(place) <= near and np.max(turn) <= straight)


@compiled
def follow_jacobian(
    links: Links, targets: GoalArrays, theta: FloatArray, method: int, iterations: int, near: float, straight: float,
    damping: float, singular: float, longest: float, preferred: FloatArray, gains: FloatArray, patience: int, seed: int,
) -> tuple[FloatArray, int]:  # fmt: skip
    """Steps until the goals are met; another start after `patience` steps without progress. Best angles and steps."""
    state = np.array([seed], dtype=np.uint64)
    uniform(state)
    e_count, m = len(targets.joint), rows_of(targets)
    jacobian, wanted = np.zeros((m, len(theta))), np.zeros(m)
    place, turn = np.zeros(e_count), np.zeros(e_count)
    best, value = theta.copy(), errors(links, targets, theta, place, turn)
    since, tried, local = 0, 0, value
    done = -1
    for k in range(iterations):
        if good_enough(place, turn, near, straight):
            best = theta.copy()
            # With a secondary goal go on for some steps: it moves within the null space.
            done = k if done < 0 else done
            if method != NULL_SPACE or k - done >= 10:
                return best, k
        equations(links, targets, theta, longest, jacobian, wanted)
        theta = limited_step(links, jacobian, wanted, theta, method, damping, singular, preferred, gains, 0.6)
        now = errors(links, targets, theta, place, turn)
        if now < value and done < 0:
            best, value = theta.copy(), now
        if now < 0.999 * local:
            local, since = now, 0
        else:
            since += 1
        if since > patience and done < 0:
            tried += 1
            theta = perturb(links, best, min(0.1 * 2.0**tried, 1.0), state)
            local, since = errors(links, targets, theta, place, turn), 0
    return best, iterations
