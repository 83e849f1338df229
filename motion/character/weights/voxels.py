"""Weights by distances through the inside of a mesh, for surfaces in pieces: soups of triangles, holes, open cloth.

Source: Dionne and de Lasa, Geodesic voxel binding for production character meshes, 2013: the mesh becomes solid voxels,
each bone's distance runs through them, and weights fall with it as 1 / ((1 - a) d + a d^2)^2.
"""

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.motion.character.surface import Surface
from muybridge.motion.character.weights.bones import Bones

_CELLS = 56  # along the longest side
_FALLOFF = 0.7  # a of the paper
_NEAR = 1.6  # times the nearest bone's distance, at which others have no weight any more
_SIDES = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if (i, j, k) > (0, 0, 0)]


def voxel_weights(surface: Surface, bones: Bones) -> FloatArray:
    """(P, J) weights of a surface's points, each row's sum one."""
    distance = voxel_distance(surface, bones)
    cell = _cell(surface)
    least = distance.min(axis=1, keepdims=True)
    weights = ((1 - _FALLOFF) * distance / cell + _FALLOFF * (distance / cell) ** 2) ** -2.0
    weights *= np.clip((_NEAR - distance / least) / (_NEAR - 1), 0.0, 1.0) ** 2
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def voxel_distance(surface: Surface, bones: Bones) -> FloatArray:
    """(P, J) metres through the inside of the mesh from points to joints' bones, at least half a voxel; inf: no way."""
    points = surface.points
    low, cell = points.min(axis=0), _cell(surface)
    solid = _solid(surface, low, cell)
    cells = np.argwhere(solid)
    number = np.full(solid.shape, -1, np.int64)
    number[solid] = np.arange(len(cells))
    tree = cKDTree(cells)
    # Each bone is one more node of the graph, beside the voxels that it runs through.
    distance = np.full((len(points), bones.count), np.inf)
    at = tree.query((points - low) / cell + 1.0)[1]
    used = np.unique(bones.joint)
    graph = _graph(number, cell, [_along(bones, j, low, cell, tree) for j in used], len(cells))
    found = dijkstra(graph, indices=len(cells) + np.arange(len(used)))
    distance[:, used] = found[:, at].T
    lost = ~np.isfinite(distance).any(axis=1)
    if lost.any():  # pieces that hang on nothing
        straight = bones.distance(points[lost])
        for s, j in enumerate(bones.joint):
            distance[lost, j] = np.minimum(distance[lost, j], straight[:, s])
    return np.asarray(np.maximum(distance, 0.5 * cell))


def _cell(surface: Surface) -> float:
    """Metres."""
    return max(float(np.ptp(surface.points, axis=0).max()) / _CELLS, 1e-9)


def _solid(surface: Surface, low: FloatArray, cell: float) -> BoolArray:
    """Voxels that the surface touches or that no way from outside reaches, with a margin of one."""
    corners = surface.points[surface.triangles]
    long = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(np.ceil(2 * long / cell).astype(int), 1)
    shape = tuple(np.ceil(np.ptp(surface.points, axis=0) / cell).astype(int) + 3)
    shell = np.zeros(shape, bool)
    for n in np.unique(steps):
        u, v = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T / n
        some = corners[steps == n]
        samples = (
            some[:, None, 0] * (1 - u - v)[:, None] + some[:, None, 1] * u[:, None] + some[:, None, 2] * v[:, None]
        )
        shell[tuple(np.round((samples.reshape(-1, 3) - low) / cell + 1.0).astype(int).T)] = True
    shell[tuple(np.round((surface.points - low) / cell + 1.0).astype(int).T)] = True
    parts, _ = ndimage.label(~shell)
    return np.asarray(parts != parts[0, 0, 0])


def _along(bones: Bones, joint: int, low: FloatArray, cell: float, tree: cKDTree) -> IntArray:
    """Numbers of the voxels that the segments of a joint run through."""
    places = []
    for s in np.nonzero(bones.joint == joint)[0]:
        steps = max(int(np.ceil(2 * np.linalg.norm(bones.end[s] - bones.begin[s]) / cell)), 1)
        places.append(bones.begin[s] + np.linspace(0, 1, steps + 1)[:, None] * (bones.end[s] - bones.begin[s]))
    gap, at = tree.query((np.concatenate(places) - low) / cell + 1.0)
    near = gap < max(1.0, float(gap.min()) + 1e-9)
    return np.unique(np.asarray(at, np.int64)[near])


def _graph(number: IntArray, cell: float, seeds: list[IntArray], count: int) -> sparse.csr_matrix:
    """Ways between voxels and the 26 around each, and from a node for each bone, which no way leads to, to its own."""
    rows, columns, lengths = [], [], []
    padded = np.pad(number, 1, constant_values=-1)
    core = tuple(slice(1, -1) for _ in range(3))
    for side in _SIDES:
        other = padded[tuple(slice(1 + d, padded.shape[k] - 1 + d) for k, d in enumerate(side))]
        both = (padded[core] >= 0) & (other >= 0)
        a, b = padded[core][both], other[both]
        rows += [a, b]
        columns += [b, a]
        lengths.append(np.full(2 * len(a), cell * np.linalg.norm(side)))
    for k, seed in enumerate(seeds):
        rows.append(np.full(len(seed), count + k))
        columns.append(seed)
        lengths.append(np.full(len(seed), 1e-6 * cell))
    total = count + len(seeds)
    return sparse.csr_matrix(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), shape=(total, total)
    )
