"""The keys that `reduce` finds, against the same division in plain NumPy."""

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import quat_from_rotvec, slerp
from muybridge.motion.editing._keys_kernel import divide

FINEST = 0.05


def divided(column: FloatArray, finest: float, even: bool) -> FloatArray:
    """(T,) weights of the keys of one column (T, 3 or 4)."""
    out = np.zeros(len(column))
    out[[0, -1]] = np.inf
    ways = [(0, len(column) - 1, np.inf)]
    while ways:
        a, b, limit = ways.pop()
        share = (np.arange(a, b + 1) - a) / (b - a)
        if even:
            way = slerp(np.tile(column[a], (len(share), 1)), np.tile(column[b], (len(share), 1)), share)
            away = 2 * np.arccos(np.clip(np.abs((way * column[a : b + 1]).sum(-1)), 0, 1))
        else:
            way = column[a] + (column[b] - column[a]) * share[:, None]
            away = np.linalg.norm(way - column[a : b + 1], axis=-1)
        at = int(np.argmax(away[1:-1])) + 1 if b - a > 1 else 0
        if b - a > 1 and away[at] > finest:
            out[a + at] = min(away[at], limit)
            ways += [(a, a + at, out[a + at]), (a + at, b, out[a + at])]
    return out


@pytest.mark.parametrize("even", [False, True])
def test_keys_divide_ways_at_the_farthest_frame(even: bool) -> None:
    rng = np.random.default_rng(3)
    walk = np.cumsum(rng.normal(0, 0.15, (60, 4, 3)), axis=0)
    values = quat_from_rotvec(walk) if even else walk
    values[30:, 1] *= -1 if even else 1  # the same rotations
    weights = divide(values, np.array([1.0, 1.0, 2.0, 1e-9]), FINEST, even)
    assert (weights[1:-1, 3] == 0).all() and (weights[1:-1, 0] > 0).any() and (weights[1:-1, 0] == 0).any()
    for k, factor in enumerate((1.0, 1.0, 2.0)):
        expected = divided(values[:, k], FINEST / factor, even) * factor
        np.testing.assert_allclose(weights[:, k], expected, atol=1e-6)
