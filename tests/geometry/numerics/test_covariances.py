"""Closed forms on 3 x 3 matrices against numpy's."""

import numpy as np

from muybridge.geometry.numerics.covariances import between, inverses, squared_distances


def covariances(seed: int, shape: tuple[int, ...]) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(*shape, 3, 3))
    return root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(3)


def test_inverses() -> None:
    matrices = covariances(0, (4, 5))
    np.testing.assert_allclose(inverses(matrices), np.linalg.inv(matrices), rtol=1e-9)


def test_squared_distances() -> None:
    matrices, off = covariances(1, (4, 5)), np.random.default_rng(2).normal(size=(4, 5, 3))
    expected = np.sum(off * np.linalg.solve(matrices, off[..., None])[..., 0], axis=-1)
    np.testing.assert_allclose(squared_distances(off, matrices), expected, rtol=1e-9)


def test_between_agrees_with_the_eigenvalues() -> None:
    matrices = covariances(3, (500,)) - 0.6 * np.eye(3)
    values = np.linalg.eigvalsh(matrices)
    above = values[:, 0] > 0.05
    np.testing.assert_array_equal(between(matrices, 0.05, np.inf), above)
    assert 0 < above.sum() < len(above)
    below = between(matrices, 0.0, 4.0)
    assert 0 < values[below].min()
    assert values[below].max() < 4.0
    assert 0 < below.sum() < len(below)
    assert not between(np.full((3, 3), np.nan), 0.0, 1.0)
    flat = np.diag([1.0, 1.0, 0.0])
    assert not between(flat, 1e-6, 1e4)
