"""Squares of cells cut out of maps."""

import numpy as np
from numpy.typing import NDArray


def patches(
    maps: NDArray[np.float32], which: NDArray[np.intp], cells: NDArray[np.intp], reach: int
) -> NDArray[np.float32]:
    """(K, n, n) of the maps `which` (K,) of (M, h, w): the n = 2 reach + 1 rows and columns round `cells` (K,), which
    are counted along the rows; zero beyond a map's edge."""
    height, width = maps.shape[1:]
    around = np.arange(-reach, reach + 1)
    v, u = (at[:, None] + around for at in np.divmod(cells, width))
    inside_v, inside_u = (v >= 0) & (v < height), (u >= 0) & (u < width)
    index = np.clip(v, 0, height - 1)[:, :, None] * width + np.clip(u, 0, width - 1)[:, None, :]
    patch: NDArray[np.float32] = maps.reshape(-1)[index + (which * (height * width))[:, None, None]]
    patch *= inside_v[:, :, None] & inside_u[:, None, :]
    return patch
