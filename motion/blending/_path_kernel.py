"""The cheapest way through a grid of distances, its steps limited in slope: dynamic programming, compiled."""

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled


@compiled
def cheapest_path(distances: FloatArray, skipping: float, free: int, most: int) -> IntArray:
    """The cells of the cheapest way from the first frames of both motions to the last ones.

    A step leads one frame on in one motion or in both; a step in both counts its cell twice, so that all ways count
    alike many cells. At most `most` steps in a row lead on in one motion alone.

    Args:
        distances: (T, S) not negative.
        skipping: what a frame costs that is left out at an end.
        free: frames of one motion that may be left out at either end.
        most: steps in a row in one direction, from 1.

    Returns:
        (K, 2) cells, from the first to the last; empty where no way leads through.
    """
    rows, columns = distances.shape
    states = 2 * most + 1  # 0: came by a step in both; 1 .. most: steps down in a row; then steps to the right
    cost = np.full((rows, columns, states), np.inf)
    came = np.full((rows, columns, states), 255, np.uint8)  # the state before; 254: the way begins here
    for i in range(rows):
        for j in range(columns):
            here = distances[i, j]
            if (i == 0 and j <= free) or (j == 0 and i <= free):
                cost[i, j, 0] = here + skipping * (i + j)
                came[i, j, 0] = 254
            if i > 0 and j > 0:
                for s in range(states):
                    if cost[i - 1, j - 1, s] + 2 * here < cost[i, j, 0]:
                        cost[i, j, 0] = cost[i - 1, j - 1, s] + 2 * here
                        came[i, j, 0] = s
            for k in range(1, most + 1):
                before = k - 1  # a run goes on, or begins after a step in both
                if i > 0 and cost[i - 1, j, before] + here < cost[i, j, k]:
                    cost[i, j, k] = cost[i - 1, j, before] + here
                    came[i, j, k] = before
                right = most + k
                before = 0 if k == 1 else right - 1
                if j > 0 and cost[i, j - 1, before] + here < cost[i, j, right]:
                    cost[i, j, right] = cost[i, j - 1, before] + here
                    came[i, j, right] = before
    best, end_i, end_j, state = np.inf, -1, -1, 0
    for i in range(rows):
        for j in range(columns):
            left = (rows - 1 - i) + (columns - 1 - j)
            if (i == rows - 1 or j == columns - 1) and left <= free:
                for s in range(states):
                    if cost[i, j, s] + skipping * left < best:
                        best, end_i, end_j, state = cost[i, j, s] + skipping * left, i, j, s
    if end_i < 0:
        return np.empty((0, 2), np.int64)
    way = np.empty((rows + columns, 2), np.int64)
    count, i, j = 0, end_i, end_j
    while True:
        way[count, 0], way[count, 1] = i, j
        count += 1
        before = came[i, j, state]
        if before == 254:
            break
        if state == 0:
            i, j = i - 1, j - 1
        elif state <= most:
            i -= 1
        else:
            j -= 1
        state = int(before)
    return way[:count][::-1].copy()
