"""A surface made usable for the embedding: vertices welded, degenerate faces dropped, faces turned outwards.

The mesh that is written keeps its own vertices; only its faces are turned where the whole of it is inside out.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.surface import connected_parts, weld

_CLOSED = 0.05  # volume of an island, as a share of its box, below which its orientation says nothing


@dataclass(frozen=True, eq=False)
class Repaired:
    """A welded surface.

    Attributes:
        vertices: (V, 3) metres.
        triangles: (F, 3) counter-clockwise seen from outside, island by island.
        island: (F,) number of the connected part that a face belongs to.
        source: (N,) the welded vertex of each of the given ones, -1 where no face uses it.
        inside_out: whether most of the given surface faces inwards.
        dropped: faces without area.
    """

    vertices: FloatArray
    triangles: IntArray
    island: IntArray
    source: IntArray
    inside_out: bool
    dropped: int


def repair(vertices: FloatArray, triangles: IntArray) -> Repaired:
    """Weld and orient a surface.

    Args:
        vertices: (N, 3) metres.
        triangles: (F, 3).
    """
    first, point_of = weld(vertices)
    faces = point_of[triangles].astype(np.int64)
    a, b, c = faces.T
    flat = (a == b) | (b == c) | (a == c)
    faces, points = _once(faces[~flat]), vertices[first]
    island = _islands(faces, len(points))
    inwards, total = _facing_inwards(points, faces, island)
    faces[inwards[island]] = faces[inwards[island]][:, ::-1]
    return Repaired(points, faces, island, point_of.astype(np.int64), bool(total < 0), int(flat.sum()))


def _once(faces: IntArray) -> IntArray:
    """The faces without those on the corners of an earlier one, as two-sided meshes have them: they enclose nothing."""
    a, b, c = np.sort(faces, axis=1).T
    count = int(c.max(initial=0)) + 1
    side = np.unique(a * count + b, return_inverse=True)[1].ravel()
    return faces[np.sort(np.unique(side * count + c, return_index=True)[1])]


def _islands(faces: IntArray, count: int) -> IntArray:
    """(F,) the connected part of each face."""
    if not len(faces):
        return np.zeros(0, np.int64)
    label = connected_parts(faces, count)
    return np.unique(label[faces[:, 0]], return_inverse=True)[1].reshape(-1).astype(np.int64)


def _facing_inwards(points: FloatArray, faces: IntArray, island: IntArray) -> tuple[np.ndarray, float]:
    """(I,) islands that enclose a negative volume, and the volume of all as given."""
    count = int(island.max(initial=-1)) + 1
    a, b, c = (points[faces[:, k]] for k in range(3))
    centre = np.zeros((count, 3))
    share = np.bincount(island, minlength=count)
    for k in range(3):
        centre[:, k] = np.bincount(island, (a + b + c)[:, k] / 3, count) / np.maximum(share, 1)
    o = centre[island]
    volume = np.bincount(island, np.einsum("ij,ij->i", a - o, np.cross(b - o, c - o)) / 6, count)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    for corner in (a, b, c):
        np.minimum.at(low, island, corner)
        np.maximum.at(high, island, corner)
    box = np.prod(np.maximum(high - low, 1e-9), axis=1)
    return volume < -_CLOSED * box, float(volume.sum())
