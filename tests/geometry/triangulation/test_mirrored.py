"""Mirrored videos are recognised by the views that agree once they are turned back, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.triangulation.mirrored import exchanged_instead, find_mirrored
from tests.rigs import ring_of_cameras
from tests.staged_people import person

SIZE = (1280, 720)


def _views(cameras: CameraGroup, mirrored: tuple[int, ...], seed: int, shift: int = 0) -> Keypoints2D:
    """What the cameras see of somebody who walks about; the networks of mirrored views take left for right."""
    rng = np.random.default_rng(seed)
    world = person(80)
    world[..., :2] += rng.uniform(-0.6, 0.6, 2) + np.linspace([0, 0], rng.uniform(-1, 1, 2), 80)[:, None]
    px = cameras.project_seen(world)
    px += rng.normal(0, 2.0, px.shape)
    px[rng.random(px.shape[:-1]) < 0.05] = np.nan
    for c in mirrored:
        px[c] = px[c][:, list(BODY23.mirror)]
        px[c, ..., 0] = SIZE[0] - 1 - px[c, ..., 0]
    if shift:
        px[0] = np.roll(px[0], shift, axis=0)
    score = np.where(np.isfinite(px[..., 0]), 0.9, 0.0)
    return Keypoints2D(BODY23, px[:, :, None], np.full(px.shape[:-1], 4.0)[:, :, None], score[:, :, None])


@pytest.mark.parametrize("count", [3, 4, 6])
@pytest.mark.parametrize("seed", range(5))
def test_all_mirrored_one_mirrored_and_none(count, seed):
    cameras = ring_of_cameras([f"cam{k}" for k in range(count)], size=SIZE)
    every = tuple(range(count))
    assert find_mirrored(cameras, _views(cameras, (), seed)) == ()
    assert find_mirrored(cameras, _views(cameras, every, seed)) == every
    one = (seed % count,)
    assert find_mirrored(cameras, _views(cameras, one, seed)) == one


def test_one_mirrored_is_found_where_landmarks_are_coarse():
    """Of a short real take the views agree no better than this, once turned back."""
    cameras = ring_of_cameras([f"cam{k}" for k in range(4)], size=SIZE)
    found = []
    for seed in range(12):
        views, none = _views(cameras, (seed % 4,), seed), _views(cameras, (), seed)
        noise = np.random.default_rng(seed).normal(0, 11.0, views.points_px.shape)
        found.append(find_mirrored(cameras, replace(views, points_px=views.points_px + noise)) == (seed % 4,))
        assert find_mirrored(cameras, replace(none, points_px=none.points_px + noise)) == ()
    assert all(found)


@pytest.mark.parametrize("seed", range(10))
def test_a_wrong_calibration_or_clock_is_no_mirroring(seed):
    rng = np.random.default_rng(seed)
    cameras = ring_of_cameras([f"cam{k}" for k in range(4)], size=SIZE)
    moved = list(cameras)
    pose = moved[1].cam_from_world.copy()
    pose[:, 3] += rng.normal(0, 0.5, 3)
    moved[1] = moved[1].posed(pose)
    swapped = [cameras[1].renamed("cam0"), cameras[0].renamed("cam1"), *list(cameras)[2:]]
    assert find_mirrored(CameraGroup(tuple(moved)), _views(cameras, (), seed)) == ()
    assert find_mirrored(CameraGroup(tuple(swapped)), _views(cameras, (), seed)) == ()
    assert find_mirrored(cameras, _views(cameras, (), seed, shift=20)) == ()


def test_exchanged_videos_of_a_symmetric_rig_are_named_beside_mirroring():
    """Where cameras stand symmetrically the two cannot be told apart; where they do not, mirroring is certain."""
    cameras = ring_of_cameras(["cam0", "cam1", "cam2"], size=SIZE)
    views = _views(cameras, (), 3)
    exchanged = replace(views, points_px=views.points_px[[0, 2, 1]], score=views.score[[0, 2, 1]])
    assert find_mirrored(cameras, exchanged) == (0, 1, 2)
    assert exchanged_instead(cameras, exchanged) == ((1, 2),)

    moved = list(cameras)
    pose = moved[1].cam_from_world.copy()
    pose[:, 3] += [0.4, 0.2, 0.9]
    moved[1] = moved[1].posed(pose)
    lopsided = CameraGroup(tuple(moved))
    mirrored = _views(lopsided, (0, 1, 2), 3)
    assert find_mirrored(lopsided, mirrored) == (0, 1, 2)
    assert exchanged_instead(lopsided, mirrored) == ()


def test_two_cameras_face_to_face_leave_it_open():
    """Their mirrored views agree as well as others."""
    cameras = ring_of_cameras(["cam0", "cam1"], size=SIZE)
    assert find_mirrored(cameras, _views(cameras, (0, 1), 0)) == ()


def test_nobody_in_view_is_no_evidence():
    cameras = ring_of_cameras(["cam0", "cam1", "cam2"], size=SIZE)
    views = _views(cameras, (0, 1, 2), 0)
    empty = np.full_like(views.points_px, np.nan)
    assert find_mirrored(cameras, replace(views, points_px=empty, score=np.zeros_like(views.score))) == ()
