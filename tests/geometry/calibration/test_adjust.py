"""Bundle adjustment: lens derivatives, recovery of synthetic rigs, honest standard deviations."""

import time

import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.extrinsics import calibrate_rig
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, adjust
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import project_terms
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3
from tests.rigs import ring_of_cameras


def rig(count, rng):
    """Cameras on a ring of 3 m that look at the origin."""
    return ring_of_cameras(
        [f"c{k}" for k in range(count)],
        radius=3,
        height=[1.5 + 0.3 * rng.normal() for _ in range(count)],
        target=(0, 0, 0),
        first=0,
        size=(1280, 720),
        model="OPENCV",
        params=[(1000.0 + 20 * k, 1005.0, 640.0, 360.0, -0.1, 0.02, 0.001, -0.001) for k in range(count)],
    )


def moved(cameras, rng, turn=0.02, shift=0.05):
    """The cameras, all but the first two pushed off their places."""
    out = list(cameras[:2]) if isinstance(cameras, tuple) else list(cameras)[:2]
    for camera in list(cameras)[2:]:
        rotation = exp_so3(rng.normal(size=3) * turn) @ camera.rotation
        center = camera.center_world + rng.normal(size=3) * shift
        out.append(camera.posed(np.column_stack([rotation, -rotation @ center])))
    return CameraGroup(tuple(out))


@pytest.mark.parametrize("fisheye", [False, True])
def test_lens_derivatives_are_those_of_differences(fisheye):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(6, 3)) * 0.4 + [0, 0, 2]
    terms = np.array([900, 910, 600, 400, 0.1, -0.05, 0.002, 0.003, 0.02, 0.01, 0.02, 0.01])
    _, by_point, by_terms = project_terms(terms, fisheye, points)
    for size, found, call in (
        (3, by_point, lambda d: project_terms(terms, fisheye, points + d)[0]),
        (12, by_terms, lambda d: project_terms(terms + d, fisheye, points)[0]),
    ):
        for k in range(size):
            step = np.eye(size)[k] * 1e-6
            np.testing.assert_allclose(found[..., k], (call(step) - call(-step)) / 2e-6, atol=1e-5)


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "SIMPLE_RADIAL"])
def test_pixels_are_those_of_the_cameras(model):
    terms = {"SIMPLE_RADIAL": (900.0, 640.0, 360.0, 0.05)}.get(
        model, (900.0, 905.0, 640.0, 360.0, 0.05, -0.02, 0.001, 0.002, *[0.01] * (4 * (model == "FULL_OPENCV")))
    )
    camera = Camera("a", model, 1280, 720, terms, np.eye(4)[:3])
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.3 + [0, 0, 2]
    result = adjust(
        AdjustProblem(
            CameraGroup((camera,)), np.zeros(20, int), np.arange(20), camera.project(points), np.ones(20), points,
            np.zeros(20, bool), (FreeCamera(pose=False),),
        )
    )  # fmt: skip
    assert np.abs(result.residuals_px).max() < 1e-6


@pytest.mark.parametrize("axis", [0, 1])
def test_pixels_that_fit_no_camera_leave_it_a_focal_length(axis):
    camera = Camera("a", "PINHOLE", 1280, 720, (900.0, 905.0, 640.0, 360.0), np.eye(4)[:3])
    points = np.random.default_rng(1).normal(size=(40, 3)) * 0.3 + [0, 0, 2]
    px = camera.project(points)
    px[:, axis] = 2 * camera.params[2 + axis] - px[:, axis]
    free = (FreeCamera(pose=False, focal=True),)
    result = adjust(AdjustProblem(
        CameraGroup((camera,)), np.zeros(40, int), np.arange(40), px, np.ones(40), points, np.zeros(40, bool), free,
    ))  # fmt: skip
    assert min(result.cameras[0].params[:2]) > 0


def test_twelve_cameras_with_outliers_and_gaps_within_their_uncertainty_and_five_seconds():
    rng = np.random.default_rng(3)
    truth = rig(12, rng)
    points = rng.uniform(-1, 1, size=(600, 3))
    camera, point = np.nonzero(rng.random((12, 600)) < 0.7)
    pixels = truth.project(points)[camera, point] + rng.normal(size=(len(camera), 2)) * 0.5
    wrong = rng.random(len(camera)) < 0.05
    pixels[wrong] += rng.normal(size=(wrong.sum(), 2)) * 60
    free = (FreeCamera(pose=False),) * 2 + (FreeCamera(focal=True),) * 10
    start = points + rng.normal(size=points.shape) * 0.03
    began = time.thread_time()  # a busy machine must not count
    result = adjust(
        AdjustProblem(
            moved(truth, rng), camera, point, pixels, np.full(len(camera), 0.5), start, np.ones(600, bool), free
        )
    )
    assert time.thread_time() - began < 5
    off = np.linalg.norm(result.cameras.centers_world - truth.centers_world, axis=1)[2:]
    assert np.sqrt(np.mean((off / result.position_std[2:]) ** 2)) < 2
    assert result.position_std[2:].max() < 0.01
    focal = np.array([c.params[0] - t.params[0] for c, t in zip(result.cameras, truth, strict=True)])[2:]
    assert np.sqrt(np.mean((focal / result.focal_std[2:]) ** 2)) < 2


def board_views(truth, board, rng, count=40):
    """Corners of a board waved about the origin."""
    views = {c.name: {} for c in truth}
    for t in range(count):
        turn = exp_so3(rng.normal(size=3) * 1.2)
        world = (board.corners - board.corners.mean(axis=0)) @ turn.T + rng.uniform(-0.5, 0.5, size=3)
        normal = turn[:, 2]
        for camera in truth:
            px = camera.project(world)
            if abs(normal @ camera.rotation[2]) > 0.3 and ((px > 0) & (px < [1279, 719])).all():
                views[camera.name][t] = (np.arange(len(world)), px + rng.normal(size=px.shape) * 0.2)
    return views


def test_a_rig_from_a_waved_board_and_a_camera_apart_is_named():
    rng = np.random.default_rng(5)
    truth, board = rig(4, rng), Board("checkerboard", 6, 9, 0.08)
    views = board_views(truth, board, rng)
    sizes = {c.name: (1280, 720) for c in truth}
    result = calibrate_rig(board, views, sizes)
    found, right = result.cameras.centers_world, truth.centers_world
    apart = np.linalg.norm(found[:, None] - found, axis=-1) - np.linalg.norm(right[:, None] - right, axis=-1)
    assert np.abs(apart).max() < 0.02
    views["c3"] = {t + 1000: v for t, v in views["c3"].items()}
    with pytest.raises(CalibrationError, match="c3: no view of the board is shared"):
        calibrate_rig(board, views, sizes)
    views["c2"] = dict(list(views["c2"].items())[:2])
    with pytest.raises(CalibrationError, match="camera c2: .* 2 usable views"):
        calibrate_rig(board, views, sizes)
