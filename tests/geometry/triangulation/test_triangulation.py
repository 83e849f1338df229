"""Triangulation: exact on clean views, robust on bad ones, with realistic covariances."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import TriangulateOptions, take_noise, triangulate, usable_points
from muybridge.geometry.triangulation.validation import leave_one_out_error, leave_one_out_summary
from tests.paths import DATA
from tests.rigs import ring_of_cameras


def ring(count: int, radius: float = 4.0, height: float = 1.5) -> CameraGroup:
    return ring_of_cameras(
        [f"cam{c}" for c in range(count)],
        radius=radius,
        height=height,
        first=0.2,
        size=(1280, 960),
        model="OPENCV",
        params=(1200.0, 1210.0, 639.5, 479.5, -0.1, 0.05, 0.001, -0.0005),
    )


def cloud(frames: int, landmarks: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 1.9], (frames, landmarks, 3))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 6))
def test_exact_views_give_the_exact_point(seed: int, count: int) -> None:
    cameras, truth = ring(count), cloud(3, 4, seed)
    # Two cameras of a ring face each other, and a point between them has no depth.
    cameras = cameras if count > 2 else CameraGroup(ring(3).cameras[:2])
    px = cameras.project(truth)
    result = triangulate(cameras, px, np.full(px.shape[:-1], 4.0))
    np.testing.assert_allclose(result.points_world, truth, atol=1e-6)
    assert result.inlier.all()
    assert np.nanmax(result.residual_px) < 1e-3


@pytest.mark.parametrize("count", [4, 8])
def test_one_bad_camera_is_rejected(count: int) -> None:
    cameras, truth = ring(count), cloud(60, 10)
    rng = np.random.default_rng(1)
    px = cameras.project(truth) + rng.normal(0, 2, (count, 60, 10, 2))
    bad = rng.integers(0, count, (60, 10))
    is_bad = np.arange(count)[:, None, None] == bad
    shift = rng.uniform(60, 300, (60, 10, 1)) * np.array([0.6, -0.8])
    px = np.where(is_bad[..., None], px + shift, px)
    result = triangulate(cameras, px, np.full(px.shape[:-1], 4.0))
    error = np.linalg.norm(result.points_world - truth, axis=-1)
    assert np.median(error) < 0.010
    assert np.quantile(error, 0.98) < 0.040
    # An error along the epipolar line of most others can hide; nearly all cannot.
    assert (result.inlier == ~is_bad).mean() > 0.97


def test_variance_weights_the_cameras() -> None:
    cameras, truth = ring(4), cloud(200, 10)
    rng = np.random.default_rng(2)
    sigma = np.array([1.0, 1.0, 15.0, 15.0])[:, None, None]
    px = cameras.project(truth) + rng.normal(size=(4, 200, 10, 2)) * sigma[..., None]
    weighted = triangulate(cameras, px, np.broadcast_to(sigma**2, px.shape[:-1]))
    unweighted = triangulate(cameras, px, np.full(px.shape[:-1], 9.0))

    def rms(result: object) -> float:
        return float(np.sqrt(np.nanmean((result.points_world - truth) ** 2)))  # type: ignore[attr-defined]

    assert rms(weighted) < 0.004 < rms(unweighted)


def test_covariance_predicts_the_error() -> None:
    cameras, truth = ring(4), cloud(200, 10)
    rng = np.random.default_rng(3)
    px = cameras.project(truth) + rng.normal(0, 3, (4, 200, 10, 2))
    result = triangulate(cameras, px, np.full(px.shape[:-1], 1.0))
    miss = result.points_world - truth
    squared = np.einsum("tji,tjik,tjk->tj", miss, np.linalg.inv(result.covariance_world), miss)
    # The median of a chi-squared of three degrees of freedom is 2.37.
    assert 1.9 < np.median(squared) < 2.9


def test_precision_at_the_edge_of_a_wide_lens() -> None:
    wide = []
    for camera in ring(4, radius=3.0):
        # Turned aside by 50 degrees: the subject is near the edge of a fisheye's image.
        cos, sin = np.cos(np.radians(50)), np.sin(np.radians(50))
        turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
        pose = turn @ camera.cam_from_world
        lens = (400.0, 400.0, 639.5, 479.5, 0.02, -0.005, 0.0, 0.0)
        wide.append(Camera(camera.name, "OPENCV_FISHEYE", 1280, 960, lens, pose))
    cameras, truth = CameraGroup(tuple(wide)), cloud(200, 10)
    px = cameras.project(truth) + np.random.default_rng(6).normal(0, 1, (4, 200, 10, 2))
    result = triangulate(cameras, px, np.ones(px.shape[:-1]), TriangulateOptions(noise_px=0.0))
    miss = result.points_world - truth
    squared = np.einsum("tji,tjik,tjk->tj", miss, np.linalg.inv(result.covariance_world), miss)
    assert np.isfinite(result.points_world).all()
    # 2.37 if pixels were square there too; the focal length of the image's middle would give 11.
    assert 1.6 < np.median(squared) < 4.5


def test_noise_of_the_take_is_estimated_and_can_be_given() -> None:
    cameras, truth = ring(4), cloud(100, 10)
    px = cameras.project(truth) + np.random.default_rng(4).normal(0, 5, (4, 100, 10, 2))
    noise_px, scale = take_noise(cameras, px, np.full(px.shape[:-1], 1.0))
    assert noise_px == pytest.approx(np.sqrt(24), rel=0.1) and scale == 1.0
    noise_px, scale = take_noise(cameras, px, np.full(px.shape[:-1], 100.0))
    assert noise_px == 0.0 and scale == pytest.approx(0.25, rel=0.2)
    given_noise = triangulate(cameras, px, np.full(px.shape[:-1], 1.0), TriangulateOptions(noise_px=7.0))
    assert given_noise.noise_px == 7.0


def test_missing_views_and_frames() -> None:
    cameras, truth = ring(4), cloud(5, 6)
    px = cameras.project(truth)
    variance = np.full(px.shape[:-1], 4.0)
    px[:, 0] = np.nan  # an empty frame
    px[1:, 1] = np.nan  # one camera alone
    variance[2:, 2] = np.nan  # two cameras
    px[3, :] = np.nan  # a dead camera
    result = triangulate(cameras, px, variance)
    assert np.isnan(result.points_world[:2]).all() and np.isnan(result.covariance_world[:2]).all()
    np.testing.assert_allclose(result.points_world[2:], truth[2:], atol=1e-6)
    assert not result.inlier[3].any() and not result.inlier[2:, 2].any()
    assert np.isnan(result.residual_px[3]).all() and np.isnan(result.residual_px[:, :2]).all()
    three = triangulate(cameras, px, variance, TriangulateOptions(min_views=3))
    assert np.isnan(three.points_world[2]).all() and np.isfinite(three.points_world[3:]).all()


def test_empty_takes_and_single_frames() -> None:
    cameras = ring(3)
    px = np.full((3, 4, 5, 2), np.nan)
    result = triangulate(cameras, px, np.full((3, 4, 5), np.nan))
    assert np.isnan(result.points_world).all() and not result.inlier.any()
    assert np.isnan(leave_one_out_error(cameras, px, np.full((3, 4, 5), np.nan))).all()
    truth = cloud(1, 1)
    one = triangulate(cameras, cameras.project(truth), np.ones((3, 1, 1)))
    np.testing.assert_allclose(one.points_world, truth, atol=1e-6)
    empty = triangulate(cameras, np.empty((3, 0, 5, 2)), np.empty((3, 0, 5)))
    assert empty.points_world.shape == (0, 5, 3)


def test_views_that_do_not_agree_give_nan() -> None:
    cameras = CameraGroup(ring(3).cameras[:2])
    truth = cloud(20, 5)
    px = cameras.project(truth)
    px[1, ..., 1] += 150.0  # across the epipolar lines
    options = TriangulateOptions(noise_px=3.0)
    assert np.isnan(triangulate(cameras, px, np.full(px.shape[:-1], 9.0), options).points_world).all()
    px[1, ..., 1] -= 145.0
    assert np.isfinite(triangulate(cameras, px, np.full(px.shape[:-1], 9.0), options).points_world).all()


def test_parallel_rays_and_points_behind_give_nan() -> None:
    first = ring(4).cameras[0]
    beside = first.posed(first.cam_from_world + np.array([[0, 0, 0, 0.05], [0] * 4, [0] * 4])).renamed("b")
    truth = cloud(10, 5)
    narrow = CameraGroup((first, beside))
    px = narrow.project(truth)
    assert np.isnan(triangulate(narrow, px, np.ones(px.shape[:-1])).points_world).all()
    # Two cameras back to back: their rays meet behind both.
    away = np.diag([-1.0, 1.0, -1.0]) @ first.cam_from_world
    behind = CameraGroup((first.posed(away).renamed("a"), ring(3).cameras[1]))
    seen = np.stack([first.project(truth), ring(3).cameras[1].project(truth)])
    assert np.isnan(triangulate(behind, seen, np.ones(seen.shape[:-1])).points_world).all()


def test_invalid_inputs() -> None:
    cameras = ring(3)
    px = cameras.project(cloud(2, 2))
    with pytest.raises(ValueError, match=r"must be \(3, T, J, 2\)"):
        triangulate(cameras, px[:2], np.ones((2, 2, 2)))
    with pytest.raises(ValueError, match="variance_px2 must be"):
        triangulate(cameras, px, np.ones((3, 2)))
    variance = np.ones((3, 2, 2))
    variance[1, 0, 1] = 0.0
    with pytest.raises(ValueError, match="cam1, frame 0, landmark 1"):
        triangulate(cameras, px, variance)
    with pytest.raises(ValueError, match="min_views"):
        triangulate(cameras, px, np.ones((3, 2, 2)), TriangulateOptions(min_views=1))


def test_leave_one_out_reveals_errors_that_residuals_hide() -> None:
    cameras, truth = ring(4), cloud(50, 8)
    rng = np.random.default_rng(5)
    px = cameras.project(truth) + rng.normal(0, 2, (4, 50, 8, 2))
    px[2] += [25.0, 0.0]  # a camera that is calibrated wrongly
    variance = np.full(px.shape[:-1], 4.0)
    error = leave_one_out_error(cameras, px, variance)
    summary = leave_one_out_summary(error, usable_points(px, variance))
    assert np.argmax(summary.camera_median_px) == 2
    assert summary.camera_median_px[2] == pytest.approx(25, abs=4)
    # It depends on the other cameras only: moving a camera's own point changes its error by as much.
    moved = px.copy()
    moved[0, :, 3] += [40.0, 0.0]
    after = leave_one_out_error(cameras, moved, variance, TriangulateOptions(noise_px=3.0))
    others = CameraGroup(cameras.cameras[1:])
    by_others = triangulate(others, px[1:], variance[1:], TriangulateOptions(noise_px=3.0)).points_world
    expected = np.linalg.norm(cameras[0].project(by_others) - moved[0], axis=-1)
    np.testing.assert_allclose(after[0], expected, atol=0.1)


def test_leave_one_out_counts_missing_points() -> None:
    cameras, truth = CameraGroup(ring(3).cameras[:2]), cloud(4, 3)
    px = cameras.project(truth)
    variance = np.ones(px.shape[:-1])
    error = leave_one_out_error(cameras, px, variance)
    summary = leave_one_out_summary(error, usable_points(px, variance))
    assert np.isnan(error).all() and np.isnan(summary.median_px)
    assert summary.no_point_share == 1.0


def case() -> tuple[CameraGroup, FloatArray, FloatArray]:
    path = DATA / "triangulation_case.npz"
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    data = np.load(path)
    cameras = []
    for c in range(4):
        matrix = data["camera_matrix"][c]
        rotation, _ = cv2.Rodrigues(data["rotvec_cam_from_world"][c])
        pose = np.hstack([rotation, data["translation_cam_from_world"][c][:, None]])
        lens = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *data["distortion_k1k2p1p2"][c])
        width, height = data["size_px"][c]
        cameras.append(Camera(f"cam{c}", "OPENCV", int(width), int(height), lens, pose))
    return CameraGroup(tuple(cameras)), data["points_px"].astype(float), data["truth_world"].astype(float)


@pytest.mark.parametrize("stated_px2", [9.0, 1.0, 100.0])
def test_real_rig_with_outliers(stated_px2: float) -> None:
    cameras, px, truth = case()
    result = triangulate(cameras, px, np.full(px.shape[:-1], stated_px2))
    error_mm = 1000 * np.linalg.norm(result.points_world - truth, axis=-1)
    assert np.isfinite(error_mm).mean() > 0.999
    assert np.nanmedian(error_mm) < 6.8
    assert np.sqrt(np.nanmean(error_mm**2)) < 12.0


def test_reference_keypoints_of_the_balancing_take() -> None:
    folder = DATA / "balancing"
    if not folder.exists():
        pytest.skip("balancing is not here")
    cameras = load_calibration(folder / "calibration" / "Calib.qca.txt")
    data = np.load(folder / "reference" / "openpose_body25b.npz")
    seen = data["keypoints2d_px"].astype(float)
    px = np.where(seen[..., 2:] > 0.05, seen[..., :2], np.nan)
    variance = np.full(px.shape[:-1], 9.0)
    result = triangulate(cameras, px, variance)
    away_mm = 1000 * np.linalg.norm(result.points_world - data["points3d_world"], axis=-1)
    assert np.isfinite(result.points_world).all(axis=-1).mean() > 0.99
    assert np.nanmedian(away_mm) < 20 and np.nanquantile(away_mm, 0.95) < 100
    summary = leave_one_out_summary(leave_one_out_error(cameras, px, variance), usable_points(px, variance))
    assert summary.median_px < 24 and summary.no_point_share < 0.03
    # Most of it is the calibration's, and the noise found in the take says so.
    assert 8 < result.noise_px < 20


def test_a_ten_thousandth_of_a_pixel_does_not_move_a_point() -> None:
    cameras = ring(4)
    rng = np.random.default_rng(3)
    px = cameras.project(cloud(400, 10)) + rng.normal(0, 3, (4, 400, 10, 2))
    # Views at the limit between right and wrong, where the loss is flattest and the search takes longest.
    px[0] += rng.uniform(5, 40, (400, 10, 1)) * [0.6, 0.8]
    variance = np.full(px.shape[:-1], 9.0)
    options = TriangulateOptions(noise_px=1.0)
    one, two = (
        triangulate(cameras, moved, variance, options).points_world
        for moved in (px, px + rng.normal(0, 1e-4, px.shape))
    )
    away = np.linalg.norm(one - two, axis=-1)
    assert np.isfinite(away).all()
    # Where the search ended a step early, it was 7 and 68 micrometres.
    assert np.quantile(away, 0.999) < 4e-6 and away.max() < 3e-5
