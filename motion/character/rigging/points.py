"""Points of a body's surface, as a network takes them."""

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled

POINTS, TOKENS = 2048, 192


def surface_points(vertices: FloatArray, triangles: IntArray, count: int, rng: np.random.Generator) -> Float32Array:
    """(count, 6) points and unit normals, drawn by area.

    Args:
        vertices: (V, 3) metres.
        triangles: (F, 3), counter-clockwise seen from outside.
        count: of points.
        rng: draws them.
    """
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    chosen = rng.choice(len(triangles), count, p=size / size.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = a[chosen] + u * (b - a)[chosen] + v * (c - a)[chosen]
    return np.concatenate([points, normal[chosen] / size[chosen, None]], axis=1).astype(np.float32)


def upright_points(points: Float32Array) -> tuple[Float32Array, FloatArray, float]:
    """Points (N, 6) of a body that stands, of height 1 and on the floor; what was subtracted (3,), and the height.

    The first `TOKENS` are spread over the body, each the farthest from those before it.
    """
    low, high = points[:, 2].min(), points[:, 2].max()
    height = max(float(high - low), 1e-9)
    origin = np.array([0.0, float(np.median(points[:, 1])), float(low)])
    out = points.copy()
    out[:, :3] = (points[:, :3] - origin) / height
    first = _spread(np.ascontiguousarray(out[:, :3]), min(TOKENS, len(out)))
    rest = np.ones(len(out), bool)
    rest[first] = False
    return np.concatenate([out[first], out[rest]]), origin, height


@compiled
def _spread(points, count):  # type: ignore[no-untyped-def]
    chosen = np.zeros(count, np.int64)
    near = np.full(len(points), np.inf)
    at = 0
    for k in range(1, count):
        best = 0
        for n in range(len(points)):
            gap = 0.0
            for c in range(3):
                gap += (points[n, c] - points[at, c]) ** 2
            if gap < near[n]:
                near[n] = gap
            if near[n] > near[best]:
                best = n
        chosen[k] = best
        at = best
    return chosen
