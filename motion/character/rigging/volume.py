"""The inside of a surface on a grid, of meshes with holes, islands and parts within one another.

A cell is inside where the winding number of its centre is above a half, or where no way leads from it to the outside.
The winding number is the mean of what the six rays along the axes count (Jacobson, Kavan and Sorkine-Hornung, Robust
inside-outside segmentation using generalized winding numbers, SIGGRAPH 2013, with six samples of the sphere): a hole
that one ray leaves by is outvoted by the others. Sheets thinner than a cell are kept as a layer of cells.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled

_PAD = 2  # empty cells around the surface
_OFFSET = (0.4142, 0.2361, 0.3028)  # of a cell: centres that lie on no edge of a regular mesh
_FACES = ndimage.generate_binary_structure(3, 1)
_ALL = ndimage.generate_binary_structure(3, 3)
_SMALLEST = 8  # cells of a part; smaller ones are dropped
_FARTHEST_GAP = 0.04  # of the longest extent, between parts that belong to one body
_OF_ITS_OWN = 0.35  # of the largest part: a part as large as that, at a distance, is a body of its own


@dataclass(frozen=True, eq=False)
class Volume:
    """Cells of a body.

    Attributes:
        inside: (X, Y, Z) whether a cell is in it; all such cells hang together.
        radius: (X, Y, Z) metres from a cell to the outside; zero there.
        origin: (3,) metres, the centre of cell (0, 0, 0).
        cell: metres.
        bodies: how many bodies the surface shows; the volume is that of the largest.
    """

    inside: BoolArray
    radius: FloatArray
    origin: FloatArray
    cell: float
    bodies: int = 1

    def centres(self, cells: IntArray) -> FloatArray:
        """(..., 3) metres of cells (..., 3)."""
        return np.asarray(self.origin + cells * self.cell)

    def moved(self, shift: FloatArray) -> "Volume":
        """The volume moved by (3,) metres."""
        return replace(self, origin=self.origin + shift)

    def cell_of(self, points: FloatArray) -> IntArray:
        """(..., 3) the cells of points (..., 3) metres, the nearest ones for points off the grid."""
        at = np.round((points - self.origin) / self.cell).astype(np.int64)
        return np.clip(at, 0, np.array(self.inside.shape) - 1)


def fill_volume(vertices: FloatArray, triangles: IntArray, cells: int) -> Volume:
    """The volume that a surface encloses.

    Args:
        vertices: (V, 3) metres.
        triangles: (F, 3), outwards island by island.
        cells: along the longest extent.
    """
    used = vertices[np.unique(triangles)]
    low, extent = used.min(axis=0), np.ptp(used, axis=0)
    cell = float(extent.max()) / cells
    shape = np.ceil(extent / cell).astype(np.int64) + 2 * _PAD + 1
    origin = low - _PAD * cell + np.array(_OFFSET) * cell
    at = (vertices - origin) / cell
    surface = np.zeros(tuple(shape), np.bool_)
    _rasterise(at, triangles, surface)
    winding = np.zeros(tuple(shape), np.float32)
    for axis in range(3):
        order = [axis, (axis + 1) % 3, (axis + 2) % 3]
        counts = np.zeros(tuple(shape[order]), np.int16)
        _cross(np.ascontiguousarray(at[:, order]), triangles, counts)
        along = np.cumsum(counts, axis=0, dtype=np.int16).astype(np.float32)
        along -= along[-1:] / 2
        winding += np.transpose(np.clip(along, -1.0, 1.0), np.argsort(order)) / 3  # no axis decides alone
    outside = ndimage.label(~surface, _FACES)[0]
    inside = (winding > 0.5) | (~surface & (outside != outside[0, 0, 0]))
    inside |= surface & ~ndimage.binary_dilation(inside, _ALL)
    inside, bodies = _joined(inside, _FARTHEST_GAP * cells)
    radius = ndimage.distance_transform_edt(inside).astype(np.float64) * cell
    return Volume(inside, radius, origin, cell, bodies)


def _joined(inside: BoolArray, farthest: float) -> tuple[BoolArray, int]:
    """The largest part with what lies near it, bridged, and the number of bodies; specks and far parts are left out."""
    label, count = ndimage.label(inside, _ALL)
    if count <= 1:
        return inside, count
    sizes = np.bincount(label.ravel())
    sizes[0] = 0
    keep = [int(k) for k in np.argsort(-sizes) if sizes[k] >= _SMALLEST] or [int(np.argmax(sizes))]
    out = label == keep[0]
    waiting, bodies = keep[1:], 1
    while waiting:
        away, nearest = ndimage.distance_transform_edt(~out, return_indices=True)
        gaps = dict(zip(waiting, ndimage.minimum(away, label, waiting), strict=True))
        alone = {k for k in waiting if sizes[k] > _OF_ITS_OWN * sizes[keep[0]] and gaps[k] > 2.5}
        linked = [k for k in waiting if k not in alone and gaps[k] <= farthest]
        if not linked:
            bodies += len(alone)
            break
        least = max(2.0, min(gaps[k] for k in linked))
        for k in (k for k in linked if gaps[k] <= least):
            start = np.array(ndimage.minimum_position(away, label, k))
            stop = nearest[(slice(None), *start)]
            steps = int(np.abs(stop - start).max()) + 1
            line = np.round(np.linspace(start, stop, steps + 1)).astype(int)
            out[tuple(line.T)] = True
            out |= label == k
            waiting.remove(k)
    return out, bodies


@compiled
def _rasterise(at: FloatArray, triangles: IntArray, out: BoolArray) -> None:  # pragma: no cover
    """Mark the cells that triangles pass, by samples less than half a cell apart."""
    for f in range(len(triangles)):
        a, b, c = at[triangles[f, 0]], at[triangles[f, 1]], at[triangles[f, 2]]
        long = max(np.abs(b - a).max(), np.abs(c - a).max(), np.abs(c - b).max())
        n = int(long * 2.5) + 1
        for i in range(n + 1):
            for k in range(n + 1 - i):
                p = a + (b - a) * (i / n) + (c - a) * (k / n)
                x, y, z = int(np.floor(p[0] + 0.5)), int(np.floor(p[1] + 0.5)), int(np.floor(p[2] + 0.5))
                out[x, y, z] = True


@compiled
def _cross(at: FloatArray, triangles: IntArray, counts: IntArray) -> None:  # pragma: no cover
    """Add to each column's cell behind a face +1 where a ray along the first axis enters, -1 where it leaves."""
    for f in range(len(triangles)):
        a, b, c = at[triangles[f, 0]], at[triangles[f, 1]], at[triangles[f, 2]]
        area = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
        if area == 0.0:
            continue
        y0 = int(np.ceil(min(a[1], b[1], c[1])))
        y1 = int(np.floor(max(a[1], b[1], c[1])))
        z0 = int(np.ceil(min(a[2], b[2], c[2])))
        z1 = int(np.floor(max(a[2], b[2], c[2])))
        sign = -1 if area > 0 else 1
        for y in range(y0, y1 + 1):
            for z in range(z0, z1 + 1):
                u = ((b[1] - y) * (c[2] - z) - (b[2] - z) * (c[1] - y)) / area
                v = ((c[1] - y) * (a[2] - z) - (c[2] - z) * (a[1] - y)) / area
                w = 1.0 - u - v
                if u >= 0.0 and v >= 0.0 and w >= 0.0:
                    x = int(np.ceil(u * a[0] + v * b[0] + w * c[0]))
                    counts[x, y, z] += sign
