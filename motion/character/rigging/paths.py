"""Ways through a volume: from its middle to the ends of its limbs, along the middle of each.

After Sato and others, TEASAR: tree-structure extraction algorithm for accurate and robust skeletons, Pacific Graphics
2000: the farthest cell gets a way to the root that keeps to thick parts, all that is near it counts as reached, and so
on with the cell that is farthest then.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import dijkstra

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.character.rigging.volume import Volume

_CENTRED = 1.5  # power of the radius that a step is divided by, so that ways keep to the middle
_REACHED = 1.6  # radii around a way that count as reached
_HALF_SLAB = 0.75  # cells on either side of a cross-section
_STEPS = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])


@dataclass(frozen=True, eq=False)
class Graph:
    """The cells of a volume as nodes, linked to their 26 neighbours.

    Attributes:
        volume: of the cells.
        cells: (N, 3).
        number: (X, Y, Z) node of each cell, -1 outside.
        lengths: (N, N) metres of links.
        centred: (N, N) the same, shorter where the volume is thick.
    """

    volume: Volume
    cells: IntArray
    number: IntArray
    lengths: csr_matrix
    centred: csr_matrix

    def node_near(self, point: FloatArray) -> int:
        """The node nearest to a point in metres."""
        return int(np.argmin(((self.volume.centres(self.cells) - point) ** 2).sum(axis=1)))


@dataclass(frozen=True, eq=False)
class Branch:
    """A way from an end of a body to its root.

    Attributes:
        points: (N, 3) metres, from the end on, about a cell apart, smoothed.
        free: metres from the end to where the way meets one that was found before.
        reach: metres from the root through the volume.
    """

    points: FloatArray
    free: float
    reach: float

    @property
    def along(self) -> FloatArray:
        """(N,) metres from the end."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])

    def at(self, distance: float) -> FloatArray:
        """(3,) the point that many metres from the end."""
        along = self.along
        return np.array([np.interp(distance, along, self.points[:, k]) for k in range(3)])


def build_graph(volume: Volume) -> Graph:
    """The links between the cells of a volume."""
    cells = np.argwhere(volume.inside)
    number = np.full(volume.inside.shape, -1, np.int64)
    number[tuple(cells.T)] = np.arange(len(cells))
    padded = np.pad(number, 1, constant_values=-1)
    radius = volume.radius[tuple(cells.T)]
    rows, columns, lengths = [], [], []
    for step in _STEPS:
        other = padded[tuple((cells + 1 + step).T)]
        linked = np.flatnonzero(other >= 0)
        rows.append(linked)
        columns.append(other[linked])
        lengths.append(np.full(len(linked), np.linalg.norm(step) * volume.cell))
    row, column, length = np.concatenate(rows), np.concatenate(columns), np.concatenate(lengths)
    middle = (radius[row] + radius[column]) / (2 * volume.cell)
    shape = (len(cells), len(cells))
    return Graph(volume, cells, number, coo_matrix((length, (row, column)), shape=shape).tocsr(),
                 coo_matrix((length / middle**_CENTRED, (row, column)), shape=shape).tocsr())  # fmt: skip


def find_branches(graph: Graph, root: int, least: float, most: int = 24) -> list[Branch]:
    """The ways from the ends of a volume to a root, the farthest first.

    Args:
        graph: of the volume.
        root: node.
        least: metres of its own that a branch needs.
        most: branches.
    """
    reach = dijkstra(graph.lengths, directed=False, indices=root)
    before = dijkstra(graph.centred, directed=False, indices=root, return_predecessors=True)[1]
    places = graph.volume.centres(graph.cells)
    radius = graph.volume.radius[tuple(graph.cells.T)]
    left: BoolArray = np.isfinite(reach)
    used = np.zeros(len(places), np.bool_)
    out: list[Branch] = []
    while left.any() and len(out) < most:
        end = int(np.argmax(np.where(left, reach, -1.0)))
        way = [end]
        while way[-1] != root and len(way) < len(places):
            way.append(int(before[way[-1]]))
        own = way[: next((k for k, n in enumerate(way) if used[n]), len(way))]
        free = float(np.linalg.norm(np.diff(places[own], axis=0), axis=1).sum())
        _reach_cells(graph, own, radius, left, used)
        left[end] = False
        if free >= least:
            out.append(Branch(_smoothed(places[way]), free, float(reach[end])))
    return out


def _reach_cells(graph: Graph, way: list[int], radius: FloatArray, left: BoolArray, used: BoolArray) -> None:
    """Mark what lies within a few radii of a way as reached, and its inner part as used by later ways."""
    cell = graph.volume.cell
    near = np.full(graph.volume.inside.shape, False)
    inner = near.copy()
    for n in way:
        for marked, size in ((near, _REACHED * radius[n] + 2 * cell), (inner, 0.7 * radius[n])):
            c, k = graph.cells[n], int(size / cell)
            low, high = np.maximum(c - k, 0), np.minimum(c + k + 1, near.shape)
            box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
            grid = np.ogrid[box]
            marked[box] |= sum((g - m) ** 2 for g, m in zip(grid, c, strict=True)) <= (size / cell) ** 2
    left &= ~near[tuple(graph.cells.T)]
    used |= inner[tuple(graph.cells.T)]


def _smoothed(points: FloatArray, sigma: float = 2.0) -> FloatArray:
    out = ndimage.gaussian_filter1d(points, sigma, axis=0, mode="nearest")
    out[0] = points[0]
    return np.asarray(out)


def section(volume: Volume, at: FloatArray, direction: FloatArray, reach: float) -> tuple[float, FloatArray]:
    """Area in square metres and centre of the part of a cross-section that holds a point.

    Args:
        volume: cut.
        at: (3,) metres.
        direction: (3,) unit normal of the cut.
        reach: metres from the point at most.
    """
    place = (at - volume.origin) / volume.cell
    count, total = _section(volume.inside, place, direction, reach / volume.cell)
    if not count:
        return 0.0, at
    return count * volume.cell**2 / (2 * _HALF_SLAB), volume.origin + total / count * volume.cell


@compiled
def _section(
    inside: BoolArray, at: FloatArray, direction: FloatArray, reach: float
) -> tuple[int, FloatArray]:  # pragma: no cover
    """Cells of the slab around a plane that hang together with the one nearest to a point: how many, and their sum."""
    k = int(np.ceil(reach))
    low = np.zeros(3, np.int64)
    size = np.zeros(3, np.int64)
    for a in range(3):
        low[a] = max(int(np.round(at[a])) - k, 0)
        size[a] = max(min(int(np.round(at[a])) + k + 1, inside.shape[a]) - low[a], 1)
    open_ = np.zeros((size[0], size[1], size[2]), np.bool_)
    best, start = np.inf, np.zeros(3, np.int64)
    for x in range(size[0]):
        for y in range(size[1]):
            for z in range(size[2]):
                if not inside[x + low[0], y + low[1], z + low[2]]:
                    continue
                dx, dy, dz = x + low[0] - at[0], y + low[1] - at[1], z + low[2] - at[2]
                away = dx * dx + dy * dy + dz * dz
                if away > reach * reach or abs(dx * direction[0] + dy * direction[1] + dz * direction[2]) > _HALF_SLAB:
                    continue
                open_[x, y, z] = True
                if away < best:
                    best = away
                    start[0], start[1], start[2] = x, y, z
    count, total = 0, np.zeros(3)
    if best == np.inf:
        return count, total
    waiting = np.empty((size[0] * size[1] * size[2], 3), np.int64)
    waiting[0], last = start, 1
    open_[start[0], start[1], start[2]] = False
    while count < last:
        c = waiting[count]
        count += 1
        for a in range(3):
            total[a] += c[a] + low[a]
        for x in range(max(c[0] - 1, 0), min(c[0] + 2, size[0])):
            for y in range(max(c[1] - 1, 0), min(c[1] + 2, size[1])):
                for z in range(max(c[2] - 1, 0), min(c[2] + 2, size[2])):
                    if open_[x, y, z]:
                        open_[x, y, z] = False
                        waiting[last, 0], waiting[last, 1], waiting[last, 2] = x, y, z
                        last += 1
    return count, total
