"""Delta mush: the linearly blended surface is smoothed, and the detail that smoothing took at rest is put back.

Source: Mancewicz, Derksen, Rijpkema and Wilson, Delta mush: smoothing deformations while preserving detail, 2014.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.character.skinning.skin import Skin
from muybridge.motion.character.surface import Surface, join_vertices

# Smoothing goes as far as the folds of a joint, however fine the mesh is; farther, limbs lose their volume.
_REACH = 0.008  # of the size of the mesh
_MOST_STEPS = 60
_LEAST_STEPS = 4


@dataclass(frozen=True, eq=False)
class Mush:
    """The surface of a mesh, and how it is smoothed.

    Attributes:
        surface: of the mesh; vertices that are in one place but follow other joints stay apart.
        first: (P,) a vertex of each point.
        held: (P,) points that stay: those on a border, which may meet another part's, and those without triangle.
        starts: (P + 1,) where the neighbours of a point begin.
        neighbours: (N,) of the points, one after another.
        steps: of smoothing, each halfway to the mean of the neighbours.
    """

    surface: Surface
    first: IndexArray
    held: BoolArray
    starts: IntArray
    neighbours: IntArray
    steps: int

    def smooth(self, points: FloatArray) -> FloatArray:
        """(P, 3) points (P, 3) after all steps."""
        out = np.array(points, np.float32)
        _smooth(out, np.empty_like(out), self.starts, self.neighbours, self.held, self.steps)
        return out.astype(np.float64)

    def details(self, points: FloatArray) -> Float32Array:
        """(P, 3) what smoothing takes from points (P, 3), in the frames of the smoothed surface."""
        smoothed = self.smooth(points).astype(np.float32)
        frames = np.empty((len(points), 3, 3), np.float32)
        _frames(smoothed, self.surface.triangles, self.starts, self.neighbours, frames)
        return np.asarray(np.einsum("pkc,pk->pc", frames, points - smoothed), np.float32)

    def apply(self, blended: Float32Array, details: Float32Array) -> None:
        """Replace linearly blended vertices (T, V, 3) by the smoothed ones with details (P, 3)."""
        _apply(blended, self.first, self.surface.point_of, self.surface.triangles, self.starts, self.neighbours,
               self.held, self.steps, details)  # fmt: skip


def skin_surface(skin: Skin) -> tuple[Surface, IndexArray]:
    """The surface of a skin, and (P,) a vertex of each of its points; vertices of other weights stay apart."""
    # A random number for each joint tells vertices of different weights apart.
    marks = np.random.default_rng(0).random(len(skin.bind))
    surface = join_vertices(skin.positions, skin.triangles, np.sum(marks[skin.joints] * skin.weights, axis=1))
    first = np.zeros(len(surface.points), np.intp)
    first[surface.point_of[::-1]] = np.arange(len(surface.point_of))[::-1]
    return surface, first


def prepare_mush(skin: Skin) -> Mush:
    """What delta mush needs of a skin."""
    surface, first = skin_surface(skin)
    points = len(surface.points)
    a, b = surface.edges.T
    links = sparse.csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(points, points))
    held = surface.border | (np.diff(links.indptr) == 0)
    edge = float(np.median(np.linalg.norm(surface.points[a] - surface.points[b], axis=1))) if len(a) else 1.0
    # A step halfway to the neighbours is diffusion by half of an edge squared over two.
    steps = int(np.clip(round(2 * (_REACH * surface.size / max(edge, 1e-9)) ** 2), _LEAST_STEPS, _MOST_STEPS))
    return Mush(surface, first, held, links.indptr.astype(np.int64), links.indices.astype(np.int64), steps)


@compiled
def _smooth(points, other, starts, neighbours, held, steps):  # type: ignore[no-untyped-def]
    half = np.float32(0.5)
    for _ in range(steps):
        for p in range(len(points)):
            if held[p]:
                other[p] = points[p]
                continue
            x, y, z = np.float32(0), np.float32(0), np.float32(0)
            for n in range(starts[p], starts[p + 1]):
                q = neighbours[n]
                x += points[q, 0]
                y += points[q, 1]
                z += points[q, 2]
            share = half / np.float32(starts[p + 1] - starts[p])
            other[p, 0] = half * points[p, 0] + share * x
            other[p, 1] = half * points[p, 1] + share * y
            other[p, 2] = half * points[p, 2] + share * z
        points[:] = other


@compiled
def _frames(points, triangles, starts, neighbours, frames):  # type: ignore[no-untyped-def]
    """Rows of frames (P, 3, 3): columns are a tangent, a second one and the normal at each point."""
    normals = np.zeros_like(points)
    for f in range(len(triangles)):
        i, j, k = triangles[f]
        u, v = points[j] - points[i], points[k] - points[i]
        x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        for c in (i, j, k):
            normals[c, 0] += x
            normals[c, 1] += y
            normals[c, 2] += z
    for p in range(len(points)):
        n = normals[p]
        n = n / (np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) + np.float32(1e-30))
        t = np.zeros(3, np.float32)
        if starts[p + 1] > starts[p]:
            t = points[neighbours[starts[p]]] - points[p]
        t = t - n * (t[0] * n[0] + t[1] * n[1] + t[2] * n[2])
        t = t / (np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]) + np.float32(1e-30))
        frames[p, :, 0] = t
        frames[p, 0, 1] = n[1] * t[2] - n[2] * t[1]
        frames[p, 1, 1] = n[2] * t[0] - n[0] * t[2]
        frames[p, 2, 1] = n[0] * t[1] - n[1] * t[0]
        frames[p, :, 2] = n


@compiled
def _apply(blended, first, point_of, triangles, starts, neighbours, held, steps, details):  # type: ignore[no-untyped-def]
    count = len(first)
    points, other = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    frames = np.empty((count, 3, 3), np.float32)
    for t in range(len(blended)):
        for p in range(count):
            points[p] = blended[t, first[p]]
        _smooth(points, other, starts, neighbours, held, steps)
        _frames(points, triangles, starts, neighbours, frames)
        for v in range(len(point_of)):
            p = point_of[v]
            if not held[p]:
                for c in range(3):
                    blended[t, v, c] = points[p, c] + (
                        frames[p, c, 0] * details[p, 0]
                        + frames[p, c, 1] * details[p, 1]
                        + frames[p, c, 2] * details[p, 2]
                    )
