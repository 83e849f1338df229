"""Which way is up, where the calibration's world does not say so."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.calibration.gravity import (
    all_upside_down,
    estimate_up,
    level_cameras,
    standing_axes,
    tilt_notes,
)
from muybridge.geometry.calibration.world import transform_cameras
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.infer.session.session import open_session
from tests.rigs import look_at

Z_UP = np.array([0.0, 0.0, 1.0])


def rig(rng: np.random.Generator, count: int, rolls_deg: np.ndarray) -> CameraGroup:
    """Cameras in a ring of 4 m that look at a person's middle."""
    cameras = []
    for i, azimuth in enumerate(np.arange(count) * 2 * np.pi / count + rng.normal(0, 0.2, count)):
        center = np.array([4 * np.cos(azimuth), 4 * np.sin(azimuth), rng.uniform(0.8, 2.6)])
        pose = look_at(center, Z_UP, roll=np.radians(rolls_deg[i]))
        cameras.append(Camera(f"c{i}", "PINHOLE", 1280, 720, (900.0, 900.0, 640.0, 360.0), pose))
    return CameraGroup(tuple(cameras))


def turned(cameras: CameraGroup, rotation: np.ndarray) -> CameraGroup:
    return transform_cameras(cameras, np.column_stack([rotation, np.zeros(3)]))


def degrees_off(cameras: CameraGroup, up: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(estimate_up(cameras) @ up, -1, 1))))


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_a_level_world_is_believed_however_cameras_are_hung(count: int) -> None:
    rng = np.random.default_rng(count)
    for _ in range(8):
        rolls = rng.normal(0, 4, count)
        odd = rolls + np.eye(count)[0] * rng.choice([-1, 1]) * rng.uniform(10, 35)
        for hung in (rolls, odd, rolls + 90, rolls + 180):
            cameras = rig(rng, count, hung)
            assert level_cameras(cameras) is cameras and tilt_notes(cameras) == ()


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_a_world_that_is_the_first_cameras_is_stood_up(count: int) -> None:
    rng, off = np.random.default_rng(10 + count), []
    for _ in range(20):
        cameras = rig(rng, count, rng.normal(0, 3, count))
        first = cameras[0].rotation
        off.append(degrees_off(turned(cameras, first), first @ Z_UP))
    # Two cameras fix up as well as they are hung.
    assert np.median(off) < (12 if count == 2 else 5) and np.mean(np.array(off) < 25) >= 0.9


def test_a_world_that_leans_is_stood_up_and_cameras_keep_their_places() -> None:
    rng = np.random.default_rng(3)
    cameras = rig(rng, 4, rng.normal(0, 2, 4))
    lean = Rotation.from_rotvec(np.radians(28) * np.array([0.6, 0.8, 0])).as_matrix()
    leaning = turned(cameras, lean)
    assert degrees_off(leaning, lean @ Z_UP) < 4
    (note,) = tilt_notes(leaning)
    assert "28 degrees off" in note or "27 degrees off" in note or "29 degrees off" in note
    stood = level_cameras(leaning)
    for a, b in zip(stood, leaning, strict=True):  # the same rig: what one camera sees of another stays
        np.testing.assert_allclose(a.rotation @ stood[0].rotation.T, b.rotation @ leaning[0].rotation.T, atol=1e-9)
    rolls = [np.degrees(np.arctan2(c.rotation[0, 2], -c.rotation[1, 2])) for c in stood]
    assert np.abs(rolls).max() < 8


def test_people_of_a_session_are_read_in_level_cameras(make_session) -> None:
    session = open_session(make_session(frames=3))
    assert session.level_cameras is session.cameras


def test_who_stands_tells_where_cameras_do_not_agree() -> None:
    rng = np.random.default_rng(8)
    cameras = rig(rng, 4, np.array([13.0, -3.0, -3.0, -26.0]))
    first = cameras[0].rotation
    own, up = turned(cameras, first), first @ Z_UP
    body = np.array([[0, 0, 0.1], [0, 0, 0.9], [0.02, 0, 1.4]]).repeat(2, axis=0)
    body += np.tile([[0.1, 0, 0], [-0.1, 0, 0]], (3, 1))
    names = tuple(f"{side}_{part}" for part in ("ankle", "hip", "shoulder") for side in ("left", "right"))
    people = body + rng.normal(0, 0.02, (30, 6, 3))
    people[20:, 4:] = people[20:, 2:4] + [0.5, 0, 0.0]  # bent over: they do not tell
    axes = standing_axes(people @ first.T, LandmarkSet("six", names, ()))
    assert len(axes) == 20
    alone, with_people = (estimate_up(own, standing) for standing in (None, axes))
    off = [np.degrees(np.arccos(direction @ up)) for direction in (alone, with_people)]
    assert off[1] < 8 and off[1] < off[0]
    # A level world is unchanged, even if people lean.
    np.testing.assert_array_equal(estimate_up(cameras, axes), Z_UP)
    assert standing_axes(people[:, :4], LandmarkSet("four", names[:4], ())).shape == (0, 3)


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_standing_people_resolve_an_upside_down_world(count: int) -> None:
    rng = np.random.default_rng(20 + count)
    for _ in range(8):
        rolls = rng.normal(0, 4, count)
        assert not any(all_upside_down(rig(rng, count, rolls + turn)) for turn in (0, 90, -90))
        hung = rig(rng, count, rolls + 180)
        assert all_upside_down(hung)
        standing = Rotation.from_rotvec(rng.normal(0, np.radians(5), (12, 3))).apply(Z_UP)
        assert level_cameras(hung, standing) is hung and tilt_notes(hung, standing) == ()
        assert estimate_up(hung, -standing)[2] < -0.95
        (note,) = tilt_notes(hung, -standing)
        assert "the people who stand, up is about the calibration's -Z axis" in note


def test_standing_people_reduce_false_corrections() -> None:
    """Where every camera is hung askew, what they agree on by chance is not up."""
    rng, doubted, off = np.random.default_rng(1), 0, []
    for _ in range(40):
        cameras = rig(rng, 4, rng.choice([-1, 1], 4) * rng.uniform(10, 35, 4))
        doubted += level_cameras(cameras) is not cameras
        leaning = Rotation.from_rotvec(rng.normal(0, np.radians(6), (12, 3))).apply(Z_UP)
        off.append(np.degrees(np.arccos(estimate_up(cameras, leaning) @ Z_UP)))
    assert doubted > 5
    assert (np.array(off) > 0).sum() < 0.3 * doubted and max(off) < 25
