"""Frames rotated upright, and boxes mapped back from the letterboxed image."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.geometry.cameras.camera import Camera
from muybridge.infer.detection.orientation import FrameOrientation, Letterbox, orientation_for
from tests.infer.detection.test_inference import HEIGHT, WIDTH


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi, -np.pi / 2, 0.4, -2.0])
def test_letterbox_boxes_come_back(angle: float) -> None:
    for width, height in ((1920, 1080), (1080, 1920), (320, 200), (1088, 1920), (3840, 2160)):
        upright = FrameOrientation(width, height, angle)
        letterbox = Letterbox(upright, 320)
        assert all(side % 32 == 0 for side in letterbox.canvas)
        frame = np.zeros((height, width, 3), dtype=np.uint8)
        left, top, right, bottom = width // 4, height // 8, width // 2, height // 3
        frame[top:bottom, left:right] = 255
        small = letterbox.apply(frame)[..., 0] > 127
        assert small.shape == letterbox.canvas[::-1]
        rows, columns = np.nonzero(small.any(axis=1))[0], np.nonzero(small.any(axis=0))[0]
        found = np.array([[columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5]])
        # Edges lie half a pixel outside the first and last pixel's centre; turned corners are cut off a little.
        corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]]) - 0.5
        turned = upright.to_upright(corners)
        expected = np.concatenate([turned.min(axis=0), turned.max(axis=0)])
        assert np.abs(letterbox.boxes_to_upright(found)[0] - expected).max() <= 1.5 * max(width, height) / 320


@settings(max_examples=30, deadline=None)
@given(angle=st.floats(-3.1, 3.1), width=st.integers(50, 4000), height=st.integers(50, 4000))
def test_upright_round_trip(angle: float, width: int, height: int) -> None:
    upright = FrameOrientation(width, height, angle)
    points = np.random.default_rng(0).uniform(-100, 4000, (20, 2))
    np.testing.assert_allclose(upright.to_frame(upright.to_upright(points)), points, atol=1e-8)
    boxes = np.concatenate([points[:5], points[:5] + [30.0, 80.0]], axis=1)
    middle = upright.to_frame((boxes[:, :2] + boxes[:, 2:]) / 2)
    for inside, around in zip(upright.centered_in_frame(boxes), upright.around_in_frame(boxes), strict=True):
        np.testing.assert_allclose(inside[2:] - inside[:2], [30, 80])
        assert np.linalg.norm(around[2:] - around[:2]) >= np.hypot(30, 80) - 1e-6
    np.testing.assert_allclose((around[:2] + around[2:]) / 2, middle[-1], atol=1e-6)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
@pytest.mark.parametrize(("tilt", "roll"), [(-0.2, 0.0), (0.0, 0.5), (0.2, -0.7), (0.1, 0.02)])
def test_frames_are_turned_so_that_world_up_is_up(turns: int, tilt: float, roll: float) -> None:
    rotation = np.array([[1.0, 0, 0], [0, -np.sin(tilt), -np.cos(tilt)], [0, np.cos(tilt), -np.sin(tilt)]])
    roll_turn = [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1.0]]
    rotation = np.array(roll_turn) @ rotation
    pose = np.column_stack([rotation, -rotation @ np.array([0.0, -4.0, 1.0])])
    camera = Camera("c", "PINHOLE", WIDTH, HEIGHT, (500.0, 500.0, 320.0, 240.0), pose).turned(turns)
    letterbox = Letterbox(orientation_for(camera, camera.width, camera.height), 320)
    frame = np.zeros((camera.height, camera.width, 3), dtype=np.uint8)
    foot, head = np.round(camera.project([[0.1, 0.0, 0.7], [0.1, 0.0, 1.3]])).astype(int)
    frame[foot[1] - 4 : foot[1] + 5, foot[0] - 4 : foot[0] + 5, 0] = 255
    frame[head[1] - 4 : head[1] + 5, head[0] - 4 : head[0] + 5, 1] = 255
    small = letterbox.apply(frame).astype(float)
    y, x = np.mgrid[: small.shape[0], : small.shape[1]]
    at = [[(small[..., c] * v).sum() / small[..., c].sum() for v in (x, y)] for c in (0, 1)]
    assert at[0][1] - at[1][1] > 20 and abs(at[0][0] - at[1][0]) < 5
    straight_down = np.column_stack([np.diag([1.0, -1, -1]), [0, 0, 4.0]])
    assert orientation_for(camera.posed(straight_down), camera.width, camera.height).angle == 0
