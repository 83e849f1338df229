"""The core of the bundle adjustments against dense algebra and finite differences."""

import numpy as np
import pytest

from muybridge.geometry.calibration.bundle_adjustment.solver import (
    Damping,
    NormalEquations,
    by_pose,
    cauchy,
    damped_step,
    gauge,
    minimise,
    reduce,
)
from muybridge.geometry.numerics.rotations import exp_so3


def arrow(
    rng: np.random.Generator, shared: int = 5, blocks: int = 4, size: int = 3
) -> tuple[NormalEquations, np.ndarray]:
    """Equations from a random Jacobian, and the same as one dense matrix (blocks first) with its gradient behind."""
    rows = 12
    out = NormalEquations.zeros(shared, blocks, size)
    total = blocks * size + shared
    dense, gradient = np.zeros((total, total)), np.zeros(total)
    for b in range(blocks):
        jacobian = np.zeros((rows, total))
        jacobian[:, b * size : (b + 1) * size] = own = rng.normal(size=(rows, size))
        jacobian[:, blocks * size :] = common = rng.normal(size=(rows, shared))
        error = rng.normal(size=rows)
        dense += jacobian.T @ jacobian
        gradient += jacobian.T @ error
        out.blocks[b], out.cross[b], out.block_gradient[b] = own.T @ own, own.T @ common, own.T @ error
        out.shared[:] += common.T @ common
        out.shared_gradient[:] += common.T @ error
    return out, np.column_stack([dense, gradient])


@pytest.mark.parametrize("damping", [0.0, 0.1, 30.0])
def test_a_step_is_that_of_the_dense_equations(damping: float) -> None:
    equations, dense = arrow(np.random.default_rng(0))
    full = dense[:, :-1] + damping * np.diag(np.diag(dense))
    wanted = -np.linalg.solve(full, dense[:, -1])
    shared, blocks = damped_step(equations, damping)
    np.testing.assert_allclose(np.concatenate([blocks.ravel(), shared]), wanted, rtol=1e-9)


def test_the_inverse_of_the_reduced_equations_is_part_of_the_dense_inverse() -> None:
    equations, dense = arrow(np.random.default_rng(1))
    np.testing.assert_allclose(
        np.linalg.inv(reduce(equations, 0.0).matrix), np.linalg.inv(dense[:, :-1])[-5:, -5:], rtol=1e-9
    )


def test_what_nothing_depends_on_stays_where_it_is() -> None:
    equations, _ = arrow(np.random.default_rng(2))
    equations.blocks[1, 2], equations.blocks[1, :, 2] = 0.0, 0.0
    equations.cross[1, 2], equations.block_gradient[1, 2] = 0.0, 0.0
    _, blocks = damped_step(equations, 0.1)
    assert blocks[1, 2] == 0
    assert np.isfinite(blocks).all()


def test_derivatives_by_pose_are_those_of_differences() -> None:
    rng = np.random.default_rng(3)
    rotation, center, world = exp_so3(rng.normal(size=3)), rng.normal(size=3), rng.normal(size=(7, 3))
    by_point = rng.normal(size=(7, 2, 3))
    pose, point = by_pose((world - center) @ rotation.T, rotation, by_point)

    def image(turn: np.ndarray, shift: np.ndarray, moved: np.ndarray) -> np.ndarray:
        cam = (world + moved - center - shift) @ (exp_so3(turn) @ rotation).T
        return np.einsum("nij,nj->ni", by_point, cam)

    zero = np.zeros(3)
    for k, step in enumerate(np.eye(3) * 1e-6):
        by_turn = (image(step, zero, zero) - image(-step, zero, zero)) / 2e-6
        by_shift = (image(zero, step, zero) - image(zero, -step, zero)) / 2e-6
        by_world = (image(zero, zero, step) - image(zero, zero, -step)) / 2e-6
        np.testing.assert_allclose(pose[..., k], by_turn, atol=1e-7)
        np.testing.assert_allclose(pose[..., 3 + k], by_shift, atol=1e-7)
        np.testing.assert_allclose(point[..., k], by_world, atol=1e-7)


def test_the_gauge_changes_no_image() -> None:
    """Cameras moved along the gauge see the world, moved with them, where they saw it before."""
    rng = np.random.default_rng(4)
    rotations, centers, world = exp_so3(rng.normal(size=(3, 3))), rng.normal(size=(3, 3)), rng.normal(size=(9, 3)) + 5
    modes, middle, step = gauge(rotations, centers), centers.mean(axis=0), 1e-5
    for k in range(7):
        moved = modes[:, :, k] * step
        turned, shifted = exp_so3(moved[:, :3]) @ rotations, centers + moved[:, 3:]
        if k < 3:
            points = world + np.eye(3)[k] * step
        elif k < 6:
            points = middle + (world - middle) @ exp_so3(np.eye(3)[k - 3] * step).T
        else:
            points = middle + (world - middle) * (1 + step)
        for c in range(3):
            before = (world - centers[c]) @ rotations[c].T
            after = (points - shifted[c]) @ turned[c].T
            scale = 1 + step if k == 6 else 1.0
            np.testing.assert_allclose(after, before * scale, atol=1e-8)


def test_a_minimum_is_found_and_infinite_costs_are_left_out() -> None:
    """Rosenbrock's valley, from the far side; the state must stay below 1.5."""

    def residual(x: np.ndarray) -> np.ndarray:
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def cost(x: np.ndarray) -> float:
        return np.inf if x[1] > 1.5 else float(0.5 * residual(x) @ residual(x))

    def stepped(x: np.ndarray, normal: tuple[np.ndarray, np.ndarray], damping: float) -> np.ndarray:
        h, b = normal
        return x - np.linalg.solve(h + damping * np.diag(np.diag(h)), b)

    def linearised(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        jacobian = np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return jacobian.T @ jacobian, jacobian.T @ residual(x)

    schedule = Damping(start=1e-3, down=10.0, up=10.0, lowest=1e-12, tolerance=1e-12, iterations=100)
    state, value, done = minimise(np.array([-1.2, 1.0]), cost, linearised, stepped, schedule)
    np.testing.assert_allclose(state, 1.0, atol=1e-6)
    assert value < 1e-12 and 1 < done < 100


def test_cauchys_loss_is_least_squares_for_small_errors_and_leaves_out_points_behind_a_camera() -> None:
    value, weight = cauchy(np.array([1e-6, 9.0, np.nan]), 3.0, 1e8)
    assert value == pytest.approx(0.5 * (1e-6 + 9 * np.log(2) + 9 * np.log1p(1e8 / 9)))
    np.testing.assert_allclose(weight, [1.0, 0.5, 0.0], rtol=1e-6)
    value, weight = cauchy(np.array([1e-6, 9.0]), np.inf)
    assert value == pytest.approx(0.5 * (9 + 1e-6))
    np.testing.assert_array_equal(weight, 1.0)
