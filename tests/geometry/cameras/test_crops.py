"""Crops: the homography is the virtual camera's, and pixels follow it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.crops import crops_for_boxes, virtual_views
from muybridge.infer.detection.crop_pixels import extract_crops, scaled_down
from muybridge.infer.session.frame_copies import halved
from tests.rigs import look_at


def _camera(roll: float = 0.0, model: str = "PINHOLE", extra: tuple[float, ...] = ()) -> Camera:
    pose = look_at((3.0, -4.0, 2.5), (0.3, 0.2, 1.0), roll=roll)
    return Camera("c", model, 1280, 960, (900.0, 910.0, 637.2, 481.9, *extra), pose)


def _person_box(camera: Camera, at: FloatArray) -> FloatArray:
    corners = at + np.array([[x, y, z] for x in (-0.4, 0.4) for y in (-0.2, 0.2) for z in (0.0, 1.8)])
    px = camera.project(corners)
    return np.concatenate([px.min(axis=0), px.max(axis=0)])[None]


@settings(max_examples=30, deadline=None)
@given(
    roll=st.floats(-3.1, 3.1),
    x=st.floats(-1.2, 1.2),
    y=st.floats(-1.0, 1.5),
    size=st.sampled_from([96, 128, 256]),
)
def test_crop_of_a_pinhole_is_the_virtual_cameras_image(roll: float, x: float, y: float, size: int) -> None:
    camera = _camera(roll)
    at = np.array([x, y, 0.0])
    box = _person_box(camera, at)
    crops = crops_for_boxes(box, size, camera)
    points_world = at + np.random.default_rng(0).uniform([-0.4, -0.4, 0], [0.4, 0.4, 1.8], (20, 3))
    views = virtual_views(box, camera)
    rays = (points_world - camera.center_world) @ views.virtual_from_world[0].T
    expected = rays[:, :2] / rays[:, 2:] * size / (2 * views.half_extent[0]) + (size - 1) / 2
    np.testing.assert_allclose(crops.to_crop(camera.project(points_world)[None])[0], expected, atol=1e-6)


def test_world_up_is_up_in_the_crop_whatever_the_cameras_roll() -> None:
    at = np.array([0.4, 0.1, 0.0])
    pole = np.array([[0.4, 0.1, 0.0], [0.4, 0.1, 1.8]])
    for roll in (0.0, 0.5, np.pi / 2, np.pi):
        camera = _camera(roll)
        foot, head = crops_for_boxes(_person_box(camera, at), 128, camera).to_crop(camera.project(pole)[None])[0]
        assert abs(head[0] - foot[0]) < 3 and foot[1] - head[1] > 60


def test_box_fills_the_crop_up_to_the_padding() -> None:
    camera = _camera()
    box = _person_box(camera, np.array([0.3, 0.2, 0.0]))
    for crops in (crops_for_boxes(box, 128, camera), crops_for_boxes(box, 128)):
        middle_x = (box[0, 0] + box[0, 2]) / 2
        top, bottom = crops.to_crop(np.array([[[middle_x, box[0, 1]], [middle_x, box[0, 3]]]]))[0]
        assert bottom[1] - top[1] == pytest.approx(128 / 1.25, rel=0.02)
        assert (top[1] + bottom[1]) / 2 == pytest.approx(63.5, abs=3)


def test_looking_straight_down_takes_the_cameras_own_up() -> None:
    rotation = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    camera = Camera("c", "PINHOLE", 640, 480, (500.0, 500.0, 320.0, 240.0), np.column_stack([rotation, [0, 0, 4.0]]))
    box = [[290.0, 210, 350, 270]]
    virtual, square = crops_for_boxes(box, 64, camera), crops_for_boxes(box, 64)
    np.testing.assert_allclose(virtual.crop_from_image, square.crop_from_image, atol=1e-9)


@pytest.mark.parametrize(
    ("model", "extra"),
    [("OPENCV", (-0.25, 0.08, 0.001, -0.001)), ("OPENCV_FISHEYE", (-0.02, 0.004, 0.0, 0.0))],
)
def test_lens_distortion_is_small_within_a_crop(model: str, extra: tuple[float, ...]) -> None:
    camera = _camera(0.2, model, extra)
    at = np.array([-0.9, 0.6, 0.0])
    box = _person_box(camera, at)
    crops, views = crops_for_boxes(box, 128, camera), virtual_views(box, camera)
    points_world = at + np.random.default_rng(0).uniform([-0.3, -0.2, 0], [0.3, 0.2, 1.8], (50, 3))
    rays = (points_world - camera.center_world) @ views.virtual_from_world[0].T
    expected = rays[:, :2] / rays[:, 2:] * 128 / (2 * views.half_extent[0]) + 63.5
    assert np.abs(crops.to_crop(camera.project(points_world)[None])[0] - expected).max() < 2.0


def test_points_and_variances_round_trip() -> None:
    rng = np.random.default_rng(1)
    camera = _camera(0.7)
    boxes = np.concatenate([_person_box(camera, np.array([x, 0.2, 0.0])) for x in (-1.0, 0.0, 1.0)])
    crops = crops_for_boxes(boxes, 128, camera)
    points = rng.uniform(0, 128, (3, 10, 2))
    points[1, 2] = np.nan
    variance = rng.uniform(0.5, 9, (3, 10))
    image = crops.to_image(points)
    np.testing.assert_allclose(crops.to_crop(image), points, atol=1e-8)
    variance_px2 = crops.variance_to_image(points, variance)
    variance[1, 2] = np.nan
    np.testing.assert_allclose(crops.variance_to_crop(image, variance_px2), variance, rtol=1e-9)
    # Against finite differences: an isotropic cloud of that variance, mapped.
    cloud = points[:1, :1] + rng.normal(0, 0.1, (1, 20000, 2))
    spread = crops.select([0]).to_image(cloud)[0].var(axis=0).mean()
    assert crops.variance_to_image(points[:1, :1], np.full((1, 1), 0.01))[0, 0] == pytest.approx(spread, rel=0.05)


def test_useless_boxes_are_refused() -> None:
    for box in ([0.0, 0, 0, 10], [5.0, 0, 1, 10], [np.nan, 0, 1, 1]):
        with pytest.raises(ValueError, match="boxes must be finite"):
            crops_for_boxes([box], 128)
    assert len(crops_for_boxes(np.empty((0, 4)), 128, _camera())) == 0


def _blob_image(height: int, width: int, centers: FloatArray, sigma: float) -> ByteArray:
    y, x = np.mgrid[:height, :width]
    image = np.zeros((height, width))
    for cx, cy in centers:
        image += 250 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * sigma**2))
    return np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def _centroids(crop: ByteArray, near: FloatArray, radius: float) -> FloatArray:
    y, x = np.mgrid[: crop.shape[0], : crop.shape[1]]
    found = []
    for cx, cy in near:
        weight = crop[..., 0] * ((x - cx) ** 2 + (y - cy) ** 2 < radius**2).astype(float)
        found.append([(weight * x).sum() / weight.sum(), (weight * y).sum() / weight.sum()])
    return np.array(found)


@pytest.mark.parametrize("side", [90.0, 128.0, 205.0, 330.0, 512.0, 777.0, 1901.0])
@pytest.mark.parametrize("calibrated", [False, True])
def test_pixels_lie_where_the_homography_says(side: float, calibrated: bool) -> None:
    lens = (2400.0, 2410.0, 1260.0, 970.0)
    camera = Camera("c", "PINHOLE", 2481, 1961, lens, _camera(0.3).cam_from_world) if calibrated else None
    center = np.array([1240.3, 980.8])
    box = np.concatenate([center - side / 2.5, center + side / 2.5])[None]
    crops = crops_for_boxes(box, 128, camera)
    wanted = np.array([[40.0, 35.0], [90.2, 50.7], [63.5, 63.5], [34.1, 95.6], [97.0, 96.3]])
    centers = crops.to_image(wanted[None])[0]
    frame = _blob_image(1961, 2481, centers, sigma=2.5 * max(side / 128, 0.8))
    crop = extract_crops(frame, crops)[0]
    assert np.abs(_centroids(crop, wanted, 11) - wanted).max() < 0.1
    half = halved(frame[:1960, :2480])
    for crop in (extract_crops(frame, crops, half)[0], extract_crops(half, scaled_down(crops, 2))[0]):
        assert np.abs(_centroids(crop, wanted, 11) - wanted).max() < 0.1


def test_fine_patterns_average_to_grey() -> None:
    frame = np.zeros((1000, 1000, 3), dtype=np.uint8)
    frame[:, ::2] = 200
    crop = extract_crops(frame, crops_for_boxes([[100.0, 100, 900, 900]], 128))[0]
    assert np.abs(crop[2:-2, 2:-2].astype(float) - 100).max() <= 8


def test_black_outside_the_image_and_behind_the_camera() -> None:
    frame = np.full((480, 640, 3), 200, dtype=np.uint8)
    crop = extract_crops(frame, crops_for_boxes([[-200.0, 100, 100, 400]], 64))[0]
    assert crop[32, 2].tolist() == [0, 0, 0] and crop[32, 60].tolist() == [200, 200, 200]
    pose = np.column_stack([np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), [0, 0, 0.0]])
    wide = Camera("c", "PINHOLE", 640, 480, (60.0, 60.0, 320.0, 240.0), pose)
    crops = crops_for_boxes([[450.0, 170, 590, 310]], 64, wide)
    crop = extract_crops(frame, crops)[0]
    grid = np.stack(np.meshgrid(np.arange(64.0), np.arange(64.0)), axis=-1).reshape(1, -1, 2)
    behind = np.isnan(crops.to_image(grid)[0, :, 0]).reshape(64, 64)
    assert behind.any() and crop[behind].max() == 0


def test_crop_of_one_size_copies_pixels() -> None:
    frame = np.random.default_rng(0).integers(0, 256, (300, 300, 3), dtype=np.uint8)
    crops = crops_for_boxes([[100.0, 80, 163, 143]], 64, padding=64 / 63)
    # The box spans pixel centres 100..163: the crop's edges are half a pixel outside.
    np.testing.assert_array_equal(extract_crops(frame, crops)[0], frame[80:144, 100:164])
