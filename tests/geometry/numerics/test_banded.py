"""Damped band solves against dense ones."""

import subprocess
import sys

import numpy as np
import pytest

from muybridge.geometry.numerics.banded import solve_damped


def band_of(matrix: np.ndarray, reach: int) -> np.ndarray:
    size = len(matrix)
    band = np.zeros((size, reach + 1))
    for k in range(min(reach + 1, size)):
        band[: size - k, k] = np.diagonal(matrix, -k)
    return band


def equations(frames: int, n: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A positive definite matrix that couples three frames in a row, and a gradient."""
    rng = np.random.default_rng(seed)
    size = frames * n
    factor = np.tril(rng.normal(size=(size, size))) * (np.subtract.outer(np.arange(size), np.arange(size)) <= 2 * n)
    return factor @ factor.T + np.eye(size), rng.normal(size=(frames, n))


@pytest.mark.parametrize(("frames", "n"), [(1, 5), (2, 3), (3, 7), (9, 4), (12, 11), (5, 16)])
def test_a_step_solves_the_damped_equations(frames: int, n: int) -> None:
    matrix, slope = equations(frames, n, frames + n)
    held = np.random.default_rng(n).random(slope.shape) < 0.2
    band = band_of(matrix, 2 * n)
    before = band.copy()
    step = solve_damped(band, slope, held, 1e-2)
    free = ~held.ravel()
    damped = matrix + np.diag(1e-2 * np.diag(matrix) + 1e-9)
    expected = np.zeros(slope.size)
    expected[free] = np.linalg.solve(damped[np.ix_(free, free)], -slope.ravel()[free])
    assert step is not None
    np.testing.assert_allclose(step.ravel(), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(band, before)


def test_scratch_that_was_used_before_changes_nothing() -> None:
    matrix, slope = equations(10, 6, 0)
    band, held = band_of(matrix, 12), np.zeros(slope.shape, np.bool_)
    dirty = np.full_like(band, np.nan)
    fresh, again = solve_damped(band, slope, held, 0.0), solve_damped(band, slope, held, 0.0, dirty)
    assert fresh is not None
    assert again is not None
    np.testing.assert_array_equal(fresh, again)


def test_a_matrix_that_is_not_positive_definite_has_no_step() -> None:
    matrix, slope = equations(10, 6, 0)
    matrix[37, 37] = -1.0
    assert solve_damped(band_of(matrix, 12), slope, np.zeros(slope.shape, np.bool_), 0.0) is None


def test_a_wide_band_starts_no_threads() -> None:
    """As wide as a body's: LAPACK through OpenBLAS would give it to every core."""
    script = (
        "import numpy as np, time\n"
        "from muybridge.geometry.numerics.banded import solve_damped\n"
        "band = np.random.default_rng(0).normal(size=(6000, 111))\n"
        "band[:, 0] = 400\n"
        "slope = np.ones((100, 60)); held = np.zeros(slope.shape, bool)\n"
        "solve_damped(band, slope, held, 0.0)\n"
        "process, thread = time.process_time(), time.thread_time()\n"
        "for _ in range(10): solve_damped(band, slope, held, 0.0)\n"
        "print((time.process_time() - process) / (time.thread_time() - thread))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 1.1
