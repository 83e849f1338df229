"""The volume that a surface occupies, where it runs into itself counted once, by rays along y."""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled

_MOST = 24  # crossings of one ray


def occupied(vertices: FloatArray, triangles: IntArray, step: float = 0.002) -> float:
    """Cubic metres that lie inside of a closed surface at least once, by rays `step` metres apart."""
    points = vertices.astype(np.float64)
    low, high = points.min(axis=0) - 0.6 * step, points.max(axis=0)
    shape = (int((high[0] - low[0]) / step) + 2, int((high[2] - low[2]) / step) + 2)
    count = np.zeros(shape, np.int64)
    places, signs = np.zeros((*shape, _MOST)), np.zeros((*shape, _MOST), np.int64)
    _meet(points, triangles, step, low, count, places, signs)
    return float(_inside(count, places, signs)) * step * step


@compiled
def _meet(points, triangles, step, low, count, places, signs):  # type: ignore[no-untyped-def]
    for f in range(len(triangles)):
        a, b, c = points[triangles[f, 0]], points[triangles[f, 1]], points[triangles[f, 2]]
        turn = (b[0] - a[0]) * (c[2] - a[2]) - (c[0] - a[0]) * (b[2] - a[2])
        if abs(turn) < 1e-14:
            continue
        first = int(np.ceil((min(a[0], b[0], c[0]) - low[0]) / step))
        last = int(np.floor((max(a[0], b[0], c[0]) - low[0]) / step))
        bottom = int(np.ceil((min(a[2], b[2], c[2]) - low[2]) / step))
        top = int(np.floor((max(a[2], b[2], c[2]) - low[2]) / step))
        for i in range(first, last + 1):
            for k in range(bottom, top + 1):
                x, z = low[0] + i * step - a[0], low[2] + k * step - a[2]
                u = (x * (c[2] - a[2]) - (c[0] - a[0]) * z) / turn
                v = ((b[0] - a[0]) * z - x * (b[2] - a[2])) / turn
                n = count[i, k]
                if u >= 0 and v >= 0 and u + v <= 1 and n < len(places[i, k]):
                    places[i, k, n] = a[1] + u * (b[1] - a[1]) + v * (c[1] - a[1])
                    signs[i, k, n] = 1 if turn > 0 else -1
                    count[i, k] = n + 1


@compiled
def _inside(count, places, signs):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(count.shape[0]):
        for k in range(count.shape[1]):
            n = count[i, k]
            order, winding = np.argsort(places[i, k, :n]), 0
            for m in range(n - 1):
                winding += signs[i, k, order[m]]
                if winding >= 1:
                    total += places[i, k, order[m + 1]] - places[i, k, order[m]]
    return total
