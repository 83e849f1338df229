"""Rendered rooms for backgrounds."""

import numpy as np
import pytest

pytest.importorskip("moderngl")
pytest.importorskip("anny")

from muybridge.train.synthesis.bodies.body_model import BodyModel  # noqa: E402
from muybridge.train.synthesis.rendering.renderer import Renderer  # noqa: E402
from muybridge.train.synthesis.rendering.rooms import RoomBuilder, make_room_pictures, room_view  # noqa: E402


@pytest.fixture(scope="module")
def renderer():
    return Renderer(BodyModel(0))


def test_rooms_are_seeded_and_differ(renderer):
    pictures = make_room_pictures(renderer, 9, 64, 5)
    assert pictures.shape == (9, 3, 64, 64) and pictures.dtype == np.uint8
    assert np.array_equal(pictures, make_room_pictures(renderer, 9, 64, 5))
    assert not np.array_equal(pictures[:8], make_room_pictures(renderer, 8, 64, 6))
    # Neither black, nor burnt out, nor flat, whatever the draw.
    levels = pictures.reshape(9, -1).mean(1)
    assert (levels > 8).all() and (levels < 248).all()
    assert np.median(pictures.reshape(9, -1).std(1)) > 12


def test_cameras_of_rooms_stand_inside_and_see_the_middle():
    rng = np.random.default_rng(1)
    for _ in range(50):
        builder = RoomBuilder(rng, rng.uniform(2.2, 8.0, 2), 3.0)
        view = room_view(rng, builder, 64)
        eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
        assert (np.abs(eye[:2]) < builder.half).all() and 0 < eye[2] < builder.height
        _, depth = view.project(np.array([[0.0, 0.0, 0.9]]))
        assert view.cam_from_world[1, 2] < 0  # upright: the world's up is the picture's
        assert depth.shape == (1,)


def test_walls_face_inwards():
    builder = RoomBuilder(np.random.default_rng(0), np.array([3.0, 4.0]), 2.8)
    builder.shell()
    for a, b in builder.walls():
        middle = (a + b) / 2
        across, up = np.array([*(b - a), 0.0]), np.array([0.0, 0.0, 1.0])
        assert np.cross(across, up)[:2] @ -middle > 0
