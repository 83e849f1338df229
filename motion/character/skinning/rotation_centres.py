"""Optimised centres of rotation: for each vertex the place about which its blended rotation turns it.

The centre of a vertex is the mean of the surface, weighted by how similarly it is skinned, so that a whole ring of an
elbow turns about the middle of the ring.

Source: Le and Hodgins, Real-time skeletal skinning with optimized centers of rotation, 2016, equations 1 and 4.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.character.skinning.skin import Skin

_SIGMA = 0.1  # of the similarity of weights, as the paper has it
_LEAST_WEIGHT = 1e-3


def rotation_centres(skins: Sequence[Skin]) -> list[FloatArray]:
    """(V, 3) metres for each of the skins of one character, where each vertex's centre is at rest.

    All skins count for all, so that parts of one body turn about the same centres and stay together. The similarity of
    a vertex to a triangle is a sum over pairs of joints that both have, so that each pair is summed by itself.
    """
    shapes = [s.stretched(s.positions) for s in skins]
    joints = max((len(s.bind) for s in skins), default=0)
    weights = sparse.vstack([_matrix(s, joints) for s in skins]).tocsr()
    offsets = np.cumsum([0, *(len(s.positions) for s in skins)])
    shape = np.concatenate(shapes)
    triangles = np.concatenate([s.triangles + n for s, n in zip(skins, offsets[:-1], strict=True)]).astype(np.int64)
    corners = shape[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middle = corners.mean(axis=1)
    of_triangle = (
        sparse.csr_matrix(
            (np.full(triangles.size, 1 / 3), (np.repeat(np.arange(len(triangles)), 3), triangles.ravel())),
            shape=(len(triangles), len(shape)),
        )
        @ weights
    )
    total, amount = np.zeros_like(shape), np.zeros(len(shape))
    by_vertex, by_triangle = _columns(weights.tocsc()), _columns(of_triangle.tocsc())
    both = (of_triangle.astype(bool).astype(np.float64).T @ of_triangle.astype(bool).astype(np.float64)).tocoo()
    for j, k in zip(both.row, both.col, strict=True):
        if j < k:
            v, a, b = _shared(by_vertex[j], by_vertex[k])
            f, c, d = _shared(by_triangle[j], by_triangle[k])
            if len(v) and len(f):
                _add_pair(v, a, b, area[f] * c * d, c, d, middle[f], total, amount)
    # Without similar surface the vertex itself is the centre, which is linear blending.
    sound = amount > 1e-30
    centres = np.where(sound[:, None], total / np.where(sound, amount, 1.0)[:, None], shape)
    return [centres[a:b] for a, b in zip(offsets[:-1], offsets[1:], strict=True)]


def _matrix(skin: Skin, joints: int) -> sparse.csr_matrix:
    """(V, J) weights, without the least ones."""
    count, width = skin.joints.shape
    rows = np.repeat(np.arange(count), width)
    out = sparse.csr_matrix((skin.weights.ravel(), (rows, skin.joints.ravel())), shape=(count, joints))
    out.data[out.data < _LEAST_WEIGHT] = 0.0
    out.eliminate_zeros()
    return out


def _columns(matrix: sparse.csc_matrix) -> list[tuple[FloatArray, FloatArray]]:
    """Rows and values of each column."""
    matrix.sort_indices()
    ends = matrix.indptr
    return [(matrix.indices[a:b], matrix.data[a:b]) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def _shared(
    first: tuple[FloatArray, FloatArray], second: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows that two columns have both, and the values of each there."""
    rows, a, b = np.intersect1d(first[0], second[0], assume_unique=True, return_indices=True)
    return rows.astype(np.int64), first[1][a], second[1][b]


@compiled
def _add_pair(rows, a, b, amounts, c, d, middles, total, amount):  # type: ignore[no-untyped-def]
    """Add to vertices `rows` the triangles that have the same pair of joints."""
    scale = 1.0 / (_SIGMA * _SIGMA)
    for i in range(len(rows)):
        x, y, z, s = 0.0, 0.0, 0.0, 0.0
        for f in range(len(c)):
            gap = a[i] * d[f] - b[i] * c[f]
            gap *= gap * scale
            if gap < 16.0:
                w = amounts[f] * np.exp(-gap)
                s += w
                x += w * middles[f, 0]
                y += w * middles[f, 1]
                z += w * middles[f, 2]
        both = a[i] * b[i]
        v = rows[i]
        amount[v] += both * s
        total[v, 0] += both * x
        total[v, 1] += both * y
        total[v, 2] += both * z
