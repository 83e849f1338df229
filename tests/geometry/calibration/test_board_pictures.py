"""Pairing of pictures of a board, and views that determine a pose."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.extrinsics import BoardOptions, calibrate_rig
from muybridge.geometry.calibration.board.intrinsics import board_pose, usable
from muybridge.geometry.calibration.board.pose_graph import chain
from muybridge.geometry.calibration.board.view_selection import choose_times
from muybridge.geometry.calibration.bundle_adjustment.result import misfits
from muybridge.geometry.calibration.diagnosis.quality import check_solved
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.calibration.board import format_summary
from muybridge.infer.pipelines.calibration.board_images import at_moment, find_images
from muybridge.infer.report.calibration_findings import calibration_findings
from muybridge.infer.report.findings import Finding

BOARD = Board("charuco", 7, 5, 0.08)
SIZE = (640, 480)


def camera(k):
    turn = exp_so3(np.array([0, 0.35 * k, 0.0]))
    return Camera(
        f"cam{k}", "OPENCV", *SIZE, (600.0 + 20 * k, 600.0 + 20 * k, 319.5, 239.5, 0, 0, 0, 0),
        np.column_stack([turn, -turn @ np.array([0.6 * k, 0.0, 0.0])]),
    )  # fmt: skip


def shown(count=14, cameras=2, board=BOARD, bumped=None, moments=()):
    """Views by camera and time of a moved board; one camera is rotated at some times."""
    rng, middle = np.random.default_rng(0), board.corners.mean(axis=0)
    views = {f"cam{k}": {} for k in range(cameras)}
    for t in range(count):
        turn = exp_so3(rng.uniform(-0.3, 0.3, size=3) + [0.5 * (-1) ** t, 0.4 * (-1) ** (t // 2), 0])
        place = np.array([0.25 + rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(1.3, 1.8)])
        world = (board.corners - middle) @ turn.T + place
        for k in range(cameras):
            c = camera(k)
            if k == bumped and t in moments:
                c = c.posed(exp_so3(np.array([0, 0.07, 0])) @ c.cam_from_world)
            px = c.project(world) + rng.normal(size=(len(world), 2)) * 0.1
            views[f"cam{k}"][t] = (np.arange(len(world)), px)
    return views


SIZES = {"cam0": SIZE, "cam1": SIZE, "cam2": SIZE}


@pytest.mark.parametrize("ids", [[0, 1, 2, 3, 4, 23], [23, 0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5, 11]])
def test_corners_on_a_line_but_one_determine_no_pose(ids):
    ids = np.array(ids)
    whole, px = shown()["cam0"][0]
    view = (ids, px[ids])
    assert usable(BOARD, [view]) == [] and len(usable(BOARD, [(whole, px)])) == 1
    two_off = np.array([0, 1, 2, 3, 4, 22, 23])
    assert len(usable(BOARD, [(two_off, px[two_off])])) == 1
    np.testing.assert_allclose(board_pose(camera(0), BOARD, view)[:3, :3] @ np.array([0, 0, 1]), [0, 0, 1])


def test_a_view_without_a_pose_does_not_end_a_calibration():
    views = shown()
    ids = np.array([0, 1, 2, 3, 4, 23])
    views["cam1"][14] = (ids, views["cam1"][3][1][ids])
    rig = calibrate_rig(BOARD, views, SIZES, BoardOptions(in_step=True))
    apart = np.linalg.norm(np.diff(rig.cameras.centers_world, axis=0))
    assert apart == pytest.approx(0.6, abs=0.02) and rig.unused["cam1"] == 1


def test_a_required_time_is_selected():
    views = shown()
    usual = choose_times(views, SIZES, 5)
    other = next(t for t in range(14) if t not in usual)
    assert other in choose_times(views, SIZES, 5, other) and len(choose_times(views, SIZES, 5, other)) == 5
    assert choose_times(views, SIZES, 5, 99) == usual
    rig = calibrate_rig(BOARD, views, SIZES, BoardOptions(max_views=5, in_step=True), kept=other)
    assert other in rig.times
    with pytest.raises(CalibrationError, match="moment 99: .* name another one"):
        calibrate_rig(BOARD, views, SIZES, BoardOptions(in_step=True), kept=99)


def searched(pictures):
    return [p.moments[p.searched].tolist() for p in pictures]


def test_videos_of_different_lengths_are_searched_together(make_video, tmp_path, monkeypatch):
    monkeypatch.setattr("muybridge.infer.pipelines.calibration.board_images._MOST_SEARCHES", 5)
    for k, frames in enumerate((30, 32, 41)):
        make_video(tmp_path / f"cam{k}.mp4", frames=frames)
    assert searched(find_images(tmp_path)) == [[0, 9, 18, 27], [0, 9, 18, 27], [0, 9, 18, 27, 36]]
    assert searched(find_images(tmp_path, every=12)) == [[0, 12, 24], [0, 12, 24], [0, 12, 24, 36]]
    pictures = find_images(tmp_path, moment=31)
    assert searched(pictures) == [[0, 9, 18, 27], [0, 9, 18, 27, 31], [0, 9, 18, 27, 31, 36]]
    assert [p.name for p in at_moment(pictures, 31, "floor")] == ["cam1", "cam2"]
    with pytest.raises(CalibrationError, match="floor 41: no camera has an image .* numbers from 0 to 40"):
        at_moment(find_images(tmp_path, moment=41), 41, "floor")


@pytest.mark.parametrize("rates", [(30, 25), (25, 60), (30, 24)])
def test_videos_of_different_rates_are_searched_together(make_video, tmp_path, rates):
    for k, rate in enumerate(rates):
        make_video(tmp_path / f"cam{k}.mp4", frames=2 * rate, fps=rate)
    first, second = find_images(tmp_path, moment=7)
    step = round(rates[0] / 6)
    wanted = sorted({7, *range(0, 2 * rates[0], step)})
    assert searched([first, second]) == [wanted, wanted]
    times = [p.searched / rate for p, rate in zip((first, second), rates, strict=True)]
    assert np.abs(times[0] - times[1]).max() <= 0.5 / min(rates) + 1e-3


def test_moments_of_a_table_may_be_far_apart(make_video, tmp_path):
    rows = ["sync_index,cam_id,frame_time"]
    for k in range(2):
        make_video(tmp_path / f"cam_{k}.mp4", frames=4)
        rows += [f"{1_700_000_000_000_000 + 33_333 * (n + k)},{k},{n / 30}" for n in range(4)]
    (tmp_path / "timestamps.csv").write_text("\n".join(rows))
    first, second = searched(find_images(tmp_path))
    assert len(first) == len(second) == 4 and first[1:] == second[:3]


def test_images_named_by_long_numbers_are_paired(tmp_path):
    numbers = [20240503120000123456 + 200000 * k for k in range(4)]
    for name, mine in (("cam0", numbers[:3]), ("cam1", numbers[1:])):
        (tmp_path / name).mkdir()
        for n in mine:
            (tmp_path / name / f"{n}.png").touch()
    first, second = find_images(tmp_path)
    assert first.moments.tolist() == [0, 1, 2] and second.moments.tolist() == [1, 2, 3]
    assert first.moments.dtype == np.int64


def test_a_floor_image_without_a_board_is_an_early_error(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(
        "muybridge.infer.pipelines.calibration.board.check_seen", lambda *a: pytest.fail("the long work began")
    )
    for k in range(2):
        (tmp_path / f"cam{k}").mkdir()
        for t in range(3):
            cv2.imwrite(str(tmp_path / f"cam{k}" / f"{t}.png"), np.full((48, 64), 90, np.uint8))
    arguments = ["calibrate", "board", str(tmp_path), "--square", "0.05", "--out", str(tmp_path / "c.toml")]
    for floor, message in (("2", "was not seen at that moment"), ("3", "no camera has an image of that number")):
        assert run_command([*arguments, "--floor", floor]) == 2
        assert f"floor {floor}: " in (line := capfd.readouterr().err) and message in line


def test_a_moved_camera_is_reported_with_its_times():
    options = BoardOptions(in_step=True)
    assert misfits(calibrate_rig(BOARD, shown(cameras=3), SIZES, options).solved) == ()
    views = shown(cameras=3, bumped=2, moments=range(5))
    (wrong,) = misfits(calibrate_rig(BOARD, views, SIZES, options).solved)
    assert wrong.grave and "Views of camera cam2 that do not fit" in wrong.sentence
    assert "5 of 14" in wrong.sentence and "moments 0 to 4)" in wrong.sentence
    rig = calibrate_rig(BOARD, shown(cameras=3, bumped=1, moments=[7]), SIZES, options)
    (minor,) = misfits(rig.solved)
    assert not minor.grave and "camera cam1" in minor.sentence and "moments 7)" in minor.sentence
    assert minor.sentence in format_summary(rig)
    for found, severity in ((wrong, "bad"), (minor, "look")):
        quality = replace(check_solved(rig.solved, "a board"), misfits=(found,))
        assert Finding(severity, found.sentence) in calibration_findings(quality)


@pytest.mark.parametrize("count", [3, 5, 14])
def test_a_mirrored_camera_is_reported_for_symmetric_boards(count):
    board = Board("checkerboard", 7, 5, 0.08)
    mirror = np.arange(35).reshape(5, 7)[:, ::-1].ravel()
    mine = {t: board_pose(camera(0), board, v) for t, v in shown(count, board=board)["cam0"].items()}
    other = {}
    for t, (ids, px) in shown(count, board=board)["cam1"].items():
        other[t] = board_pose(camera(1), board, (ids, (px * [-1, 1] + [SIZE[0] - 1, 0])[mirror]))
    with pytest.raises(CalibrationError, match="camera cam1: .*its pictures are mirrored"):
        chain(["cam0", "cam1"], [mine, other], board)
