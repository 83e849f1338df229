"""How much of a straight way through a mesh is outside of it: segments against triangles in a uniform grid.

A way goes outside where it crosses a triangle from the back to the front, and comes back where it crosses one from the
front to the back. The way from a button or a strap through the skin below it is inside all along.

Sources: Amanatides and Woo, A fast voxel traversal algorithm for ray tracing, 1987; Moeller and Trumbore, Fast, minimum
storage ray/triangle intersection, 1997.
"""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled

_CELLS_PER_TRIANGLE = 8.0
_MOST_CELLS = 200  # along an axis


class RayGrid:
    """The triangles of a mesh, by the cells of a grid that they touch.

    Args:
        points: (P, 3) metres.
        triangles: (F, 3) points, counter-clockwise seen from outside.
    """

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        corners = points[triangles]
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(high - low, 1e-9)
        margin = 1e-4 * size.max()
        low, size = low - margin, size + 2 * margin
        edge = (size.prod() / max(_CELLS_PER_TRIANGLE * len(triangles), 1.0)) ** (1 / 3)
        self.counts = np.clip(np.ceil(size / edge), 1, _MOST_CELLS).astype(np.int64)
        self.low, self.cell = low, size / self.counts
        first = np.clip(((corners.min(axis=1) - low) / self.cell).astype(np.int64), 0, self.counts - 1)
        last = np.clip(((corners.max(axis=1) - low) / self.cell).astype(np.int64), 0, self.counts - 1)
        self.starts, self.members = _fill(first, last, self.counts)
        self.corners = np.ascontiguousarray(corners.reshape(-1, 9))

    def outside(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """(N,) share of the ways from points in the mesh that is outside; begin and end (N, 3) metres."""
        return np.asarray(
            _trace(np.ascontiguousarray(begin), np.ascontiguousarray(end), self.corners, self.starts, self.members,
                     self.low, self.cell, self.counts, False)[0]
        )  # fmt: skip

    def exits(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """(N,) share of the ways from begin to end (N, 3) where they first leave a solid; inf where they do not."""
        return np.asarray(
            _trace(np.ascontiguousarray(begin), np.ascontiguousarray(end), self.corners, self.starts, self.members,
                   self.low, self.cell, self.counts, True)[1]
        )  # fmt: skip


@compiled
def _fill(first, last, counts):  # type: ignore[no-untyped-def]
    """Members of the cells, one cell after another, and where each begins."""
    total = counts[0] * counts[1] * counts[2]
    starts = np.zeros(total + 1, np.int64)
    for f in range(len(first)):
        for i in range(first[f, 0], last[f, 0] + 1):
            for j in range(first[f, 1], last[f, 1] + 1):
                for k in range(first[f, 2], last[f, 2] + 1):
                    starts[(i * counts[1] + j) * counts[2] + k + 1] += 1
    for c in range(total):
        starts[c + 1] += starts[c]
    members = np.empty(starts[total], np.int64)
    place = starts[:-1].copy()
    for f in range(len(first)):
        for i in range(first[f, 0], last[f, 0] + 1):
            for j in range(first[f, 1], last[f, 1] + 1):
                for k in range(first[f, 2], last[f, 2] + 1):
                    c = (i * counts[1] + j) * counts[2] + k
                    members[place[c]] = f
                    place[c] += 1
    return starts, members


@compiled
def _crossing(ox, oy, oz, dx, dy, dz, c):  # type: ignore[no-untyped-def]
    """Where o + t d crosses a triangle c (9): t and 1 where it leaves, -1 where it enters, 0 where it does neither."""
    e1x, e1y, e1z = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    e2x, e2y, e2z = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    px, py, pz = dy * e2z - dz * e2y, dz * e2x - dx * e2z, dx * e2y - dy * e2x
    det = e1x * px + e1y * py + e1z * pz
    if det == 0.0:
        return 0.0, 0
    sx, sy, sz = ox - c[0], oy - c[1], oz - c[2]
    u = (sx * px + sy * py + sz * pz) / det
    if u < 0.0 or u > 1.0:
        return 0.0, 0
    qx, qy, qz = sy * e1z - sz * e1y, sz * e1x - sx * e1z, sx * e1y - sy * e1x
    v = (dx * qx + dy * qy + dz * qz) / det
    if v < 0.0 or u + v > 1.0:
        return 0.0, 0
    return (e2x * qx + e2y * qy + e2z * qz) / det, 1 if det < 0.0 else -1


@compiled
def _trace(begin, end, corners, starts, members, low, cell, counts, to_first):  # type: ignore[no-untyped-def]
    out, first = np.zeros(len(begin)), np.full(len(begin), np.inf)
    at, step = np.empty(3, np.int64), np.empty(3, np.int64)
    following, stride = np.empty(3), np.empty(3)
    for n in range(len(begin)):
        ox, oy, oz = begin[n, 0], begin[n, 1], begin[n, 2]
        dx, dy, dz = end[n, 0] - ox, end[n, 1] - oy, end[n, 2] - oz
        for k in range(3):
            o, d = begin[n, k], end[n, k] - begin[n, k]
            at[k] = min(max(int(np.floor((o - low[k]) / cell[k])), 0), counts[k] - 1)
            step[k] = 1 if d > 0 else -1
            following[k], stride[k] = np.inf, np.inf
            if abs(d) > 1e-15:
                edge = low[k] + (at[k] + (1 if d > 0 else 0)) * cell[k]
                following[k], stride[k] = (edge - o) / d, cell[k] / abs(d)
        since, total = 0.0, 0.0
        while since < 1.0:
            k = 0
            if following[1] < following[k]:
                k = 1
            if following[2] < following[k]:
                k = 2
            until = min(following[k], 1.0)
            c = (at[0] * counts[1] + at[1]) * counts[2] + at[2]
            for m in range(starts[c], starts[c + 1]):
                f = members[m]
                t, way = _crossing(ox, oy, oz, dx, dy, dz, corners[f])
                # A triangle is in several cells; it counts in the one where it is crossed.
                if way != 0 and since < t <= until:
                    total += way * (1.0 - t)
                    if way > 0 and t < first[n]:
                        first[n] = t
            if to_first and first[n] <= until:
                break
            since = until
            at[k] += step[k]
            following[k] += stride[k]
            if at[k] < 0 or at[k] >= counts[k]:
                break
        out[n] = max(total, 0.0)
    return out, first
