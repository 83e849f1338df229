"""Calibration from a moved board: chained cameras, delays, symmetric boards, fisheye lenses, uncertainties."""

import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.extrinsics import BoardOptions, calibrate_lenses, calibrate_rig
from muybridge.geometry.calibration.board.intrinsics import calibrate_lens
from muybridge.geometry.calibration.board.pose_graph import symmetries
from muybridge.geometry.calibration.board.view_selection import choose_times
from muybridge.geometry.calibration.bundle_adjustment.result import table
from muybridge.geometry.calibration.gravity import level_transform
from muybridge.geometry.calibration.world import on_board, transform_cameras
from muybridge.geometry.numerics.rotations import exp_so3
from tests.rigs import ring_of_cameras

CHARUCO = Board("charuco", 7, 10, 0.06)
SIZE = (1280, 720)


def ring(count, radius=2.5, model="OPENCV"):
    """Cameras all around the origin."""
    fisheye = [(480.0 + 5 * k, 480.0 + 5 * k, 645.0, 355.0, 0.03, -0.01, 0.002, 0.0) for k in range(count)]
    focal = [900.0 + 15 * k for k in range(count)]
    return ring_of_cameras(
        [f"c{k}" for k in range(count)],
        radius=radius,
        height=[1.2 + 0.2 * (k % 3) for k in range(count)],
        target=(0, 0, 0),
        first=0,
        size=SIZE,
        model=model,
        params=fisheye if model == "OPENCV_FISHEYE"
        else [(f, f * 1.001, 650.0, 350.0, -0.1, 0.03, 0.0005, -0.0005) for f in focal],
    )  # fmt: skip


def path(rng, count):
    """Pose over time of a hand-held board: smooth, all over the room. Returns pose(t)."""
    waves = rng.normal(size=(6, 3)), rng.uniform(0.15, 0.45, size=(6, 3)), rng.uniform(0, 6.3, size=(6, 3))
    size = np.array([1.2, 1.2, 1.2, 0.35, 0.35, 0.3])

    def pose(t):
        v = size * (waves[0] * np.sin(waves[1] * t + waves[2])).sum(axis=1) / 1.5
        return exp_so3(v[:3]), v[3:]

    return pose


def views_of(cameras, board, pose, times, rng, noise=0.2, late=None):
    """Corners of the board in every camera that sees its front or back, tilted by at most 70 degrees."""
    views = {c.name: {} for c in cameras}
    middle = board.corners.mean(axis=0)
    for c, camera in enumerate(cameras):
        for t in times:
            turn, place = pose(t + (late(c, t) if late else 0.0))
            world = (board.corners - middle) @ turn.T + place
            px = camera.project(world)
            ray = (place - camera.center_world) / np.linalg.norm(place - camera.center_world)
            if abs(turn[:, 2] @ ray) < 0.35 or not ((px > 0) & (px < np.array(SIZE) - 1)).all():
                continue
            views[camera.name][t] = (np.arange(len(px)), px + rng.normal(size=px.shape) * noise)
    return views


def sizes(cameras):
    return {c.name: SIZE for c in cameras}


def in_first(cameras):
    """The cameras seen from the first."""
    first = cameras[0]
    return transform_cameras(cameras, np.column_stack([first.rotation, first.translation]))


def errors(found, truth):
    """(C,) metres between centres, both seen from the first camera."""
    return np.linalg.norm(found.centers_world - in_first(truth).centers_world, axis=1)


@pytest.mark.parametrize("count", [4, *(pytest.param(n, marks=pytest.mark.slow) for n in (8, 12))])
def test_positions_within_twice_the_cramer_rao_bound(count):
    rng = np.random.default_rng(count)
    truth = ring(count)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 90, 3), rng)
    for name in views:  # one view in a hundred is of something else, one corner in fifty is wrong
        for t, (ids, px) in views[name].items():
            px[rng.random(len(px)) < 0.02] += rng.normal(size=2) * 15
            if rng.random() < 0.01:
                views[name][t] = (ids, rng.uniform(0, 700, size=px.shape))
    result = calibrate_rig(CHARUCO, views, sizes(truth), BoardOptions(in_step=True))
    ratio = errors(result.cameras, truth)[1:] / result.solved.position_std[1:]
    assert np.sqrt(np.mean(ratio**2)) < 2
    assert result.solved.position_std[1:].max() < 0.02
    assert result.solved.noise_px == pytest.approx(0.2, rel=0.25)
    assert len(table(result.solved)) == count + 1


def test_cameras_that_expose_at_different_moments():
    rng = np.random.default_rng(1)
    truth = ring(4)
    offset, jitter = np.array([0.0, -0.4, 0.2, 0.1]), rng.normal(size=(4, 200)) * 0.08
    views = views_of(truth, CHARUCO, path(rng, 1), range(60), rng, late=lambda c, t: offset[c] + jitter[c, t])
    result = calibrate_rig(CHARUCO, views, sizes(truth))
    stuck = calibrate_rig(CHARUCO, views, sizes(truth), BoardOptions(in_step=True))
    off = errors(result.cameras, truth)
    assert np.sqrt(np.mean((off[1:] / result.solved.position_std[1:]) ** 2)) < 2
    assert off.max() < 0.03 and errors(stuck.cameras, truth).max() > 5 * off.max()
    found = np.nanmean(result.delays, axis=1)
    np.testing.assert_allclose(found - found[0], offset, atol=0.05)
    assert 0.03 < result.delay_spread < 0.16
    assert result.solved.rms_px.max() < 0.4 < 1 < stuck.solved.rms_px.max()


def test_cameras_that_never_see_the_board_at_once_are_chained():
    rng = np.random.default_rng(2)
    truth = ring(3)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 120, 2), rng)
    views["c0"] = {t: v for t, v in views["c0"].items() if t < 60}
    views["c2"] = {t: v for t, v in views["c2"].items() if t >= 60}
    result = calibrate_rig(CHARUCO, views, sizes(truth), BoardOptions(in_step=True))
    assert [(a, b) for a, b, _ in result.joined] == [("c1", "c0"), ("c2", "c1")]
    assert errors(result.cameras, truth).max() < 0.02
    views["c0"] = {t + 1000: v for t, v in views["c0"].items()}
    with pytest.raises(CalibrationError, match="^c0: no view of the board is shared with c1, c2; "):
        calibrate_rig(CHARUCO, views, sizes(truth))


@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (6, 6)])
def test_the_numbering_of_a_symmetric_checkerboard_is_resolved(columns, rows):
    rng = np.random.default_rng(3)
    truth, board = ring(3), Board("checkerboard", columns, rows, 0.07)
    views = views_of(truth, board, path(rng, 1), range(0, 90, 3), rng)
    numbers = [s[1] for s in symmetries(board)]
    assert len(numbers) == (4 if columns == rows else 2)
    for mine in views.values():
        for t, (_, px) in mine.items():
            mine[t] = (np.arange(len(px)), px[numbers[rng.integers(len(numbers))]])
    result = calibrate_rig(board, views, sizes(truth), BoardOptions(in_step=True))
    assert (errors(result.cameras, truth)[1:] < 3 * result.solved.position_std[1:]).all()
    assert result.solved.rms_px.max() < 0.5


def test_a_checkerboard_seen_once_by_two_cameras_is_refused():
    rng = np.random.default_rng(4)
    truth, board = ring(2), Board("checkerboard", 5, 7, 0.07)
    views = views_of(truth, board, path(rng, 1), range(0, 90, 3), rng)
    shared = sorted(views["c0"].keys() & views["c1"].keys())
    views["c1"] = {(t if t == shared[0] else t + 1000): v for t, v in views["c1"].items()}
    with pytest.raises(CalibrationError, match="camera c1: which way round .* ChArUco"):
        calibrate_rig(board, views, sizes(truth), BoardOptions(in_step=True))


def test_a_camera_with_mirrored_images_is_reported():
    rng = np.random.default_rng(5)
    truth, board = ring(3), Board("checkerboard", 5, 8, 0.06)
    views = views_of(truth, board, path(rng, 1), range(0, 90, 3), rng)
    flipped = np.arange(len(board.corners)).reshape(8, 5)[:, ::-1].ravel()
    views["c2"] = {t: (ids, (px * [-1, 1] + [SIZE[0] - 1, 0])[flipped]) for t, (ids, px) in views["c2"].items()}
    with pytest.raises(CalibrationError, match="camera c2: .* its pictures are mirrored"):
        calibrate_rig(board, views, sizes(truth))


def test_cameras_with_unrelated_images_are_reported():
    rng = np.random.default_rng(6)
    truth = ring(3)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 90, 3), rng)
    times = list(views["c1"])
    views["c1"] = dict(zip(times, [views["c1"][t] for t in rng.permutation(times)], strict=True))
    with pytest.raises(CalibrationError, match="camera c1: where it stands .* same moments"):
        calibrate_rig(CHARUCO, views, sizes(truth))


def test_a_fisheye_lens():
    rng = np.random.default_rng(7)
    truth = ring(2, 1.2, "OPENCV_FISHEYE")
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 120, 3), rng)
    result = calibrate_rig(CHARUCO, views, sizes(truth), BoardOptions("fisheye", in_step=True))
    for found, true in zip(result.cameras, truth, strict=True):
        assert found.model == "OPENCV_FISHEYE"
        assert found.params[0] == pytest.approx(true.params[0], rel=0.01)
    assert errors(result.cameras, truth).max() < 0.01
    assert result.solved.median_px.max() < 0.4


def test_a_board_that_always_faces_the_camera_does_not_determine_its_lens():
    rng = np.random.default_rng(8)
    camera = ring(1)[0].posed(np.eye(4)[:3])
    views = {}
    for t in range(10):
        points = CHARUCO.corners - CHARUCO.corners.mean(axis=0) + [*rng.uniform(-0.3, 0.3, size=2), 2.0]
        views[t] = (np.arange(len(points)), camera.project(points) + rng.normal(size=(len(points), 2)) * 0.2)
    with pytest.raises(CalibrationError, match="camera a: .*focal length .* tilt the board"):
        calibrate_lens("a", CHARUCO, views, SIZE)


def test_lenses_alone_and_lenses_kept():
    rng = np.random.default_rng(9)
    truth = ring(2)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 90, 3), rng)
    lenses = calibrate_lenses(CHARUCO, views, sizes(truth))
    for c, (found, true) in enumerate(zip(lenses.cameras, truth, strict=True)):
        assert abs(found.params[0] - true.params[0]) < 3 * lenses.focal_std_px[c] + 1
        assert (found.center_world == 0).all()
    kept = calibrate_rig(CHARUCO, views, sizes(truth), BoardOptions(in_step=True), truth)
    assert kept.cameras[1].params == truth[1].params and kept.solved.focal_std_px.max() == 0
    assert errors(kept.cameras, truth)[1] < 3 * kept.solved.position_std[1]


def test_selected_times_cover_new_positions_of_the_board():
    rng = np.random.default_rng(10)
    truth = ring(2)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 300, 2), rng)
    times = sorted(set().union(*views.values()))
    chosen = choose_times(views, sizes(truth), 20)
    assert len(chosen) == 20 and set(chosen) <= set(times)

    def covered(which):
        px = np.concatenate([views["c0"][t][1] for t in which if t in views["c0"]])
        return len(np.unique((px // 100).astype(int), axis=0))

    assert covered(chosen) > 1.1 * np.mean([covered(rng.choice(times, 20, replace=False)) for _ in range(20)])
    assert choose_times(views, sizes(truth), 1000) == times


def test_the_board_on_the_floor_is_the_world():
    truth = ring(4)
    for pose in (np.eye(4)[:3], np.column_stack([np.diag([1.0, -1, -1]), [0.3, 0.2, 0.1]])):
        world = transform_cameras(truth, on_board(truth, pose))
        assert world.centers_world[:, 2].min() > 0.9
    with pytest.raises(CalibrationError, match="c0.* from below"):
        on_board(truth, np.column_stack([np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]]), [2.4, 0, 0]]))
    guessed = transform_cameras(in_first(truth), level_transform(in_first(truth), np.zeros((1, 3)) + [0, 0, 2.5]))
    up = guessed[0].rotation @ np.array([0, 0, 1.0]) @ (truth[0].rotation @ [0, 0, 1.0])
    assert np.degrees(np.arccos(up)) < 3
