"""Cameras: projection against OpenCV, round trips, and what crops, scalings and turns do."""

import pickle
import signal
import subprocess
import sys

import cv2
import numpy as np
import pycolmap
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import CAMERA_MODELS, Camera, camera_from_colmap, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from tests.rigs import look_at

# Mild distortion of each model, so that every pixel of the image has one ray.
DISTORTION = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": (-0.05,),
    "SIMPLE_RADIAL_FISHEYE": (0.03,),
    "RADIAL": (-0.05, 0.02),
    "RADIAL_FISHEYE": (0.03, -0.01),
    "OPENCV": (-0.05, 0.03, 0.002, -0.003),
    "OPENCV_FISHEYE": (0.03, -0.01, 0.004, -0.001),
    "FULL_OPENCV": (-0.05, 0.03, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005),
    "FOV": (0.4,),
    "THIN_PRISM_FISHEYE": (0.02, -0.01, 0.001, -0.002, 0.003, 0.001, 0.002, -0.001),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        0.02,
        -0.01,
        0.003,
        0.001,
        0.0,
        0.0,
        0.001,
        -0.002,
        0.001,
        0.0,
        0.001,
        0.0,
    ),
    "SIMPLE_DIVISION": (-0.05,),
    "DIVISION": (-0.05,),
    "SIMPLE_FISHEYE": (),
    "FISHEYE": (),
    "EUCM": (0.4, 1.1),
}


def make_camera(model: str, name: str = "cam", angle: float = 0.7) -> Camera:
    center = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.6])
    two = "SIMPLE" not in model and "RADIAL" not in model
    focal = (900.0, 910.0) if two else (900.0,)
    params = (*focal, 652.3, 347.9, *DISTORTION[model])
    return Camera(name, model, 1280, 720, params, look_at(center, np.array([0.0, 0.0, 1.0])))


def some_points(seed: int = 0, shape: tuple[int, ...] = (7, 5)) -> FloatArray:
    return np.random.default_rng(seed).uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 1.8], (*shape, 3))


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_unprojecting_a_projection_gives_the_ray_back(model: str) -> None:
    camera = make_camera(model)
    points = some_points()
    slopes = camera.unproject(camera.project(points))
    points_cam = points @ camera.rotation.T + camera.translation
    np.testing.assert_allclose(slopes, points_cam[..., :2] / points_cam[..., 2:], atol=1e-7)
    rays = camera.rays(camera.project(points))
    towards = points - camera.center_world
    np.testing.assert_allclose(rays, towards / np.linalg.norm(towards, axis=-1, keepdims=True), atol=1e-7)


@pytest.mark.parametrize("model", ["PINHOLE", "RADIAL", "OPENCV", "FULL_OPENCV"])
def test_projection_is_opencv_s(model: str) -> None:
    camera = make_camera(model)
    distortion = np.zeros((1, 8))
    distortion[0, : len(DISTORTION[model])] = DISTORTION[model]
    rotation_vector, _ = cv2.Rodrigues(np.array(camera.rotation))
    expected, _ = cv2.projectPoints(
        some_points().reshape(-1, 1, 3),
        rotation_vector,
        np.array(camera.translation),
        camera.camera_matrix,
        distortion,
    )
    np.testing.assert_allclose(camera.project(some_points()).reshape(-1, 2), expected.reshape(-1, 2), atol=1e-8)


@pytest.mark.parametrize("model", ["OPENCV_FISHEYE", "RADIAL_FISHEYE", "FISHEYE"])
def test_fisheye_projection_is_opencv_s(model: str) -> None:
    camera = make_camera(model)
    distortion = np.zeros((1, 4))
    distortion[0, : len(DISTORTION[model])] = DISTORTION[model]
    rotation_vector, _ = cv2.Rodrigues(np.array(camera.rotation))
    expected, _ = cv2.fisheye.projectPoints(
        some_points().reshape(-1, 1, 3),
        rotation_vector,
        np.array(camera.translation),
        camera.camera_matrix,
        distortion,
    )
    np.testing.assert_allclose(camera.project(some_points()).reshape(-1, 2), expected.reshape(-1, 2), atol=1e-8)


def test_pixel_zero_is_the_centre_of_the_top_left_pixel() -> None:
    camera = Camera("cam", "SIMPLE_PINHOLE", 3, 3, (10.0, 1.0, 1.0), np.eye(3, 4))
    # The middle pixel of a 3 x 3 image is (1, 1); pycolmap calls its centre (1.5, 1.5).
    np.testing.assert_array_equal(camera.project([0.0, 0.0, 1.0]), [1.0, 1.0])
    np.testing.assert_array_equal(colmap_camera(camera).params, [10.0, 1.5, 1.5])
    assert camera_from_colmap("cam", colmap_camera(camera), np.eye(3, 4)) == camera


def test_missing_and_invisible_points_are_nan() -> None:
    camera = Camera("cam", "OPENCV", 640, 480, (500.0, 500.0, 320.0, 240.0, 0.1, 0.0, 0.0, 0.0), np.eye(3, 4))
    points = np.array([[0.1, 0.0, 2.0], [0.1, 0.0, -2.0], [np.nan, 0.0, 2.0], [0.0, 0.0, 0.0]])
    pixels = camera.project(points)
    assert np.isfinite(pixels[0]).all() and np.isnan(pixels[1:]).all()
    assert np.isnan(camera.unproject([[np.nan, 3.0], [3.0, np.nan]])).all()
    assert np.isnan(camera.rays([np.nan, 3.0])).all()


def test_what_a_lens_leads_back_into_the_picture_is_not_seen() -> None:
    camera = Camera("c", "OPENCV", 1920, 1080, (1000, 1000, 960, 540, -0.1, 0, 0, 0), np.eye(3, 4))
    angle = np.radians([0, 20, 40, 45, 72, 95])
    points = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    px = camera.project(points)
    assert 0 < px[4, 0] < 1920 and np.isnan(px[5]).all()
    seen = camera.project_seen(points)
    np.testing.assert_array_equal(seen[:4], px[:4])  # those beside the picture too
    assert np.isnan(seen[4:]).all()
    np.testing.assert_array_equal(CameraGroup((camera,)).project_seen(points)[0], seen)
    fisheye = Camera("c", "OPENCV_FISHEYE", 1920, 1080, (600, 600, 960, 540, 0, 0, 0, 0), np.eye(3, 4))
    assert np.isfinite(fisheye.project_seen(points)[:5]).all()


def test_shapes_of_any_rank_including_empty() -> None:
    group = CameraGroup((make_camera("OPENCV", "a"), make_camera("PINHOLE", "b", 2.0)))
    for shape in [(), (4,), (0,), (2, 3), (2, 0, 3)]:
        points = some_points(shape=shape)
        assert group[0].project(points).shape == (*shape, 2)
        assert group.project(points).shape == (2, *shape, 2)
        assert group.unproject(group.project(points)).shape == (2, *shape, 2)
        assert group[0].rays(group[0].project(points)).shape == (*shape, 3)
    with pytest.raises(ValueError, match=r"\(2, \.\.\., 2\)"):
        group.unproject(np.zeros((3, 5, 2)))
    with pytest.raises(ValueError, match=r"\(\.\.\., 3\)"):
        group[0].project(np.zeros((5, 2)))


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_cameras_pickle_compare_and_hash_by_value(model: str) -> None:
    camera = make_camera(model)
    camera.project(some_points())  # fills the cache that must not be pickled
    copy = pickle.loads(pickle.dumps(camera))
    assert copy == camera and hash(copy) == hash(camera) and copy is not camera
    assert copy != camera.renamed("other")
    with pytest.raises(ValueError):
        camera.cam_from_world[0, 0] = 2.0


def test_group_lookup() -> None:
    group = CameraGroup(tuple(make_camera("PINHOLE", n, a) for n, a in [("a", 0.1), ("b", 1.0), ("c", 3.0)]))
    assert group.names == ("a", "b", "c") and len(group) == 3 and "b" in group
    assert [c.name for c in group] == ["a", "b", "c"]
    assert group.select(["c", "a"]).names == ("c", "a")
    assert group.cam_from_world.shape == (3, 3, 4)
    np.testing.assert_allclose(np.linalg.norm(group.centers_world[:, :2], axis=1), 4.0)
    with pytest.raises(KeyError, match="a, b, c"):
        group["d"]
    with pytest.raises(ValueError, match="repeat: a"):
        CameraGroup((group["a"], group["a"]))
    with pytest.raises(ValueError, match="at least one"):
        CameraGroup(())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "FOO"}, "known: SIMPLE_PINHOLE"),
        ({"model": "EQUIRECTANGULAR"}, "unknown camera model"),
        ({"params": (1.0, 2.0, 3.0)}, "8 parameters, not 3"),
        ({"params": (500.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)}, "focal length"),
        ({"params": (500.0, np.nan, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)}, "not finite"),
        ({"width": 0}, "not positive"),
        ({"cam_from_world": np.eye(4)}, r"\(3, 4\)"),
        ({"cam_from_world": np.full((3, 4), np.inf)}, "pose is not finite"),
        ({"cam_from_world": 2 * np.eye(3, 4)}, "not a rotation"),
        ({"cam_from_world": np.diag([1.0, 1.0, -1.0]) @ np.eye(3, 4)}, "not a rotation"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], message: str) -> None:
    values: dict[str, object] = dict(
        name="cam", model="OPENCV", width=640, height=480,
        params=(500.0, 500.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0), cam_from_world=np.eye(3, 4),
    )  # fmt: skip
    with pytest.raises(ValueError, match=message):
        Camera(**(values | change))  # type: ignore[arg-type]


@pytest.mark.parametrize("model", CAMERA_MODELS)
def test_resizing_keeps_the_share_of_the_image(model: str) -> None:
    camera = make_camera(model)
    points = some_points()
    for size in [(640, 360), (1920, 1080), (1280, 360), (500, 720)]:
        resized = camera.resized(*size)
        assert (resized.width, resized.height) == size
        share = (camera.project(points) + 0.5) / (camera.width, camera.height)
        np.testing.assert_allclose((resized.project(points) + 0.5) / size, share, atol=1e-10)
    assert camera.resized(camera.width, camera.height) == camera


@settings(max_examples=50, deadline=None)
@given(st.integers(-200, 200), st.integers(-200, 200), st.sampled_from(CAMERA_MODELS))
def test_cropping_shifts_pixels(left: int, top: int, model: str) -> None:
    camera = make_camera(model)
    window = camera.cropped(left, top, 800, 600)
    expected = camera.project(some_points()) - (left, top)
    np.testing.assert_allclose(window.project(some_points()), expected, atol=1e-9)


@pytest.mark.parametrize("model", CAMERA_MODELS)
@pytest.mark.parametrize("quarter_turns", [1, 2, 3, 4, -1])
def test_turning_moves_pixels_as_turning_the_image_does(model: str, quarter_turns: int) -> None:
    camera = make_camera(model)
    if "PRISM" in model:
        with pytest.raises(ValueError, match="cannot be turned"):
            camera.turned(quarter_turns)
        return
    # The reference turns an actual image with one lit pixel.
    pixels = camera.project(some_points())
    u, v = pixels[..., 0], pixels[..., 1]
    width, height = camera.width, camera.height
    expected = {
        0: np.stack([u, v], -1),
        1: np.stack([height - 1 - v, u], -1),
        2: np.stack([width - 1 - u, height - 1 - v], -1),
        3: np.stack([v, width - 1 - u], -1),
    }[quarter_turns % 4]
    image = np.zeros((height, width), dtype=bool)
    image[200, 300] = True
    lit = np.argwhere(np.rot90(image, -quarter_turns))[0]
    by_formula = {
        0: (300, 200),
        1: (height - 1 - 200, 300),
        2: (width - 301, height - 201),
        3: (200, width - 301),
    }
    assert tuple(lit[::-1]) == by_formula[quarter_turns % 4]
    turned = camera.turned(quarter_turns)
    np.testing.assert_allclose(turned.project(some_points()), expected, atol=1e-8)
    np.testing.assert_allclose(turned.center_world, camera.center_world, atol=1e-12)


def test_models_and_parameter_counts_are_pycolmap_s() -> None:
    for model in CAMERA_MODELS:
        reference = pycolmap.Camera.create_from_model_name(1, model, 500.0, 640, 480)
        camera = camera_from_colmap("cam", reference, np.eye(3, 4))
        np.testing.assert_allclose(camera.camera_matrix[:2, 2], [319.5, 239.5])
        assert list(reference.principal_point_idxs())[0] == len(reference.focal_length_idxs())


@pytest.mark.parametrize("call", ["look()", "t = threading.Thread(target=look); t.start(); t.join()"])
def test_a_process_with_cameras_ends_when_it_is_asked_to(call: str) -> None:
    """pycolmap's own handler prints a stack instead, and can hang."""
    code = f"""
import os, signal, sys, threading
from muybridge.geometry.cameras.camera import Camera

def look():
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5]]
    Camera("a", "PINHOLE", 640, 480, (500, 500, 319.5, 239.5), pose).unproject((1, 2))

assert "pycolmap" not in sys.modules
{call}
assert "pycolmap" in sys.modules
os.kill(os.getpid(), signal.SIGTERM)
"""
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert ended.returncode == -signal.SIGTERM
    assert ended.stderr == ""
