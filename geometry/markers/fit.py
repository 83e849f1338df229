"""How well the distances of a labelling fit bodies: the compiled sums that `whole` maximises."""

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled_with


@compiled_with()
def _pair(i: int, j: int, a: int, b: int, seen: FloatArray, known: FloatArray, scale: float,
          weights: FloatArray) -> float:  # fmt: skip
    """How well columns i and j fit as labels a and b."""
    mean, spread, distance, sigma, motion = seen[0, i, j], seen[1, i, j], known[0, a, b], known[1, a, b], known[2, a, b]
    wide = sigma * sigma + 0.3 * motion * motion
    off = mean / scale - distance
    fit = weights[0] * (1.0 - min(off * off / wide / 4.5, 3.0))
    more = spread / (1.5 * motion + 0.01)
    if more > 1.0:
        fit -= weights[1] * min((more - 1.0) * 0.7, 2.0)
    weighted: float = fit * seen[2, i, j]
    return weighted


@compiled_with()
def fit_of(a: int, k: int, chosen: IndexArray, seen: FloatArray, known: FloatArray, twin: IndexArray, scale: float,
           weights: FloatArray) -> float:  # fmt: skip
    """How well distances fit if label a is column k and the others are `chosen` (-1 for none; that of a is ignored).

    `seen` is (3, K, K), see `Columns`: means, deviations, weights; `known` (4, A, A), see `Bodies`.
    """
    out = 0.0
    p = twin[a]
    for b in range(len(chosen)):
        j = chosen[b]
        if b == a or j < 0 or known[3, a, b] == 0.0 or seen[2, k, j] == 0.0:
            continue
        out += _pair(k, j, a, b, seen, known, scale, weights)
        # A pair and its mirror image are alike on one person, with the same examiner.
        q = twin[b]
        if known[2, a, b] > 0.015 or b == p or (p == a and q == b) or q == a:
            continue
        r, s = k if p == a else chosen[p], j if q == b else chosen[q]
        if r >= 0 and s >= 0 and seen[2, r, s] > 0.0:
            width = 0.012 + 0.03 * known[0, a, b]
            off = seen[0, k, j] - seen[0, r, s]
            alike = 0.5 - min(off * off / (width * width + 4.0 * known[2, a, b] ** 2) / 2.0, 2.0)
            out += weights[2] * alike * seen[2, r, s] * seen[2, k, j]
    return out


@compiled_with()
def geometry_of(chosen: IndexArray, seen: FloatArray, known: FloatArray, twin: IndexArray, scale: float,
                weights: FloatArray) -> float:  # fmt: skip
    """How well all distances fit if label a is column `chosen[a]`."""
    out = 0.0
    so_far = np.full(len(chosen), -1, np.intp)
    for a in range(len(chosen)):
        if chosen[a] >= 0:
            out += fit_of(a, chosen[a], so_far, seen, known, twin, scale, weights)
            so_far[a] = chosen[a]
    return out


@compiled_with()
def quality_of(chosen: IndexArray, gain: FloatArray, seen: FloatArray, known: FloatArray, twin: IndexArray,
               scale: float, weights: FloatArray) -> float:  # fmt: skip
    """`geometry_of`, and the network's gains (K, A)."""
    out = geometry_of(chosen, seen, known, twin, scale, weights)
    for a in range(len(chosen)):
        if chosen[a] >= 0:
            out += gain[chosen[a], a]
    return out
