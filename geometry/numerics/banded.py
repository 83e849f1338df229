"""Damped normal equations with a band, solved without LAPACK.

OpenBLAS gives a band as wide as a body's unknowns to a thread for every core, and these spin while they wait for each
other: beside another busy program that is several times slower than one thread. One thread here is as fast as one of
LAPACK's, and a program that embeds this package need not set up its own libraries for it.

Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th edition, 2013, section 4.3.5 (band Cholesky), in blocks
of `_COLUMNS` columns.
"""

from __future__ import annotations

import math

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics._numba import compiled, subroutine, sums

_COLUMNS = 8


def solve_damped(
    band: FloatArray, slope: FloatArray, held: BoolArray, damping: float, factor: FloatArray | None = None
) -> FloatArray | None:
    """The step that a band of normal equations asks for, with some unknowns held.

    Args:
        band: (P, W + 1), one row per unknown: `band[p, k]` is the matrix at row `p + k` and column `p`. Not changed.
        slope: the gradient, of `P` values in any shape.
        held: of the same shape, the unknowns that do not move.
        damping: share of the diagonal that is added to it (Levenberg).
        factor: scratch like `band`, which is worth keeping from one step to the next; made if None.

    Returns:
        The step in the gradient's shape, zero where held; None where the damped matrix is not positive definite.
    """
    factor = np.empty_like(band) if factor is None else factor
    step = np.empty(band.shape[0])
    if not solve_band(band, np.ravel(slope), np.ravel(held), damping, factor, step):
        return None
    return step.reshape(slope.shape)


@compiled
def solve_band(
    band: FloatArray, slope: FloatArray, held: BoolArray, damping: float, factor: FloatArray, step: FloatArray
) -> bool:
    size, width = band.shape
    keep = np.zeros(size + width)
    for p in range(size):
        keep[p] = 0.0 if held[p] else 1.0
        step[p] = 0.0 if held[p] else -slope[p]
    panel = np.zeros((_COLUMNS, width + 2 * _COLUMNS))
    filled = 0
    for p in range(0, size, _COLUMNS):
        count = min(_COLUMNS, size - p)
        # Rows are copied just before they are needed, while the cache still has their neighbours.
        last = min(p + _COLUMNS + width, size)
        for q in range(filled, last):
            _copy_row(band[q], keep[q : q + width], damping, factor[q])
        filled = last
        if not _factor_columns(factor, step, p, count):
            return False
        if count == _COLUMNS:
            _subtract_panel(factor, panel, p)
    for p in range(size - 1, -1, -1):
        count = min(width, size - p)
        step[p] = (step[p] - _dot(factor[p, 1:count], step[p + 1 : p + count])) / factor[p, 0]
    return True


@subroutine
def _copy_row(row: FloatArray, keep: FloatArray, damping: float, out: FloatArray) -> None:
    """A row of the band without the unknowns that are held, damped; `keep` is 0 or 1 for it and those after it."""
    if keep[0] == 0:
        out[:], out[0] = 0.0, 1.0
        return
    for k in range(len(row)):
        out[k] = row[k] * keep[k]
    out[0] = row[0] * (1 + damping) + 1e-9


@subroutine
def _factor_columns(factor: FloatArray, step: FloatArray, p: int, count: int) -> bool:
    """Finish `count` columns from `p` on, and what the right side of the equations loses to them."""
    size, width = factor.shape
    for k in range(count):
        reach = min(width, size - p - k)
        column = factor[p + k, :reach]
        for before in range(max(k - width + 1, 0), k):
            _subtract(column, factor[p + before, k - before :], factor[p + before, k - before])
        if not column[0] > 0:
            return False
        share = 1.0 / math.sqrt(column[0])
        for i in range(reach):
            column[i] *= share
        step[p + k] *= share
        _subtract(step[p + k + 1 : p + k + reach], column[1:], step[p + k])
    return True


@sums
def _subtract(out: FloatArray, values: FloatArray, share: float) -> None:
    for i in range(min(len(out), len(values))):
        out[i] -= share * values[i]


@sums
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@subroutine
def _subtract_panel(factor: FloatArray, panel: FloatArray, p: int) -> None:
    """Subtract the products of `_COLUMNS` finished columns from all those that they reach; `panel` is scratch."""
    size, width = factor.shape
    total = min(width - 1, size - p - _COLUMNS)
    for k in range(_COLUMNS):
        count = max(min(width - _COLUMNS + k, total), 0)
        for i in range(count):
            panel[k, i] = factor[p + k, _COLUMNS - k + i]
        panel[k, count:] = 0.0
    for j in range(total):
        # Whole vectors: the panel has zeros behind its end.
        count = min((total - j + 7) // 8 * 8, width)
        _subtract_products(factor[p + _COLUMNS + j], panel, j, count)


@sums
def _subtract_products(row: FloatArray, panel: FloatArray, j: int, count: int) -> None:
    end = j + count
    a, b, c, d = panel[0, j:end], panel[1, j:end], panel[2, j:end], panel[3, j:end]
    e, f, g, h = panel[4, j:end], panel[5, j:end], panel[6, j:end], panel[7, j:end]
    a0, b0, c0, d0, e0, f0, g0, h0 = a[0], b[0], c[0], d[0], e[0], f[0], g[0], h[0]
    for i in range(count):
        row[i] -= (a0 * a[i] + b0 * b[i] + c0 * c[i] + d0 * d[i]) + (e0 * e[i] + f0 * f[i] + g0 * g[i] + h0 * h[i])
