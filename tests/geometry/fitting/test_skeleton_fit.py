"""Any skeleton to labelled points: kernels against plain numpy, the bars on the CMU take, limits, gaps, calibration."""

import time
from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting import _chain_kernel as ik_kernel
from muybridge.geometry.fitting.gauss_newton import Pose, Problem, jacobian
from muybridge.geometry.fitting.scaling import calibrate_skeleton
from muybridge.geometry.fitting.skeleton_fit import (
    OnlineFit,
    SkeletonFitOptions,
    fit_online,
    fit_take,
    joint_rigging,
    solvable,
)
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.motion.formats.skeletal.bvh import read_bvh
from tests.paths import SHARED

CMU = SHARED / "data" / "motion" / "01_01.bvh"


def random_problem(frames: int = 4) -> tuple[Problem, Pose]:
    rng = np.random.default_rng(0)
    shape = prior_shape(1.7)
    j = len(BODY.joint_names)
    root = rng.normal(0, 1, (frames, len(BODY.landmark_names), 3, 3))
    problem = Problem(
        BODY.skeleton(shape), BODY.landmark_joints, BODY.landmark_offsets(shape),
        rng.normal(0, 0.5, (frames, len(BODY.landmark_names), 3)), root @ np.swapaxes(root, -1, -2),
        BODY.rest, np.full((j, 3), 0.3), np.full(6 + 3 * j, 2.0), np.full(6 + 3 * j, 0.7),
    )  # fmt: skip
    low, high = np.maximum(BODY.lower, -1), np.minimum(BODY.upper, 1)
    angles = rng.uniform(low, np.maximum(high, low), (frames, j, 3))
    return problem, Pose(rng.normal(0, 1, (frames, 3)), exp_so3(rng.normal(0, 1, (frames, 3))), angles)


def test_normal_equations_without_a_jacobian():
    problem, pose = random_problem()
    points, jac = jacobian(problem, pose)
    matrices, slopes, cost = ik_kernel.normal_equations(
        problem.chain, pose.root, pose.turn, pose.angles, problem.targets, problem.information, 0, len(points)
    )
    pulled = problem.information @ jac
    full = np.tril(matrices) + np.swapaxes(np.tril(matrices, -1), 1, 2)
    error = points - problem.targets
    np.testing.assert_allclose(full, np.einsum("tlin,tlim->tnm", jac, pulled), atol=1e-9)
    np.testing.assert_allclose(slopes, np.einsum("tlin,tli->tn", pulled, error), atol=1e-9)
    assert cost == pytest.approx(0.5 * np.einsum("tli,tlij,tlj->", error, problem.information, error))


def test_tree_sparse_factor_solves_and_inverts():
    problem, pose = random_problem(1)
    matrices, slopes, _ = ik_kernel.normal_equations(
        problem.chain, pose.root, pose.turn, pose.angles, problem.targets, problem.information, 0, 1
    )
    n = slopes.shape[1]
    full = np.tril(matrices[0]) + np.tril(matrices[0], -1).T + np.eye(n)
    factor, vector, out = matrices[0] + np.eye(n), slopes[0].copy(), np.empty(n)
    assert ik_kernel.factor(problem.chain.above, factor)
    ik_kernel.substitute(problem.chain.above, factor, vector)
    ik_kernel.inverse_diagonal(problem.chain.above, factor, np.empty((n, n)), out)
    np.testing.assert_allclose(full @ vector, slopes[0], atol=1e-9)
    np.testing.assert_allclose(out, np.diag(np.linalg.inv(full)), rtol=1e-9)


@pytest.fixture(scope="module")
def take():
    """Skeleton, rigging, truth and noisy points of 700 frames: 10 mm per axis, 5 % missing."""
    if not CMU.is_file():
        pytest.skip("../shared/data is not here")
    motion = read_bvh(CMU, metres_per_unit=0.0254 / 0.45)
    skeleton = motion.skeleton
    names = tuple(n for j, n in enumerate(skeleton.names) if j == 0 or skeleton.bone_lengths[j] > 1e-6)
    truth = motion.joint_positions_world()[:700, [skeleton.index(n) for n in names]]
    rng = np.random.default_rng(11)
    points = truth + rng.normal(0, 0.01, truth.shape)
    points[rng.random(points.shape[:2]) < 0.05] = np.nan
    return skeleton, joint_rigging(skeleton, names), truth, points, motion.fps


def rmse(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.sum((found - truth) ** 2, axis=-1))))


def yardstick() -> float:
    """Seconds of this thread that 1,000 products of 64 x 64 matrices take."""
    a = np.random.default_rng(0).normal(size=(64, 64))
    begun = time.thread_time()
    for _ in range(1000):
        a @ a
    return time.thread_time() - begun


@pytest.mark.parametrize(("fit", "ratio", "per_second"), [(fit_online, 0.74, 5000), (fit_take, 0.65, 1000)])
def test_bars_on_the_cmu_take(take, fit, ratio, per_second):
    skeleton, rigging, truth, points, fps = take
    found = fit(skeleton, points, fps, rigging)
    assert rmse(found.landmarks_world, truth) <= ratio * rmse(points, truth)
    limited = solvable(skeleton, rigging)
    assert (found.angles[:, 1:] >= limited.lower[1:]).all() and (found.angles[:, 1:] <= limited.upper[1:]).all()
    at = found.motion.joint_positions_world()
    for j, parent in enumerate(skeleton.parents[1:], start=1):
        assert np.ptp(np.linalg.norm(at[:, j] - at[:, parent], axis=1)) < 1e-6
    begun = time.thread_time()
    fit(skeleton, points, fps, rigging)
    seconds = time.thread_time() - begun
    # A quiet core does 1,000 of those products in 0.03 s or less: a third of the bar's speed must be left anywhere.
    slow = max(1.0, yardstick() / 0.03)
    assert len(points) / seconds * slow > per_second / 3


def test_far_points_do_not_pull(take):
    skeleton, rigging, truth, points, fps = take
    truth, points = truth[1:], points[1:]  # the first frame, a T-pose, stands alone: nothing tells its outliers
    rng = np.random.default_rng(5)
    far = rng.random(points.shape[:2]) < 0.05
    bad = points.copy()
    bad[far] += rng.normal(0, 0.5, (far.sum(), 3))
    clean, spoiled = (fit_take(skeleton, p, fps, rigging) for p in (points, bad))
    assert rmse(spoiled.landmarks_world, truth) < 1.25 * rmse(clean.landmarks_world, truth)
    assert spoiled.weight[far & np.isfinite(bad[..., 0])].mean() < 0.1 < 0.8 < spoiled.weight[~far].mean()


def test_one_frame_after_another_is_the_same(take):
    skeleton, rigging, _, points, fps = take
    found = fit_online(skeleton, points[:60], fps, rigging)
    live = OnlineFit(skeleton, fps, found.sigma, rigging)
    frames = [live.update(p) for p in points[:60]]
    roots = np.array([f[0] for f in frames])
    np.testing.assert_allclose(roots, found.motion.root_positions_world, atol=1e-9)


def test_online_is_causal(take):
    skeleton, rigging, _, points, fps = take
    changed = points[:80].copy()
    changed[50:] += 0.3
    one, other = (fit_online(skeleton, p, fps, rigging, SkeletonFitOptions(sigma=0.01)) for p in (points[:80], changed))
    np.testing.assert_array_equal(one.angles[:50], other.angles[:50])


def test_gaps_and_empty_frames(take):
    skeleton, rigging, truth, points, fps = take
    holed = points[:300].copy()
    holed[:5] = np.nan
    holed[100:112] = np.nan
    holed[200:240, :7] = np.nan
    for fit in (fit_online, fit_take):
        found = fit(skeleton, holed, fps, rigging)
        assert np.isfinite(found.landmarks_world).all() and len(found.motion) == 300
    assert rmse(found.landmarks_world[100:112], truth[100:112]) < 0.05
    one = fit_take(skeleton, points[:1], fps, rigging)
    assert rmse(one.landmarks_world, truth[:1]) < 0.025
    with pytest.raises(MuybridgeError, match="no frame has three"):
        fit_take(skeleton, np.full_like(points, np.nan), fps, rigging)
    with pytest.raises(ValueError, match="points_world must be"):
        fit_take(skeleton, points[:, :4], fps, rigging)


def test_lengths_are_found(take):
    skeleton, rigging, truth, points, fps = take
    rng = np.random.default_rng(3)
    wrong = replace(skeleton, offsets=skeleton.offsets * rng.uniform(0.85, 1.15, (len(skeleton), 1)) * 0.8)
    found, rigged = calibrate_skeleton(wrong, points, fps, rigging)
    limbs = [skeleton.index(f"{s}{n}") for s in ("Left", "Right") for n in ("Leg", "Foot", "ForeArm", "Hand")]
    np.testing.assert_allclose(found.bone_lengths[limbs], skeleton.bone_lengths[limbs], atol=0.012)
    fit = fit_take(found, points, fps, rigged)
    assert rmse(fit.landmarks_world, truth) <= 0.65 * rmse(points, truth)
