"""Squares of cells cut out of maps."""

import numpy as np

from muybridge.arrays import Float32Array, IndexArray


def patches(maps: Float32Array, which: IndexArray, cells: IndexArray, reach: int) -> Float32Array:
    """(K, n, n) of the maps `which` (K,) of (M, h, w): the n = 2 reach + 1 rows and columns round `cells` (K,), which
    are counted along the rows; zero beyond a map's edge."""
    height, width = maps.shape[1:]
    around = np.arange(-reach, reach + 1)
    v, u = (at[:, None] + around for at in np.divmod(cells, width))
    inside_v, inside_u = (v >= 0) & (v < height), (u >= 0) & (u < width)
    index = np.clip(v, 0, height - 1)[:, :, None] * width + np.clip(u, 0, width - 1)[:, None, :]
    patch: Float32Array = maps.reshape(-1)[index + (which * (height * width))[:, None, None]]
    patch *= inside_v[:, :, None] & inside_u[:, None, :]
    return patch
