"""The compiled part of distances between capsules."""

import math

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled


@compiled
def nearest(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> tuple[float, float]:
    """Where the segments a-b and c-d are nearest to each other: 0 at a and c, 1 at b and d.

    Source: Ericson, Real-Time Collision Detection, section 5.1.9.
    """
    uu = vv = uv = uw = vw = 0.0
    for i in range(3):
        u, v, w = b[i] - a[i], d[i] - c[i], a[i] - c[i]
        uu += u * u
        vv += v * v
        uv += u * v
        uw += u * w
        vw += v * w
    tiny = 1e-14
    if uu <= tiny and vv <= tiny:
        return 0.0, 0.0
    if uu <= tiny:
        return 0.0, min(max(vw / vv, 0.0), 1.0)
    if vv <= tiny:
        return min(max(-uw / uu, 0.0), 1.0), 0.0
    scale = uu * vv - uv * uv
    s = min(max((uv * vw - uw * vv) / scale, 0.0), 1.0) if scale > 1e-12 * uu * vv else 0.5
    t = (uv * s + vw) / vv
    if t < 0.0:
        t = 0.0
        s = min(max(-uw / uu, 0.0), 1.0)
    elif t > 1.0:
        t = 1.0
        s = min(max((uv - uw) / uu, 0.0), 1.0)
    return s, t


@compiled
def segment_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> float:
    """Metres between the segments a-b and c-d."""
    s, t = nearest(a, b, c, d)
    total = 0.0
    for i in range(3):
        gap = a[i] + s * (b[i] - a[i]) - c[i] - t * (d[i] - c[i])
        total += gap * gap
    return math.sqrt(total)


@compiled
def all_distances(start: FloatArray, stop: FloatArray, radius: FloatArray, pairs: IndexArray, out: FloatArray) -> None:
    """`out` (T, K): metres between the surfaces of capsules (T, C, 3) that are paired."""
    for t in range(len(start)):
        for k in range(len(pairs)):
            i, j = pairs[k, 0], pairs[k, 1]
            gap = segment_distance(start[t, i], stop[t, i], start[t, j], stop[t, j])
            out[t, k] = gap - radius[i] - radius[j]


def surface_distances(start: FloatArray, stop: FloatArray, radius: FloatArray, pairs: IndexArray) -> FloatArray:
    """(T, K) metres between the surfaces of paired capsules; negative where they are inside each other."""
    out = np.empty((len(start), len(pairs)))
    all_distances(start, stop, radius, pairs, out)
    return out
