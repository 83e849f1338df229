"""Boards and recordings that went wrong: clocks beside the videos, other numbers of markers, a print on the back."""

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board, BoardDetector, fitting_descriptions, seen_markers
from muybridge.geometry.calibration.board.extrinsics import BoardOptions, calibrate_rig
from muybridge.geometry.calibration.board.pdf import board_pdf
from muybridge.infer.pipelines.calibration.board import read_board
from muybridge.infer.pipelines.calibration.board_images import clocks_of, find_images
from tests.geometry.calibration.test_board_rig import CHARUCO, errors, path, ring, sizes, views_of
from tests.infer.commands.test_calibrate_board import FLAGS, drawn, failed, pictures, run_command


def test_clocks_beside_the_videos_pair_their_frames(make_video, tmp_path):
    folder = tmp_path / "videos"
    folder.mkdir()
    for k in range(2):
        make_video(folder / f"cam{k}.mp4", frames=12, fps=30)
    assert clocks_of(folder, None, find_images(folder)) is None
    # cam1 began five frames later: what the reference shows at time t is at t - 5 / 30 s in its video.
    clocks = f"muybridge_sync = 1\n[cameras.cam0]\noffset = 0.0\n[cameras.cam1]\noffset = {-5 / 30}\n"
    for place, asked in ((folder, folder), (tmp_path, tmp_path), (tmp_path, folder)):
        sync = place / "sync.toml"
        sync.write_text(clocks)
        first, second = find_images(asked, every=1)
        assert clocks_of(asked, None, [first, second]) == sync
        assert first.moments.tolist() == list(range(12)) and second.moments.tolist() == list(range(5, 17))
        sync.unlink()
    (folder / "sync.toml").write_text(clocks)
    rows = ["sync_index,cam_id,frame_time"] + [f"{n},{k},{n / 30}" for k in range(2) for n in range(12)]
    (folder / "timestamps.csv").write_text("\n".join(rows))
    first, second = find_images(folder, every=1)
    assert second.moments.tolist() == list(range(12)) and clocks_of(folder, None, [first, second]) is None


def test_markers_that_are_numbered_from_another_number(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("muybridge.infer.pipelines.calibration.board._TRIED_IMAGES", 2)
    folder = pictures(tmp_path / "p", Board("charuco", 5, 7, 0.05, first_marker=20), count=4)
    line = failed(capfd, "board", folder, *FLAGS, "--out", tmp_path / "c.toml")
    assert "markers 20 to 36 are seen, 0 to 16 expected" in line and "checkerboard" not in line
    assert "charuco 5 x 7, DICT_4X4_50, markers from 20" in line
    given = [*FLAGS, "--first-marker", "20", "--quiet", "--out", str(tmp_path / "c.toml")]
    assert run_command(["calibrate", "board", str(folder), *given]) == 0
    file = tmp_path / "board.toml"
    file.write_text('columns = 5\nrows = 7\nsquare = 0.05\ndictionary = "DICT_4X4_50"\nfirst_marker = 20\n')
    assert read_board(file) == Board("charuco", 5, 7, 0.05, first_marker=20)
    with pytest.raises(ValueError, match="first marker"):
        Board("charuco", 5, 7, 0.05, first_marker=-1)


def test_a_board_of_other_numbers_is_printed_as_such():
    board = Board("charuco", 5, 7, 0.03, first_marker=20)
    image = cv2.copyMakeBorder(drawn(board)[0], 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=255)
    assert seen_markers(board, [image]) == range(20, 37)
    assert len(BoardDetector(board).detect(image)[0]) == len(board.corners)
    assert fitting_descriptions(Board("charuco", 5, 7, 0.03), [image])[0].endswith("markers from 20")
    assert b"markers from 20" in board_pdf(board)


def backs(views, board, names):
    """The views of cameras that see the same print on the board's back."""
    wide, high = board.columns - 1, board.rows - 1
    ids = np.arange(wide * high).reshape(high, wide)[:, ::-1].ravel()  # the corner behind each
    return {n: {t: (ids[i], px) for t, (i, px) in mine.items()} if n in names else mine for n, mine in views.items()}


def test_the_same_print_on_both_sides_is_not_called_mirrored():
    rng = np.random.default_rng(5)
    truth = ring(2, radius=2.0)
    views = views_of(truth, CHARUCO, path(rng, 1), range(0, 120, 2), rng)
    with pytest.raises(CalibrationError, match="camera c1: .*sees the board's back") as caught:
        calibrate_rig(CHARUCO, backs(views, CHARUCO, ["c1"]), sizes(truth), BoardOptions(in_step=True))
    assert "mirrored" not in str(caught.value)


def test_a_board_with_two_faces_as_caliscope_describes_it(tmp_path):
    file = tmp_path / "charuco.toml"
    file.write_text("columns = 5\nrows = 7\nsquare_size_override_cm = 5.0\nthickness_cm = 0.5\n")
    board = read_board(file)
    assert board.thickness == 0.005 and "two faces" in board.describe()
    count = len(board.corners) // 2
    np.testing.assert_array_equal(board.corners[count:] - board.corners[:count], [[0, 0, 0.005]] * count)
    front = drawn(Board("charuco", 5, 7, 0.05))[0]
    ids, px = BoardDetector(board).detect(front)
    assert len(ids) == count and ids.max() == count - 1
    behind, there = BoardDetector(board).detect(np.ascontiguousarray(front[:, ::-1]))
    assert sorted(behind - count) == list(range(count))
    at = dict(zip(ids.tolist(), px, strict=True))
    expected = np.array([[front.shape[1] - 1 - at[k][0], at[k][1]] for k in (behind - count).tolist()])
    np.testing.assert_allclose(there, expected, atol=0.05)
    file.write_text('columns = 5\nrows = 7\nsquare_size_override_cm = 5.0\nthickness_cm = "thick"\n')
    with pytest.raises(CalibrationError, match="thickness_cm is 'thick', not a number"):
        read_board(file)


def test_cameras_around_a_board_with_two_faces():
    rng = np.random.default_rng(6)
    truth, board = ring(3), Board("charuco", 7, 10, 0.06, thickness=0.01)
    count = len(board.corners) // 2
    seen = views_of(truth, board, path(rng, 1), range(0, 90, 3), rng)
    pose = path(np.random.default_rng(6), 1)
    views = {}
    for camera in truth:
        views[camera.name] = {}
        for t, (_, px) in seen[camera.name].items():
            turn, place = pose(t)
            front = turn[:, 2] @ (place - camera.center_world) > 0  # the print's z axis points into the board
            half = slice(0, count) if front else slice(count, None)
            views[camera.name][t] = (np.arange(2 * count)[half], px[half])
    assert any(i[0] >= count for i, _ in views["c1"].values())
    result = calibrate_rig(board, views, sizes(truth), BoardOptions(in_step=True))
    assert (errors(result.cameras, truth)[1:] < 4 * result.solved.position_std[1:]).all()
    assert result.solved.rms_px.max() < 0.4
