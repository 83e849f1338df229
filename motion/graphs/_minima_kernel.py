"""Windowed distances of one block, and their local minima: the loops over pairs of frames."""

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, IntArray
from muybridge.geometry.numerics._numba import compiled


@compiled
def window_distances(
    products: Float32Array, swings: Float32Array, row_sizes: Float32Array, column_sizes: Float32Array,
    row_valid: BoolArray, column_valid: BoolArray, window: int, out: Float32Array,
) -> None:  # fmt: skip
    """Distances (R, C) of windows, from inner products of their frames.

    The sum over a window runs along a diagonal, so that each pair costs one addition and one subtraction.

    Args:
        products: (3, R + window - 1, C + window - 1) along, across and heights, of single frames.
        swings: (2, R, C) along and across of the centroids' ways through the windows.
        row_sizes: (R,) of the windows, metres squared.
        column_sizes: (C,)
        row_valid: (R,) whether a window lies in one clip.
        column_valid: (C,)
        window: frames.
        out: (R, C) metres squared; infinite where a window lies in no clip.
    """
    rows, columns = out.shape
    old = np.zeros((3, columns), np.float32)
    new = np.zeros((3, columns), np.float32)
    share = np.float32(1.0 / window)
    for i in range(rows):
        for q in range(3):
            f, before, after = products[q], old[q], new[q]
            if i == 0:
                for j in range(columns):
                    after[j] = np.float32(0)
                for k in range(window):
                    for j in range(columns):
                        after[j] += f[k, j + k]
            else:
                first = np.float32(0)
                for k in range(window):
                    first += f[i + k, k]
                enters, leaves = f[i + window - 1], f[i - 1]
                for j in range(1, columns):
                    after[j] = before[j - 1] + enters[j + window - 1] - leaves[j - 1]
                after[0] = first
        size, line = row_sizes[i], out[i]
        a, b, h, u, v = new[0], new[1], new[2], swings[0, i], swings[1, i]
        for j in range(columns):
            along = share * a[j] + u[j]
            across = share * b[j] + v[j]
            both = np.sqrt(along * along + across * across) + share * h[j]
            line[j] = max(size + column_sizes[j] - np.float32(2) * both, np.float32(0))
        if not row_valid[i]:
            line[:] = np.inf
        old, new = new, old
    for j in range(columns):
        if not column_valid[j]:
            out[:, j] = np.inf


@compiled
def _is_minimum(block: Float32Array, i: int, j: int, radius: int) -> bool:
    """Whether nothing nearby is less; of equal ones the first in order of rows counts."""
    value = block[i, j]
    rows, columns = block.shape
    for reach in range(1, radius + 1):
        for a in range(max(i - reach, 0), min(i + reach + 1, rows)):
            edge = a == i - reach or a == i + reach
            step = 1 if edge else 2 * reach
            for b in range(j - reach, j + reach + 1, step):
                if 0 <= b < columns and (block[a, b] < value or (block[a, b] == value and (a, b) < (i, j))):
                    return False
    return True


@compiled
def _insert(distances: Float32Array, others: IntArray, other: int, value: float) -> None:
    """Put a minimum among the best ones of a frame, (K,) in ascending order."""
    k = len(distances) - 1
    if value >= distances[k]:
        return
    while k > 0 and distances[k - 1] > value:
        distances[k], others[k] = distances[k - 1], others[k - 1]
        k -= 1
    distances[k], others[k] = value, other


@compiled
def collect_minima(
    block: Float32Array, row: int, column: int, margins: tuple[int, int, int, int], radius: int, least_gap: int,
    clip: IntArray, best: Float32Array, others: IntArray,
) -> None:  # fmt: skip
    """Put the local minima of a block into the lists of both of their frames.

    Args:
        block: (R, C) distances, metres squared.
        row: frame of its first row.
        column: frame of its first column.
        margins: rows and columns at the block's top, bottom, left and right that are neighbours alone.
        radius: frames in each direction in which nothing is less.
        least_gap: frames between the two of one clip.
        clip: (F,) number of each frame's clip.
        best: (2, F, K) least distances, ascending: within the clip, and to other clips. Changed.
        others: (2, F, K) their frames. Changed.
    """
    rows, columns = block.shape
    top, bottom, left, right = margins
    worst = best.shape[2] - 1
    for i in range(top, rows - bottom):
        frame = row + i
        for j in range(left, columns - right):
            other = column + j
            if other <= frame:
                continue
            value = block[i, j]
            same = clip[frame] == clip[other]
            if same and other - frame < least_gap:
                continue
            kind = 0 if same else 1
            if value >= best[kind, frame, worst] and value >= best[kind, other, worst]:
                continue
            if not np.isfinite(value) or not _is_minimum(block, i, j, radius):
                continue
            _insert(best[kind, frame], others[kind, frame], other, value)
            _insert(best[kind, other], others[kind, other], frame, value)
