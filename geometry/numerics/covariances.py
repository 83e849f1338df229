"""Covariances of points: millions of symmetric 3 x 3 matrices, inverted and divided by in closed form.

numpy calls LAPACK for each of them, which costs several times as much as the arithmetic.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics._numba import compiled, leaf


def inverses(matrices: FloatArray) -> FloatArray:
    """(..., 3, 3) inverses, by cofactors; not finite where singular."""
    flat = np.ascontiguousarray(matrices, dtype=np.float64).reshape(-1, 3, 3)
    return np.asarray(invert_all(flat).reshape(matrices.shape))


def squared_distances(off: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) squared Mahalanobis lengths of vectors (..., 3) under covariances (..., 3, 3)."""
    vectors = np.ascontiguousarray(off, dtype=np.float64).reshape(-1, 3)
    matrices = np.ascontiguousarray(covariance, dtype=np.float64).reshape(-1, 3, 3)
    return np.asarray(measure_all(vectors, matrices).reshape(off.shape[:-1]))


def between(matrices: FloatArray, low: float, high: float) -> BoolArray:
    """(...) whether every eigenvalue of symmetric matrices (..., 3, 3) is surely above `low`, which is
    not negative, and below `high`.

    The trace bounds the largest eigenvalue, so a matrix just below `high` may be told False.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of what is told False
        a = matrices - low * np.eye(3)
        minor = a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] ** 2
        determinant = (
            a[..., 2, 2] * minor
            - a[..., 1, 2] * (a[..., 0, 0] * a[..., 1, 2] - a[..., 0, 1] * a[..., 0, 2])
            + a[..., 0, 2] * (a[..., 0, 1] * a[..., 1, 2] - a[..., 1, 1] * a[..., 0, 2])
        )
    trace = matrices[..., 0, 0] + matrices[..., 1, 1] + matrices[..., 2, 2]
    return np.asarray((a[..., 0, 0] > 0) & (minor > 0) & (determinant > 0) & (trace < high))


@leaf
def inverse_one(a: FloatArray, out: FloatArray) -> None:
    """Inverse of one 3 x 3 matrix."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[1, 2] * a[2, 0] - a[1, 0] * a[2, 2]
    c02 = a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]
    scale = 1.0 / (a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02)
    out[0, 0], out[1, 0], out[2, 0] = c00 * scale, c01 * scale, c02 * scale
    out[0, 1] = (a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]) * scale
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]) * scale
    out[2, 1] = (a[0, 1] * a[2, 0] - a[0, 0] * a[2, 1]) * scale
    out[0, 2] = (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]) * scale
    out[1, 2] = (a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]) * scale
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) * scale


@compiled
def invert_all(matrices: FloatArray) -> FloatArray:
    out = np.empty_like(matrices)
    for k in range(len(matrices)):
        inverse_one(matrices[k], out[k])
    return out


@compiled
def measure_all(vectors: FloatArray, matrices: FloatArray) -> FloatArray:
    out, inverse = np.empty(len(vectors)), np.empty((3, 3))
    for k in range(len(vectors)):
        inverse_one(matrices[k], inverse)
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += vectors[k, i] * inverse[i, j] * vectors[k, j]
        out[k] = total
    return out
