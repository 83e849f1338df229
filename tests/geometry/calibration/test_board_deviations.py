"""Standard deviations of a calibration from a board, against the truth, with errors as cameras make them.

In real pictures the errors of neighbouring corners are alike: blur and light shift them together, and a board that is
held by hand is bent a little differently each time.
"""

import numpy as np
import pytest

from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.extrinsics import BoardOptions, calibrate_rig
from muybridge.geometry.calibration.board.intrinsics import calibrate_lens
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.numerics.rotations import exp_so3
from tests.geometry.calibration.test_board_rig import in_first, path, ring, sizes

SIZE = (1280, 720)


def alike(rng, board):
    """(K, 2) px: a smooth field over the board, of another size in each picture."""
    at = board.corners[:, :2] - board.corners[:, :2].mean(axis=0)
    x, y = (at / np.abs(at).max(axis=0)).T
    terms = np.stack([x**0, x, y, x * y, x * x, y * y, x**3, y**3, x * x * y, x * y * y], axis=1)
    field = terms @ rng.normal(size=(10, 2))
    return field / np.sqrt((field**2).mean()) * (abs(rng.normal()) * 0.15 + 0.05)


def bent(rng, board, most):
    """(K, 3) the board's corners about its middle, bent by about `most` metres."""
    corners = board.corners - board.corners.mean(axis=0)
    x, y = (corners[:, :2] / np.abs(corners[:, :2]).max()).T
    a, b, c = rng.normal(size=3) * most
    return corners + np.stack([0 * x, 0 * x, a * (x * x - 0.3) + b * (y * y - 0.3) + c * x * y], axis=1)


def seen(rng, camera, board, turn, place, real):
    """The corners' pixels with errors, or None where the image does not contain the whole board."""
    shape = bent(rng, board, 0.0004) if real else board.corners - board.corners.mean(axis=0)
    px = camera.project(shape @ turn.T + place)
    if not ((px > 2) & (px < np.array(SIZE) - 3)).all():
        return None
    px += rng.normal(size=px.shape) * (0.08 if real else 0.2)
    return px + alike(rng, board) if real else px


def lens_scores(seed, views, real):
    """(8,) errors of the lens parameters in their standard deviations."""
    rng = np.random.default_rng(seed)
    board, focal = Board("checkerboard", 4, 7, 0.06), rng.uniform(800, 1200)
    middle = np.array([639.5, 359.5]) + rng.normal(size=2) * 15
    terms = np.array([-0.15, 0.0, 0.0, 0.0]) + rng.normal(size=4) * [0.1, 0.1, 0.0005, 0.0005]
    truth = np.array([focal, focal * (1 + 0.001 * rng.normal()), *middle, *terms])
    camera = Camera("c", "OPENCV", *SIZE, tuple(truth), np.eye(4)[:3])
    shown = {}
    while len(shown) < views:
        turn, depth = exp_so3(rng.uniform(-0.7, 0.7, size=3)), rng.uniform(0.7, 1.6)
        place = depth * np.array([rng.uniform(-0.4, 0.4), rng.uniform(-0.22, 0.22), 1.0])
        px = seen(rng, camera, board, turn, place, real)
        if px is not None:
            shown[len(shown)] = (np.arange(len(px)), px)
    found = calibrate_lens("c", board, shown, SIZE)
    return (np.array(found.camera.params) - truth) / np.sqrt(np.diag(found.result.covariances[0])[:8])


def rig_scores(seed, moments):
    """(C - 1, 3) errors of the cameras' centres, and (C, 4) of focal lengths and principal points."""
    rng = np.random.default_rng(seed)
    truth, board, pose = ring(3), Board("charuco", 7, 10, 0.06), path(rng, 1)
    views = {c.name: {} for c in truth}
    for t in range(0, 3 * moments, 3):
        turn, place = pose(t)
        for camera in truth:
            ray = (place - camera.center_world) / np.linalg.norm(place - camera.center_world)
            px = seen(rng, camera, board, turn, place, real=True) if abs(turn[:, 2] @ ray) > 0.35 else None
            if px is not None:
                views[camera.name][t] = (np.arange(len(px)), px)
    result = calibrate_rig(board, views, sizes(truth), BoardOptions(in_step=True))
    sigma = [np.sqrt(np.diag(v)) for v in result.solved.covariances]
    pairs = list(zip(result.cameras, in_first(truth), sigma, strict=True))
    places = [(a.center_world - b.center_world) / s[-3:] for a, b, s in pairs[1:]]
    return np.array(places), np.array([(np.array(a.params) - b.params)[:4] / s[:4] for a, b, s in pairs])


def rms(scores):
    return float(np.sqrt(np.mean(np.square(scores))))


@pytest.mark.parametrize(
    ("views", "real", "sessions"),
    [
        (12, True, 16),
        pytest.param(12, False, 30, marks=pytest.mark.slow),
        pytest.param(6, True, 30, marks=pytest.mark.slow),
        pytest.param(6, False, 30, marks=pytest.mark.slow),
        pytest.param(30, True, 30, marks=pytest.mark.slow),
    ],
)
def test_lenses_are_off_by_what_is_told(views, real, sessions):
    scores = np.array([lens_scores(seed, views, real) for seed in range(sessions)])
    assert 1 / 1.3 < rms(scores) < 1.3


@pytest.mark.slow
def test_positions_are_off_by_what_is_told():
    places, lenses = zip(*(rig_scores(seed, 40) for seed in range(10)), strict=True)
    assert 1 / 1.3 < rms(places) < 1.3
    assert 1 / 1.3 < rms(lenses) < 1.3
