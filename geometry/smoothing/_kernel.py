"""The compiled parts of `muybridge.geometry.smoothing`: Kalman smoother and Viterbi path.

The smoother is a Kalman filter on position and velocity, run forwards, and the modified Bryson-Frazier recursion, run
backwards, which needs no inverse of a predicted covariance.

Source: G. J. Bierman, "Fixed interval smoothing with discrete measurements", Int. J. Control 18, 1973.
"""

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled, leaf, subroutine
from muybridge.geometry.numerics.covariances import inverse_one


@leaf
def _predict(mean: FloatArray, spread: FloatArray, dt: float, acceleration: float) -> None:
    """Predict one frame ahead, in place."""
    for i in range(3):
        mean[i] += dt * mean[3 + i]
    for i in range(3):
        for k in range(6):
            spread[i, k] += dt * spread[3 + i, k]
    for i in range(6):
        for k in range(3):
            spread[i, k] += dt * spread[i, 3 + k]
    a = acceleration**2
    for i in range(3):
        spread[i, i] += 0.25 * a * dt**4 + 1e-12
        spread[3 + i, 3 + i] += a * dt**2 + 1e-12
        spread[i, 3 + i] += 0.5 * a * dt**3
        spread[3 + i, i] += 0.5 * a * dt**3


@subroutine
def _update(
    mean: FloatArray,
    spread: FloatArray,
    point: FloatArray,
    noise: FloatArray,
    off: FloatArray,
    inverse: FloatArray,
    gain: FloatArray,
) -> float:
    """Apply a measurement in place, return its squared Mahalanobis distance; fills innovation, information, gain."""
    total = np.empty((3, 3))
    for i in range(3):
        off[i] = point[i] - mean[i]
        for k in range(3):
            total[i, k] = spread[i, k] + noise[i, k]
    inverse_one(total, inverse)
    far = 0.0
    for i in range(3):
        for k in range(3):
            far += off[i] * inverse[i, k] * off[k]
    for i in range(6):
        for k in range(3):
            gain[i, k] = spread[i, 0] * inverse[0, k] + spread[i, 1] * inverse[1, k] + spread[i, 2] * inverse[2, k]
    top = np.empty((3, 6))
    for i in range(3):
        for k in range(6):
            top[i, k] = spread[i, k]
    for i in range(6):
        mean[i] += gain[i, 0] * off[0] + gain[i, 1] * off[1] + gain[i, 2] * off[2]
        for k in range(6):
            spread[i, k] -= gain[i, 0] * top[0, k] + gain[i, 1] * top[1, k] + gain[i, 2] * top[2, k]
    for i in range(6):
        for k in range(i):
            spread[i, k] = spread[k, i] = 0.5 * (spread[i, k] + spread[k, i])
    return far


@subroutine
def _add_back(off: FloatArray, inverse: FloatArray, gain: FloatArray, adjoint: FloatArray, weight: FloatArray) -> None:
    """Add a measurement to the backward recursion, in place on (6,) and (6, 6)."""
    # (I - K H)^T v = v - H^T K^T v: only the position rows change.
    for i in range(3):
        value = 0.0
        for k in range(6):
            value += gain[k, i] * adjoint[k]
        off[i + 3] = value  # used as scratch memory behind the innovation
    for i in range(3):
        adjoint[i] -= off[i + 3] + inverse[i, 0] * off[0] + inverse[i, 1] * off[1] + inverse[i, 2] * off[2]
    rows = np.empty((3, 6))
    for i in range(3):
        for k in range(6):
            value = 0.0
            for m in range(6):
                value += gain[m, i] * weight[m, k]
            rows[i, k] = value
    for i in range(3):
        for k in range(6):
            weight[i, k] -= rows[i, k]
    for i in range(6):
        for k in range(3):
            value = 0.0
            for m in range(6):
                value += weight[i, m] * gain[m, k]
            rows[k, i] = value
    for i in range(6):
        for k in range(3):
            weight[i, k] -= rows[k, i]
    for i in range(3):
        for k in range(3):
            weight[i, k] += inverse[i, k]


@leaf
def _step_back(adjoint: FloatArray, weight: FloatArray, dt: float) -> None:
    """Apply `F^T v` and `F^T W F`, in place."""
    for i in range(3):
        adjoint[3 + i] += dt * adjoint[i]
        for k in range(6):
            weight[3 + i, k] += dt * weight[i, k]
    for i in range(6):
        for k in range(3):
            weight[i, 3 + k] += dt * weight[i, k]


@compiled
def smooth_all(
    xyz: FloatArray, noise: FloatArray, known: BoolArray, dt: float, acceleration: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kalman smoother with constant velocity and white-noise acceleration, for each landmark separately.

    Args:
        xyz: (T, J, 3); read only where `known`.
        noise: (T, J, 3, 3) covariance of each point.
        known: (T, J) whether there is a measurement.
        dt: frame interval, seconds.
        acceleration: standard deviation of each frame's acceleration, metres per second squared.

    Returns:
        (T, J, 3) positions and (T, J, 3, 3) covariances, NaN for a landmark that is never known; (T, J) squared
        Mahalanobis distance of each point from its prediction, NaN where there is none.
    """
    t_count, j_count = known.shape
    places, spreads = np.empty((t_count, j_count, 3)), np.empty((t_count, j_count, 3, 3))
    surprise = np.empty((t_count, j_count))
    places[:], spreads[:], surprise[:] = np.nan, np.nan, np.nan
    means, covers = np.empty((t_count, 6)), np.empty((t_count, 6, 6))
    offs, inverses, gains = np.empty((t_count, 6)), np.empty((t_count, 3, 3)), np.empty((t_count, 6, 3))
    mean, cover = np.empty(6), np.empty((6, 6))
    adjoint, weight = np.empty(6), np.empty((6, 6))
    for j in range(j_count):
        first = -1
        for t in range(t_count):
            if known[t, j]:
                first = t
                break
        if first < 0:
            continue
        mean[:], cover[:] = 0.0, 0.0
        for i in range(3):
            mean[i], cover[i, i], cover[3 + i, 3 + i] = xyz[first, j, i], 4.0, 9.0
        for t in range(t_count):
            if t:
                _predict(mean, cover, dt, acceleration)
            if known[t, j]:
                far = _update(mean, cover, xyz[t, j], noise[t, j], offs[t], inverses[t], gains[t])
                if t > first:
                    surprise[t, j] = far
            for i in range(6):
                means[t, i] = mean[i]
                for k in range(6):
                    covers[t, i, k] = cover[i, k]
        adjoint[:], weight[:] = 0.0, 0.0
        for t in range(t_count - 1, -1, -1):
            _smooth_state(means[t], covers[t], adjoint, weight, places[t, j], spreads[t, j])
            if known[t, j]:
                _add_back(offs[t], inverses[t], gains[t], adjoint, weight)
            _step_back(adjoint, weight, dt)
    return places, spreads, surprise


@subroutine
def _smooth_state(
    mean: FloatArray, cover: FloatArray, adjoint: FloatArray, weight: FloatArray, place: FloatArray, spread: FloatArray
) -> None:
    """Position and covariance from the filter's state and the backward recursion."""
    rows = np.empty((3, 6))
    for i in range(3):
        place[i] = mean[i]
        for k in range(6):
            place[i] -= cover[i, k] * adjoint[k]
            value = 0.0
            for m in range(6):
                value += cover[i, m] * weight[m, k]
            rows[i, k] = value
    for i in range(3):
        for k in range(3):
            value = cover[i, k]
            for m in range(6):
                value -= rows[i, m] * cover[m, k]
            spread[i, k] = value


@compiled
def flipped_path(costs: FloatArray, known: BoolArray, group: IntArray, prior: FloatArray) -> BoolArray:
    """(T, G) whether each group of pairs is flipped: the most probable two-state path (Viterbi 1967).

    A pair that is missing for a while is compared with its last known frame, so every path keeps the state of that
    frame.

    Args:
        costs: (T, N, 2) cost of a pair's step if its state stays or changes.
        known: (T, N) whether a pair is known.
        group: (N,) group of each pair.
        prior: (T, G) cost of the flipped state.
    """
    t_count, pairs = known.shape
    groups = prior.shape[1]
    total, ways = np.zeros((groups, 2)), np.empty((groups, 2, 2))
    came = np.zeros((t_count, groups, 2), dtype=np.int64)
    last = np.zeros((pairs, 2), dtype=np.int64)  # state when last known, by pair and present state
    inherited = np.empty(2, dtype=np.int64)
    for t in range(t_count):
        for g in range(groups):
            for before in range(2):
                for now in range(2):
                    ways[g, before, now] = total[g, before]
        for n in range(pairs):
            for before in range(2):
                for now in range(2):
                    ways[group[n], before, now] += costs[t, n, 1 if last[n, before] != now else 0]
        for g in range(groups):
            for now in range(2):
                came[t, g, now] = 1 if ways[g, 1, now] < ways[g, 0, now] else 0
                total[g, now] = ways[g, came[t, g, now], now]
            total[g, 1] += prior[t, g]
        for n in range(pairs):
            for now in range(2):
                inherited[now] = now if known[t, n] else last[n, came[t, group[n], now]]
            last[n, 0], last[n, 1] = inherited[0], inherited[1]
    path = np.empty((t_count, groups), dtype=np.bool_)
    for g in range(groups):
        state = 1 if total[g, 1] < total[g, 0] else 0
        for t in range(t_count - 1, -1, -1):
            path[t, g] = state == 1
            state = came[t, g, state]
    return path
