"""Square windows cut out of maps."""

import numpy as np

from muybridge.arrays import Float32Array, IndexArray


def patches(maps: Float32Array, which: IndexArray, cells: IndexArray, reach: int) -> Float32Array:
    """Windows of 2 reach + 1 rows and columns.

    Args:
        maps: (M, h, w).
        which: (K,) index of each window's map.
        cells: (K,) flat index of each window's central cell.
        reach: cells on each side of it.

    Returns:
        (K, n, n), zero beyond a map's edge.
    """
    height, width = maps.shape[1:]
    around = np.arange(-reach, reach + 1)
    v, u = (at[:, None] + around for at in np.divmod(cells, width))
    inside_v, inside_u = (v >= 0) & (v < height), (u >= 0) & (u < width)
    index = np.clip(v, 0, height - 1)[:, :, None] * width + np.clip(u, 0, width - 1)[:, None, :]
    patch: Float32Array = maps.reshape(-1)[index + (which * (height * width))[:, None, None]]
    patch *= inside_v[:, :, None] & inside_u[:, None, :]
    return patch
