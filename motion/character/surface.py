"""The surface of a mesh as one thing: coincident vertices joined, islands, normals and the Laplacian.

Files split a vertex wherever its normal or its texture coordinate changes, so that neighbours across a seam share no
vertex. What diffuses over a surface needs them joined again.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from muybridge.arrays import BoolArray, FloatArray, IndexArray, IntArray

_WELD = 1e-5  # of the mesh's diagonal: vertices nearer than that are one point
_CELL_BITS = 18  # which hold a diagonal's cells
_SAME_MARK = 1e-4  # marks that differ by less are one
_LEAST_SINE = 1e-3  # angles of triangles are held at least so far from 0 and 180 degrees


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of which coincident vertices are one.

    Attributes:
        points: (P, 3) metres.
        triangles: (F, 3) points; those of no area in the mesh are left out.
        point_of: (V,) the point that each vertex of the mesh became.
    """

    points: FloatArray
    triangles: IntArray
    point_of: IndexArray

    @cached_property
    def normals(self) -> FloatArray:
        """(P, 3) unit normals, of the triangles around each point by their area; zero where there are none."""
        return vertex_normals(self.points, self.triangles)

    @cached_property
    def size(self) -> float:
        """Metres, the diagonal of the box around all points."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    @cached_property
    def edges(self) -> IntArray:
        """(E, 2) pairs of neighbours, each once, the smaller point first."""
        return np.asarray(np.unique(np.sort(self.sides, axis=1), axis=0), dtype=np.int64)

    @cached_property
    def sides(self) -> IntArray:
        """(3 F, 2) the directed sides of the triangles."""
        t = self.triangles
        return np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])

    @cached_property
    def border(self) -> BoolArray:
        """(P,) whether a point is on an edge of a single triangle."""
        pairs, counts = np.unique(np.sort(self.sides, axis=1), axis=0, return_counts=True)
        out = np.zeros(len(self.points), bool)
        out[pairs[counts == 1].ravel()] = True
        return out

    @cached_property
    def islands(self) -> IndexArray:
        """(P,) the number of the connected part that a point belongs to, from 0."""
        return connected_parts(self.triangles, len(self.points))

    @cached_property
    def areas(self) -> FloatArray:
        """(P,) square metres, a third of the triangles around each point."""
        third = np.linalg.norm(_area_vectors(self.points, self.triangles), axis=1) / 6
        return np.asarray(np.bincount(self.triangles.ravel(), np.repeat(third, 3), len(self.points)), np.float64)

    def outward(self) -> "Surface":
        """The same with the triangles of inside-out islands turned; whether an island is, its signed volume tells."""
        t = self.triangles
        island = self.islands[t[:, 0]]
        count = np.maximum(np.bincount(self.islands), 1)
        middle = np.stack([np.bincount(self.islands, self.points[:, k]) / count for k in range(3)], axis=1)
        a, b, c = (self.points[t[:, k]] - middle[island] for k in range(3))
        volume = np.bincount(island, np.sum(np.cross(a, b) * c, axis=1), len(count))
        turned = t.copy()
        turned[volume[island] < 0] = turned[volume[island] < 0][:, [0, 2, 1]]
        return Surface(self.points, turned, self.point_of)

    def coarser(self, most: int) -> "Surface":
        """A surface of at most about so many points; its `point_of` (P,) tells where each of this one went.

        Points of one cell of a grid become one where their normals look the same way, so that sheets stay apart.
        """
        sides = (self.normals > 0) @ np.array([1, 2, 4])
        cell = self.size / np.sqrt(most)
        while True:
            keys = np.column_stack([np.floor(self.points / cell).astype(np.int64), sides])
            _, first, place = np.unique(keys, axis=0, return_index=True, return_inverse=True)
            if len(first) <= most:
                break
            cell *= 1.2
        count, place = np.bincount(place.ravel()), place.ravel()
        points = np.stack([np.bincount(place, self.points[:, k]) / count for k in range(3)], axis=1)
        return Surface(points, _proper(place[self.triangles]), place)

    def laplacian(self) -> sparse.csc_matrix:
        """(P, P) the cotangent Laplacian, positive semi-definite; row sums are zero.

        Cotangents of slivers are bounded, and negative sums at an edge are raised to zero, so that what diffuses stays
        between the values that it starts from.

        Source: Pinkall and Polthier, Computing discrete minimal surfaces and their conjugates, 1993.
        """
        count, t = len(self.points), self.triangles
        rows, columns, values = [], [], []
        for k in range(3):
            corner, a, b = (self.points[t[:, (k + i) % 3]] for i in range(3))
            u, v = a - corner, b - corner
            lengths = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
            sine = np.linalg.norm(np.cross(u, v), axis=1) / np.maximum(lengths, 1e-300)
            cosine = np.sum(u * v, axis=1) / np.maximum(lengths, 1e-300)
            rows.append(t[:, (k + 1) % 3])
            columns.append(t[:, (k + 2) % 3])
            values.append(0.5 * cosine / np.maximum(sine, _LEAST_SINE))
        one_way = sparse.coo_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)
        )
        weights = (one_way + one_way.T).tocsr()
        weights.data = np.maximum(weights.data, 0.0)
        return (sparse.diags(np.asarray(weights.sum(axis=1)).ravel()) - weights).tocsc()


def weld(positions: FloatArray, marks: FloatArray | None = None) -> tuple[IndexArray, IndexArray]:
    """Coincident vertices as one point.

    Args:
        positions: (V, 3) metres.
        marks: (V,) from 0 to 1; vertices of different marks stay apart wherever they are.

    Returns:
        (P,) a vertex of each point, and (V,) the point of each vertex.
    """
    if not len(positions):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    low = positions.min(axis=0)
    step = max(_WELD * float(np.linalg.norm(np.ptp(positions, axis=0))), 1e-12)
    x, y, z = np.round((positions - low) / step).astype(np.int64).T
    key = (x << 2 * _CELL_BITS) | (y << _CELL_BITS) | z
    if marks is not None:
        place = np.unique(key, return_inverse=True)[1].ravel()
        mark = np.round(marks / _SAME_MARK).astype(np.int64)
        key = place * (int(mark.max()) + 1) + mark
    _, first, point_of = np.unique(key, return_index=True, return_inverse=True)
    return first, point_of.ravel()


def join_vertices(positions: FloatArray, triangles: IntArray, marks: FloatArray | None = None) -> Surface:
    """The surface of a mesh.

    Args:
        positions: (V, 3) metres.
        triangles: (F, 3) vertices.
        marks: (V,) from 0 to 1; vertices of different marks stay apart wherever they are.
    """
    first, point_of = weld(positions, marks)
    joined = point_of[triangles].reshape(-1, 3)
    return Surface(np.asarray(positions[first], np.float64), _proper(joined), point_of)


def connected_parts(triangles: IntArray, count: int) -> IndexArray:
    """(count,) the number of the connected part that a point belongs to, from 0, by triangles (F, 3) of points."""
    a, b = triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel()
    links = sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], np.intp)


def _proper(triangles: IntArray) -> IntArray:
    """The triangles with three different corners."""
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (c != a)], np.int64)


def _area_vectors(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(F, 3) normals of the triangles, as long as twice their areas."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray(np.cross(b - a, c - a))


def vertex_normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(P, 3) unit normals, from the triangles around each point by their area; zero where there are none."""
    area = _area_vectors(points, triangles)
    out = np.stack([np.bincount(triangles.ravel(), np.repeat(area[:, k], 3), len(points)) for k in range(3)], axis=1)
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-12))
