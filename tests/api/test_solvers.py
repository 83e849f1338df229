"""Triangulation, smoothing, body fitting and inverse kinematics on synthetic data whose answer is known."""

from pathlib import Path

import numpy as np
import pytest

import muybridge
from muybridge.geometry.fitting.body_fit import landmarks_from_motion
from muybridge.geometry.skeleton.body import BODY, prior_shape
from tests.rigs import ring_of_cameras
from tests.staged_people import person

FPS = 30.0


@pytest.fixture(scope="module")
def cameras() -> muybridge.CameraGroup:
    return ring_of_cameras(5, size=(1280, 960))


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    """(60, 23, 3) metres."""
    return person(60, FPS)


def test_triangulate_undoes_projection(cameras: muybridge.CameraGroup, truth: np.ndarray) -> None:
    points = muybridge.triangulate(cameras, cameras.project(truth), fps=FPS)
    np.testing.assert_allclose(points.points_world, truth, atol=1e-5)
    assert points.landmarks == muybridge.BODY23 and points.fps == FPS and points.inlier.all()


def test_triangulate_is_robust_and_knows_how_sure_it_is(cameras: muybridge.CameraGroup, truth: np.ndarray) -> None:
    rng = np.random.default_rng(1)
    px = cameras.project(truth) + rng.normal(0, 2.0, (5, *truth.shape[:2], 2))
    px[1, ::7] += 90  # a camera that is far off now and then
    px[3, 5:15, :4] = np.nan
    points = muybridge.triangulate(cameras, px, fps=FPS, sd_px=2.0)
    error = points.points_world - truth
    assert np.linalg.norm(error, axis=-1).mean() < 0.012
    assert not points.inlier[1, ::7].any() and points.inlier[1, 1::7].mean() > 0.95
    # Squared errors in their own standard deviations have mean 3.
    whitened = np.einsum("tji,tjik,tjk->tj", error, np.linalg.inv(points.covariance_world), error)
    assert 2.0 < whitened.mean() < 4.5


def test_triangulate_takes_names_and_says_what_does_not_fit(cameras: muybridge.CameraGroup, truth: np.ndarray) -> None:
    px = cameras.project(truth[:, :2])
    assert muybridge.triangulate(cameras, px, ["hip", "knee"], fps=FPS).landmarks.names == ("hip", "knee")
    with pytest.raises(ValueError, match=r"must be \(5, T, 23, 2\).*not \(5, 60, 2, 2\)"):
        muybridge.triangulate(cameras, px, fps=FPS)
    with pytest.raises(ValueError, match="names repeat: hip"):
        muybridge.triangulate(cameras, px, ["hip", "hip"], fps=FPS)
    with pytest.raises(ValueError, match="variance_px2 must be positive"):
        muybridge.triangulate(cameras, px, ["hip", "knee"], fps=FPS, sd_px=0.0)
    with pytest.raises(ValueError, match="fps is 0"):
        muybridge.triangulate(cameras, px, ["hip", "knee"], fps=0)


def test_smooth_removes_noise_and_fills_a_gap(truth: np.ndarray) -> None:
    noisy = truth + np.random.default_rng(2).normal(0, 0.01, truth.shape)
    noisy[20:24, 9] = np.nan
    covariance = np.broadcast_to(1e-4 * np.eye(3), (*truth.shape, 3))
    smoothed = muybridge.smooth(muybridge.make_points(noisy, fps=FPS, covariance_world=covariance))
    error = np.linalg.norm(smoothed.points_world - truth, axis=-1)
    assert error.mean() < 0.6 * np.nanmean(np.linalg.norm(noisy - truth, axis=-1))
    assert error[20:24, 9].max() < 0.05
    short = muybridge.smooth(muybridge.make_points(noisy, fps=FPS), muybridge.SmoothOptions(max_gap=0.05))
    assert np.isnan(short.points_world[21, 9]).all()
    with pytest.raises(muybridge.MuybridgeError, match="15 Hz"):
        options = muybridge.SmoothOptions(method="butterworth", cutoff_hz=15)
        muybridge.smooth(muybridge.make_points(noisy, fps=FPS), options)


def test_make_points_says_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match=r"\(T, 23, 3\).*not \(4, 3, 3\)"):
        muybridge.make_points(np.zeros((4, 3, 3)), fps=FPS)
    with pytest.raises(ValueError, match=r"covariance_world must be \(4, 1, 3, 3\)"):
        muybridge.make_points(np.zeros((4, 1, 3)), ["hip"], fps=FPS, covariance_world=np.eye(3))


def test_fit_body_recovers_bones_and_motion() -> None:
    """Landmarks of a body of known size in a known motion."""
    shape = prior_shape(1.80)
    skeleton = BODY.skeleton(shape)
    angles = np.zeros((40, len(skeleton), 3))
    elbow = skeleton.index("left_forearm") if "left_forearm" in skeleton.names else len(skeleton) - 1
    low, high = np.clip(skeleton.lower[elbow], -1, 0), np.clip(skeleton.upper[elbow], 0, 1)
    angles[:, elbow] = np.linspace(0, 0.8, 40)[:, None] * np.where(high > 0.1, high, low)
    rotations = skeleton.rotations_from_angles(angles)
    turns, places = skeleton.forward(np.tile([0.0, 0.0, 1.0], (40, 1)), rotations)
    offsets = BODY.landmark_offsets(shape)
    joints = BODY.landmark_joints
    landmarks = places[:, joints] + np.einsum("tjab,jb->tja", turns[:, joints], offsets)
    points = muybridge.make_points(landmarks, BODY.landmark_names, fps=FPS)
    fit = muybridge.fit_body(points)
    assert fit.body.stature_m == pytest.approx(1.80, abs=0.02)
    assert np.nanmean(np.linalg.norm(fit.motion.joint_positions_world() - places, axis=-1)) < 0.01
    np.testing.assert_allclose(fit.motion.skeleton.bone_lengths, skeleton.bone_lengths, atol=0.02)
    again = landmarks_from_motion(fit.motion, fit.body, points.landmarks)
    assert np.nanmean(np.linalg.norm(again - landmarks, axis=-1)) < 0.01


def test_fit_body_without_a_trunk_is_an_error(truth: np.ndarray) -> None:
    wrist = [muybridge.BODY23.index("left_wrist")]
    with pytest.raises(muybridge.MuybridgeError):
        muybridge.fit_body(muybridge.make_points(truth[:, wrist], ["left_wrist"], fps=FPS))


@pytest.mark.parametrize("method", ["transpose", "pseudo_inverse", "damped", "null_space", "ccd", "fabrik"])
def test_solve_ik_reaches_what_forward_kinematics_gave(method: str) -> None:
    arm = muybridge.chain_of_balls([0.3, 0.25, 0.1], limit=1.5)
    wanted = np.random.default_rng(3).uniform(-0.6, 0.6, len(arm))
    turns, places = arm.forward(wanted)
    offset = np.array([0.0, 0.0, 0.1])
    hand = muybridge.Goal(joint=len(arm) - 1, offset=offset, position=places[-1] + turns[-1] @ offset)
    found = muybridge.solve_ik(arm, [hand], method=method)
    turns, places = arm.forward(found.theta)
    assert found.success
    assert np.linalg.norm(places[-1] + turns[-1] @ offset - hand.position) < 1e-3
    assert (np.abs(found.theta) <= 1.5).all()


def test_solve_ik_names_the_methods() -> None:
    arm = muybridge.chain_of_balls([0.3])
    with pytest.raises(ValueError, match="damped.*fabrik"):
        muybridge.solve_ik(arm, [muybridge.Goal(2, np.zeros(3), np.zeros(3))], method="magic")


def test_points_and_cameras_survive_files(cameras: muybridge.CameraGroup, truth: np.ndarray, tmp_path: Path) -> None:
    muybridge.save_calibration(tmp_path / "calibration.toml", cameras)
    assert muybridge.load_calibration(tmp_path / "calibration.toml") == cameras
    muybridge.write_points(tmp_path / "take.npz", muybridge.make_points(truth, fps=FPS))
    np.testing.assert_allclose(muybridge.read_points(tmp_path / "take.npz").points_world, truth, atol=1e-6)


def test_reading_says_what_callers_can_do(truth: np.ndarray, tmp_path: Path) -> None:
    points = muybridge.make_points(truth, fps=FPS)
    muybridge.write_points(tmp_path / "take.trc", points)
    with pytest.raises(muybridge.FormatError, match="fit_body") as read:
        muybridge.read_motion(tmp_path / "take.trc")
    with pytest.raises(muybridge.FormatError, match="fit") as write:
        muybridge.write_points(tmp_path / "take.bvh", points)
    (tmp_path / "take.csv").write_text("hip_x,hip_y,hip_z\n1,2,3\n1,2,3\n")
    with pytest.raises(muybridge.FormatError) as rate:
        muybridge.read_points(tmp_path / "take.csv")
    with pytest.raises(muybridge.FormatError) as option:
        muybridge.read_motion(tmp_path / "take.trc", asf=tmp_path / "no.asf")
    with pytest.raises(muybridge.CalibrationError) as calibration:
        muybridge.load_calibration(tmp_path / "no.toml")
    for error in (read, write, rate, option, calibration):
        assert "--" not in str(error.value) and "`muybridge " not in str(error.value), str(error.value)
