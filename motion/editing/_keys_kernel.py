"""Keys of many columns, by Ramer's, Douglas' and Peucker's division, and the ways between keys, compiled."""

import math

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics._numba import compiled

_PARALLEL = 1e-9  # sine of half the angle between two quaternions from which they are one rotation


@compiled
def _shares(values: FloatArray, k: int, a: int, b: int, t: int, even: bool) -> tuple[float, float]:
    """What the values at `a` and at `b` count in the value at `t` on the way between them."""
    share = (t - a) / (b - a)
    if not even:
        return 1 - share, share
    cosine = 0.0
    for i in range(4):
        cosine += values[a, k, i] * values[b, k, i]
    sign = -1.0 if cosine < 0 else 1.0  # the shortest way
    angle = math.acos(min(abs(cosine), 1.0))
    sine = math.sin(angle)
    if sine < _PARALLEL:
        return 1 - share, sign * share
    return math.sin((1 - share) * angle) / sine, sign * math.sin(share * angle) / sine


@compiled
def _away(values: FloatArray, k: int, a: int, b: int, t: int, even: bool) -> float:
    """How far the value at `t` is from the way between those at `a` and `b`: radians of turns, metres of places."""
    first, last = _shares(values, k, a, b, t, even)
    if not even:
        total = 0.0
        for i in range(3):
            total += (values[t, k, i] - first * values[a, k, i] - last * values[b, k, i]) ** 2
        return math.sqrt(total)
    w0, x0 = first * values[a, k, 0] + last * values[b, k, 0], first * values[a, k, 1] + last * values[b, k, 1]
    y0, z0 = first * values[a, k, 2] + last * values[b, k, 2], first * values[a, k, 3] + last * values[b, k, 3]
    w1, x1, y1, z1 = values[t, k, 0], values[t, k, 1], values[t, k, 2], values[t, k, 3]
    # The vector of conj(q0) q1: exact for small angles, which the cosine is not.
    x = w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1
    y = w0 * y1 - y0 * w1 - z0 * x1 + x0 * z1
    z = w0 * z1 - z0 * w1 - x0 * y1 + y0 * x1
    return 2 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1))


@compiled
def divide(values: FloatArray, weight: FloatArray, finest: float, even: bool) -> FloatArray:
    """Divide each column's way at the frame that is farthest from it, again and again.

    Args:
        values: (T, K, 3) metres, or (T, K, 4) unit quaternions wxyz.
        weight: (K,) of a column's metres or radians.
        finest: weighted distance up to which a way is not divided any more.
        even: whether values are quaternions, which turn evenly.

    Returns:
        (T, K) the weighted distance by which a frame became a key, and no more than that of the key that divided the
        way that it is on; infinite at both ends, 0 for frames that are no keys.
    """
    count, columns = values.shape[0], values.shape[1]
    out = np.zeros((count, columns))
    stack = np.zeros((count + 1, 2), np.int64)
    limits = np.zeros(count + 1)
    for k in range(columns):
        out[0, k] = out[count - 1, k] = np.inf
        stack[0, 0], stack[0, 1], limits[0] = 0, count - 1, np.inf
        depth = 1
        while depth > 0:
            depth -= 1
            a, b, limit = stack[depth, 0], stack[depth, 1], limits[depth]
            most, at = finest, -1
            for t in range(a + 1, b):
                away = _away(values, k, a, b, t, even) * weight[k]
                if away > most:
                    most, at = away, t
            if at < 0:
                continue
            out[at, k] = min(most, limit)
            for start, stop in ((a, at), (at, b)):
                stack[depth, 0], stack[depth, 1], limits[depth] = start, stop, out[at, k]
                depth += 1
    return out


@compiled
def between_keys(values: FloatArray, keys: BoolArray, even: bool) -> FloatArray:
    """(T, K, 3 or 4) the values at keys (T, K), which both ends are, and what is on the ways between them."""
    count, columns, size = values.shape
    out = values.copy()
    for k in range(columns):
        a = 0
        for b in range(1, count):
            if not keys[b, k]:
                continue
            for t in range(a + 1, b):
                first, last = _shares(values, k, a, b, t, even)
                for i in range(size):
                    out[t, k, i] = first * values[a, k, i] + last * values[b, k, i]
            a = b
    return out
