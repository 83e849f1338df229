"""The compiled part of the whole-take fit: smoothness between frames and the banded normal equations.

The band is stored with one row per unknown: `band[t N + i, k]` is the matrix at row `t N + i + k` and column
`t N + i`, so its transpose is LAPACK's lower form in the memory order that LAPACK wants.
"""

import math

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.fitting._chain_kernel import forward_one, normal_equations, place_child
from muybridge.geometry.fitting.chain import Chain
from muybridge.geometry.numerics._numba import compiled, leaf, subroutine


@subroutine
def log_between(before: FloatArray, after: FloatArray, out: FloatArray) -> None:
    """Rotation vector of `after before^T`, which is taken to be a turn of less than pi."""
    r = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            r[i, k] = after[i, 0] * before[k, 0] + after[i, 1] * before[k, 1] + after[i, 2] * before[k, 2]
    out[0], out[1], out[2] = 0.5 * (r[2, 1] - r[1, 2]), 0.5 * (r[0, 2] - r[2, 0]), 0.5 * (r[1, 0] - r[0, 1])
    sine = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1)
    if cosine > -0.99:
        scale = 1.0 + sine * sine / 6 if sine < 1e-5 else math.atan2(sine, cosine) / sine
        for i in range(3):
            out[i] *= scale
        return
    # Near half a turn the antisymmetric part vanishes: the axis is the largest column of r + 1.
    best = 0
    for i in range(1, 3):
        if r[i, i] > r[best, best]:
            best = i
    axis = np.array([r[0, best] + r[best, 0], r[1, best] + r[best, 1], r[2, best] + r[best, 2]])
    axis[best] = 2 * (1 + r[best, best]) - (1 + cosine) * 2
    norm = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    sign = -1.0 if axis[0] * out[0] + axis[1] * out[1] + axis[2] * out[2] < 0 else 1.0
    for i in range(3):
        out[i] = sign * axis[i] / norm * math.atan2(sine, cosine)


@subroutine
def differences(chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray) -> FloatArray:
    """(T - 1, N) from each frame to the next."""
    n = len(chain.above)
    out = np.empty((max(len(root) - 1, 0), n))
    for t in range(len(out)):
        for i in range(3):
            out[t, i] = root[t + 1, i] - root[t, i]
        log_between(turn[t], turn[t + 1], out[t, 3:6])
        for k in range(n - 6):
            j, i = chain.open_joint[k], chain.open_axis[k]
            out[t, 6 + k] = angles[t + 1, j, i] - angles[t, j, i]
    return out


@compiled
def total_cost(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    velocity: FloatArray, acceleration: FloatArray,
) -> float:  # fmt: skip
    """Half the weighted sum of squares of all terms; `velocity` and `acceleration` are (N,)."""
    j_count, n = len(chain.parents), len(chain.above)
    turns, places, axes = np.empty((j_count, 3, 3)), np.empty((j_count, 3)), np.empty((0, 3))
    e = np.empty(3)
    total = 0.0
    for t in range(len(root)):
        forward_one(chain, turn[t], angles[t], turns, places, axes, False)
        for landmark in range(len(chain.carrier)):
            w, j = information[t, landmark], chain.carrier[landmark]
            place_child(turns[j], places[j], chain.places[landmark], e)
            for i in range(3):
                e[i] += root[t, i] - targets[t, landmark, i]
            for i in range(3):
                total += 0.5 * e[i] * (w[i, 0] * e[0] + w[i, 1] * e[1] + w[i, 2] * e[2])
    step = differences(chain, root, turn, angles)
    for t in range(len(root)):
        for k in range(n - 6):
            total += 0.5 * chain.prior[k] * (angles[t, chain.open_joint[k], chain.open_axis[k]] - chain.rest[k]) ** 2
    for t in range(len(step)):
        for i in range(n):
            total += 0.5 * velocity[i] * step[t, i] ** 2
            if t:
                total += 0.5 * acceleration[i] * (step[t, i] - step[t - 1, i]) ** 2
    return total


@leaf
def resist_acceleration(
    band: FloatArray, slope: FloatArray, step: FloatArray, t: int, i: int, weight: float
) -> None:  # fmt: skip
    """Add half of `weight` times the square of how unknown `i` changes its step after frame `t`, in place.

    Args:
        band: (T N, 2 N + 1), the lower band.
        slope: (T, N) negative gradient.
        step: (T - 1, N) differences between frames.
        t, i: the first of the three frames, and the unknown.
        weight: of the term.
    """
    n = slope.shape[1]
    here = t * n + i
    bend = weight * (step[t + 1, i] - step[t, i])
    slope[t, i] += bend
    slope[t + 1, i] -= 2 * bend
    slope[t + 2, i] += bend
    band[here, 0] += weight
    band[here + n, 0] += 4 * weight
    band[here + 2 * n, 0] += weight
    band[here, n] -= 2 * weight
    band[here + n, n] -= 2 * weight
    band[here, 2 * n] += weight


@compiled
def assemble(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    velocity: FloatArray, acceleration: FloatArray, band: FloatArray,
) -> FloatArray:  # fmt: skip
    """Gradient (T, N) of all terms; `band` (T N, 2 N + 1) is filled."""
    t_count, n = len(root), len(chain.above)
    step = differences(chain, root, turn, angles)
    band[:] = 0.0
    slope = np.empty((t_count, n))
    for t in range(t_count):
        matrix, own, _ = normal_equations(chain, root, turn, angles, targets, information, t, t + 1)
        start = t * n
        for a in range(n):
            slope[t, a] = own[0, a]
            b = a
            while b >= 0:
                band[start + b, a - b] = matrix[0, a, b]
                b = chain.above[b]
        for k in range(n - 6):
            band[start + 6 + k, 0] += chain.prior[k]
            slope[t, 6 + k] += chain.prior[k] * (angles[t, chain.open_joint[k], chain.open_axis[k]] - chain.rest[k])
    for t in range(t_count - 1):
        here = t * n
        for i in range(n):
            w = velocity[i]
            slope[t, i] -= w * step[t, i]
            slope[t + 1, i] += w * step[t, i]
            band[here + i, 0] += w
            band[here + n + i, 0] += w
            band[here + i, n] -= w
            if t + 2 < t_count:
                resist_acceleration(band, slope, step, t, i, acceleration[i])
    return slope
