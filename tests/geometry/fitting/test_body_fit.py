"""Fitting a body: Jacobian, exactness on clean data, robustness on bad data, the real take."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting.body_fit import FitOptions, fit_body, fit_motion, landmarks_from_motion
from muybridge.geometry.fitting.gauss_newton import Pose, Problem, cost, jacobian, moved, solve, solve_in_stretches
from muybridge.geometry.fitting.initial_pose import start_pose
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, Body, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from tests.paths import REPOSITORY

SHARED = REPOSITORY.parent / "shared"
REFERENCE = SHARED / "data" / "balancing" / "reference" / "openpose_body25b.npz"


def as_points(xyz: np.ndarray, fps: float = 60.0, sigma: float | None = None) -> Points3D:
    t, j = xyz.shape[:2]
    covariance = np.full((t, j, 3, 3), np.nan) if sigma is None else np.tile(np.eye(3) * sigma**2, (t, j, 1, 1))
    return Points3D(BODY23, xyz, covariance, np.empty((0, t, j)), np.empty((0, t, j), bool), fps)


def synthetic_motion(frames: int = 120, fps: float = 60.0, stature: float = 1.82, seed: int = 0):
    """Smooth random motion of a known body within its limits, turning round once and walking off."""
    rng = np.random.default_rng(seed)
    shape = prior_shape(stature)
    time = np.arange(frames) / fps
    low = np.maximum(BODY.lower, BODY.rest - BODY.spread)
    high = np.minimum(BODY.upper, BODY.rest + BODY.spread)
    low[0] = high[0] = 0.0
    phase, rate = rng.uniform(0, 2 * np.pi, low.shape), rng.uniform(1.5, 4.0, low.shape)
    wave = 0.5 + 0.5 * np.sin(phase + rate * time[:, None, None])
    angles = low + (high - low) * wave
    skeleton = BODY.skeleton(shape)
    rotations = skeleton.rotations_from_angles(angles)
    yaw = np.stack([0.2 * np.sin(time), 0.2 * np.cos(time), 2 * np.pi * time / max(time[-1], 1)], axis=-1)
    rotations[:, 0] = exp_so3(yaw * [1, 1, 0]) @ exp_so3(yaw * [0, 0, 1])
    root = np.stack([0.8 * time, np.sin(time), 0.95 + 0.05 * np.sin(5 * time)], axis=-1)
    motion = Motion(skeleton, fps, root, quat_from_matrix(rotations))
    body = Body(skeleton, BODY.landmark_names, BODY.landmark_joints, BODY.landmark_offsets(shape), stature)
    return motion, body, landmarks_from_motion(motion, body, BODY23)


def error_mm(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a - b, axis=-1) * 1e3


def make_problem(seed: int = 0, frames: int = 5) -> tuple[Problem, Pose]:
    rng = np.random.default_rng(seed)
    shape = prior_shape(1.7)
    j = len(BODY.joint_names)
    target = rng.normal(0, 0.5, (frames, len(BODY.landmark_names), 3))
    root = rng.normal(0, 1, (frames, 3, 3))
    problem = Problem(
        BODY.skeleton(shape), BODY.landmark_joints, BODY.landmark_offsets(shape), target,
        np.einsum("...ij,...kj->...ik", root, root)[:, None].repeat(target.shape[1], 1),
        BODY.rest, np.full((j, 3), 0.3), np.full(6 + 3 * j, 2.0), np.full(6 + 3 * j, 0.7),
    )  # fmt: skip
    low, high = np.maximum(BODY.lower, -1), np.minimum(BODY.upper, 1)
    angles = rng.uniform(low, np.maximum(high, low), (frames, j, 3))
    turn = exp_so3(np.cumsum(rng.normal(0, 0.05, (frames, 3)), axis=0))
    return problem, Pose(rng.normal(0, 1, (frames, 3)), turn, angles)


def test_jacobian_by_finite_differences():
    problem, pose = make_problem()
    wide = 9.0 * (BODY.upper > BODY.lower)
    problem = replace(problem, skeleton=replace(problem.skeleton, lower=-wide, upper=wide))
    points, jac = jacobian(problem, pose)
    rng = np.random.default_rng(1)
    for _ in range(20):
        step = rng.normal(0, 1, (len(pose), jac.shape[-1]))
        ahead, _ = jacobian(problem, moved(problem, pose, 1e-6 * step))
        back, _ = jacobian(problem, moved(problem, pose, -1e-6 * step))
        np.testing.assert_allclose((ahead - back) / 2e-6, np.einsum("tlin,tn->tli", jac, step), atol=1e-6)
    assert np.isfinite(points).all()


def test_solver_goes_down_and_keeps_limits():
    problem, pose = make_problem(frames=9)
    solved = solve(problem, pose, steps=8, fixed_frames=2)
    assert cost(problem, solved) < 0.9 * cost(problem, pose)
    assert (solved.angles[:, 1:] >= problem.skeleton.lower[1:] - 1e-12).all()
    assert (solved.angles[:, 1:] <= problem.skeleton.upper[1:] + 1e-12).all()
    np.testing.assert_array_equal(solved.root[:2], pose.root[:2])
    np.testing.assert_array_equal(solved.angles[:2], pose.angles[:2])


def test_stretches_agree_with_one_solve():
    _, _, truth = synthetic_motion(160)
    problem, _ = make_problem(frames=160)
    order = [BODY23.index(n) for n in BODY.landmark_names]
    problem = replace(problem, targets=truth[:, order], information=np.tile(np.eye(3) * 1e4, (160, 23, 1, 1)))
    pose = Pose(*start_pose(BODY, prior_shape(1.7), truth[:, order]))
    whole = solve(problem, pose, 12)
    parts = solve_in_stretches(problem, pose, 12, stretch=50, overlap=20)
    assert np.abs(whole.root - parts.root).max() < 2e-3
    jump = np.linalg.norm(np.diff(parts.root, 2, axis=0), axis=1)
    assert jump.max() < 1.5 * np.linalg.norm(np.diff(whole.root, 2, axis=0), axis=1).max()


def test_clean_points_give_the_motion_back():
    motion, body, truth = synthetic_motion()
    fit = fit_body(as_points(truth))
    fitted = landmarks_from_motion(fit.motion, fit.body, BODY23)
    assert error_mm(fitted, truth).mean() < 8
    lengths = fit.motion.skeleton.bone_lengths
    seen = [i for i, n in enumerate(BODY.joint_names) if n.endswith(("forearm", "hand", "shin", "foot"))]
    np.testing.assert_allclose(lengths[seen], motion.skeleton.bone_lengths[seen], atol=0.012)
    assert fit.body.stature_m == pytest.approx(1.82, abs=0.05)


def test_bones_are_constant_and_symmetric_and_quaternions_do_not_flip():
    _, _, truth = synthetic_motion(seed=2)
    noisy = truth + np.random.default_rng(0).normal(0, 0.03, truth.shape)
    motion = fit_motion(as_points(noisy))
    at = motion.joint_positions_world()
    skeleton = motion.skeleton
    for j, parent in enumerate(skeleton.parents[1:], start=1):
        length = np.linalg.norm(at[:, j] - at[:, parent], axis=1)
        assert np.ptp(length) < 1e-9
        if skeleton.names[j].startswith("left_"):
            twin = skeleton.index("right_" + skeleton.names[j][5:])
            assert skeleton.bone_lengths[j] == pytest.approx(skeleton.bone_lengths[twin])
    np.testing.assert_allclose(np.linalg.norm(motion.quat_wxyz, axis=-1), 1, atol=1e-12)
    assert (np.sum(motion.quat_wxyz[1:] * motion.quat_wxyz[:-1], axis=-1) > 0.9).all()
    angles = skeleton.angles_from_rotations(motion.forward()[:, :1, :3, :3].repeat(len(skeleton), 1))
    assert np.isfinite(angles).all()


def test_gaps_ends_and_unseen_landmarks_leave_no_nan():
    _, _, truth = synthetic_motion(150)
    points = truth.copy()
    points[:10] = np.nan
    points[60:80] = np.nan
    points[140:] = np.nan
    points[:, [BODY23.index(n) for n in ("left_wrist", "nose", "left_eye", "right_ear", "right_heel")]] = np.nan
    points[::7, 11:] = np.nan
    motion = fit_motion(as_points(points))
    at = motion.joint_positions_world()
    assert len(motion) == 150 and np.isfinite(at).all() and np.isfinite(motion.quat_wxyz).all()
    np.testing.assert_array_equal(at[0], at[10])
    np.testing.assert_array_equal(at[149], at[139])
    hip = motion.skeleton.index("left_thigh")
    assert error_mm(at[55:85, hip], truth[55:85, BODY23.index("left_hip")]).max() < 120


def test_outliers_and_swaps_are_seen_through():
    _, _, truth = synthetic_motion(180, seed=4)
    rng = np.random.default_rng(5)
    points = truth + rng.normal(0, 0.035, truth.shape)
    out = rng.random(points.shape[:2]) < 0.06
    points[out] += rng.normal(0, 0.4, (out.sum(), 3))
    legs = [BODY23.index(f"{s}_{n}") for n in ("knee", "ankle", "heel", "big_toe") for s in ("left", "right")]
    for start in (30, 90, 140):
        twins = [BODY23.mirror[i] for i in legs]
        points[start : start + 6, legs] = points[start : start + 6, twins]
    points[rng.random(points.shape[:2]) < 0.1] = np.nan
    fit = fit_body(as_points(points, sigma=0.035))
    fitted = error_mm(landmarks_from_motion(fit.motion, fit.body, BODY23), truth)
    assert fitted.mean() < 30 and np.percentile(fitted, 99) < 110
    assert fit.weight[out & np.isfinite(points[..., 0])].mean() < 0.3 < 0.7 < fit.weight[~out].mean()


def test_covariances_are_used():
    _, _, truth = synthetic_motion(90, seed=3)
    rng = np.random.default_rng(1)
    sigma = np.where(np.arange(23) % 2, 0.01, 0.12)
    points = as_points(truth + rng.normal(0, 1, truth.shape) * sigma[:, None])
    told = np.tile(np.eye(3) * sigma[:, None, None] ** 2, (90, 1, 1, 1))
    knowing = landmarks_from_motion(*_motion_and_body(replace(points, covariance_world=told)), BODY23)
    blind = landmarks_from_motion(*_motion_and_body(points), BODY23)
    certain = sigma < 0.1
    assert error_mm(knowing, truth)[:, certain].mean() < 0.8 * error_mm(blind, truth)[:, certain].mean()


def _motion_and_body(points: Points3D):
    fit = fit_body(points)
    return fit.motion, fit.body


def test_nothing_to_fit_is_said():
    nothing = np.full((4, 23, 3), np.nan)
    with pytest.raises(MuybridgeError, match="no 3D point") as raised:
        fit_motion(as_points(nothing))
    assert "\n" not in str(raised.value)
    nothing[:, BODY23.index("nose")] = 1.0
    with pytest.raises(MuybridgeError, match="neither both hips nor both shoulders"):
        fit_motion(as_points(nothing))


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_short_takes(frames):
    _, _, truth = synthetic_motion(30)
    motion = fit_motion(as_points(truth[:frames]))
    assert len(motion) == frames and np.isfinite(motion.joint_positions_world()).all()


def test_other_landmark_sets_by_name():
    _, _, truth = synthetic_motion(40)
    names = ("right_hip", "left_hip", "tail", "left_shoulder", "right_shoulder", "left_knee")
    column = [BODY23.index(n) if n in BODY23.names else 0 for n in names]
    full = as_points(truth)
    points = replace(
        full, landmarks=LandmarkSet("few", names, ()), points_world=truth[:, column],
        covariance_world=full.covariance_world[:, column],
    )  # fmt: skip
    fit = fit_body(points)
    assert fit.residual_m.shape == (40, 6) and np.isnan(fit.residual_m[:, 2]).all()
    assert np.nanmean(fit.residual_m) < 0.02


def test_the_real_take_stands_upright_with_left_on_the_left():
    if not REFERENCE.is_file():
        pytest.skip("../shared/data is not here")
    reference = np.load(REFERENCE)
    names = [str(n) for n in reference["names"]]
    fit = fit_body(as_points(reference["points3d_world"][:, [names.index(n) for n in BODY23.names]]))
    world = fit.motion.forward()
    joint = fit.motion.skeleton.index
    assert np.nanmean(fit.residual_m) < 0.03 and np.nanmedian(fit.residual_m) < 0.02
    assert (world[:, 0, 2, 2] > 0.4).all(), "the trunk points up, though he bows"
    assert world[:, 0, 2, 2].mean() > 0.8
    assert (world[:, joint("head"), 2, 3] > world[:, 0, 2, 3]).all()
    left, right = (reference["points3d_world"][:, names.index(n)] for n in ("left_hip", "right_hip"))
    hips = world[:, joint("left_thigh"), :3, 3] - world[:, joint("right_thigh"), :3, 3]
    assert (np.sum(hips * (left - right), axis=1) > 0).all()
    acceleration = np.linalg.norm(np.diff(fit.motion.joint_positions_world(), 2, axis=0), axis=-1) * 60**2
    assert np.median(acceleration) < 10, "metres per second squared: a man who balances"
    assert 1.55 < fit.body.stature_m < 1.9


def test_options_matter():
    _, _, truth = synthetic_motion(60)
    noisy = as_points(truth + np.random.default_rng(0).normal(0, 0.05, truth.shape))
    stiff = fit_motion(noisy, FitOptions(angular_acceleration=10, root_acceleration=2))
    loose = fit_motion(noisy, FitOptions(angular_acceleration=1000, root_acceleration=200))
    shake = [np.linalg.norm(np.diff(m.joint_positions_world(), 2, axis=0)) for m in (stiff, loose)]
    assert shake[0] < 0.5 * shake[1]
