"""`muybridge calibrate board` and `print-board` as a user runs them: films, images, and everything that goes wrong."""

import re
import shutil
import zlib

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.board.board import Board, BoardDetector, fitting_descriptions
from muybridge.geometry.calibration.board.extrinsics import calibrate_rig
from muybridge.geometry.calibration.board.intrinsics import calibrate_lens, usable
from muybridge.geometry.calibration.board.pdf import PAPERS, board_pdf, board_rectangles
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.calibration.board_images import find_board, find_images
from muybridge.infer.runtime.progress import Progress

SIZE = (640, 480)
BOARD = Board("charuco", 5, 7, 0.05)
FLAGS = ["--columns", "5", "--rows", "7", "--square", "0.05"]


def drawn(board, px_per_m=2000):
    """An image of a printed board with a white margin of a square, and (3, 3) px from metres of the board."""
    rectangles, (width, height) = board_rectangles(board)
    image = np.full([round((v + 2 * board.square) * px_per_m) for v in (height, width)], 255, np.uint8)
    for x, y, w, h in rectangles + np.array([board.square, board.square, 0, 0]):
        a, b = (int(round(v * px_per_m)) for v in (x, y))
        image[b : int(round((y + h) * px_per_m)), a : int(round((x + w) * px_per_m))] = 0
    first = board.square * (2 if board.kind == "checkerboard" else 1)  # where the corners' coordinates begin
    scale = np.diag([px_per_m, px_per_m, 1.0])
    scale[:2, 2] = first * px_per_m - 0.5
    return (255 - image if board.inverted else image), scale


def camera(k):
    """Two cameras, side by side, without distortion."""
    turn = exp_so3(np.array([0, 0.35 * k, 0.0]))
    center = np.array([0.35 * k, 0.0, 0.0])
    pose = np.column_stack([turn, -turn @ center])
    return Camera(f"cam{k}", "PINHOLE", *SIZE, (620.0 + 20 * k, 620.0 + 20 * k, 322.0, 236.0), pose)


def pictures(folder, board=BOARD, count=9, cameras=2, moved=lambda image, k: image):
    """Folders of images of a board that two cameras see at once."""
    texture, px_from_board = drawn(board)
    middle = board.corners.mean(axis=0)
    rng = np.random.default_rng(0)
    for t in range(count):
        turn = exp_so3(rng.uniform(-0.3, 0.3, size=3) + [0.5 * (-1) ** t, 0.4 * (-1) ** (t // 2), 0])
        place = np.array([0.12 + rng.uniform(-0.1, 0.1), rng.uniform(-0.06, 0.06), rng.uniform(0.75, 1.0)])
        world = np.column_stack([turn, place - turn @ middle])
        for k in range(cameras):
            c = camera(k)
            flat = c.camera_matrix @ (c.cam_from_world @ np.vstack([world, [0, 0, 0, 1]]))[:, [0, 1, 3]]
            image = cv2.warpPerspective(
                texture, flat @ np.linalg.inv(px_from_board), SIZE, flags=cv2.INTER_AREA, borderValue=110
            )
            path = folder / c.name / f"{c.name}_{t:02d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), moved(cv2.GaussianBlur(image, (3, 3), 0.8), k))
    return folder


def failed(capfd, *arguments):
    """What a command that cannot work says, in one line."""
    assert run_command(["calibrate", *map(str, arguments)]) == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("error:")]
    assert len(lines) == 1
    return lines[0]


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    return pictures(tmp_path_factory.mktemp("shown"))


def test_images_become_a_calibration_file(shown, tmp_path, capfd):
    out = tmp_path / "c.toml"
    assert run_command(["calibrate", "board", str(shown), *FLAGS, "--out", str(out), "--floor", "3"]) == 0
    said = capfd.readouterr().out
    assert "camera" in said and "focal px" in said and "+-" in said and "median reprojection error" in said
    found = load_calibration(out)
    assert found.names == ("cam0", "cam1")
    apart = np.linalg.norm(found[1].center_world - found[0].center_world)
    assert apart == pytest.approx(0.35, abs=0.01)
    for k, c in enumerate(found):
        assert c.params[0] == pytest.approx(camera(k).params[0], rel=0.02)
        assert c.center_world[2] > 0.3  # above the floor
    line = failed(capfd, "board", shown, *FLAGS, "--floor", 99, "--out", out)
    assert "floor 99: no camera has an image of that number; they have numbers from 0 to 8" in line
    again = tmp_path / "again.toml"
    world = ["world", out, "--floor-board", shown, *FLAGS, "--out", again]
    assert run_command(["calibrate", *map(str, world), "--moment", "3"]) == 0
    np.testing.assert_allclose(load_calibration(again).centers_world, found.centers_world, atol=0.01)
    assert "it must lie still on the floor" in failed(capfd, *world)
    assert "moment 99: no camera has an image of that number" in failed(capfd, *world, "--moment", 99)
    assert run_command(["calibrate", *map(str, world), "--moment", "4"]) == 0
    assert np.abs(load_calibration(again).centers_world - found.centers_world).max() > 0.05


def test_lenses_first_then_poses(shown, tmp_path, capfd):
    lenses, out = tmp_path / "lenses.toml", tmp_path / "c.toml"
    base = ["calibrate", "board", str(shown), *FLAGS, "--quiet"]
    assert run_command([*base, "--lenses-only", "--out", str(lenses)]) == 0
    assert "no camera has a pose yet" in capfd.readouterr().out
    assert run_command([*base, "--lenses", str(lenses), "--out", str(out)]) == 0
    assert load_calibration(out)[1].params == load_calibration(lenses)[1].params
    assert "(held)" in capfd.readouterr().out


def test_a_checkerboard_of_images(tmp_path):
    board = Board("checkerboard", 5, 8, 0.03)
    folder = pictures(tmp_path / "pictures", board)
    out = tmp_path / "c.toml"
    flags = ["--board", "checkerboard", "--columns", "5", "--rows", "8", "--square", "0.03", "--quiet"]
    assert run_command(["calibrate", "board", str(folder), *flags, "--out", str(out)]) == 0
    found = load_calibration(out)
    assert np.linalg.norm(found[1].center_world - found[0].center_world) == pytest.approx(0.35, abs=0.01)
    again = tmp_path / "again.toml"
    world = [str(out), "--floor-board", str(folder), "--moment", "2", *flags, "--out", str(again)]
    assert run_command(["calibrate", "world", *world]) == 0
    moved = load_calibration(again)
    assert np.linalg.norm(moved[1].center_world - moved[0].center_world) == pytest.approx(0.35, abs=0.01)
    assert (moved.centers_world[:, 2] > 0.3).all()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--columns", "7", "--rows", "5"], "would be found as: charuco 5 x 7, DICT_4X4_50"),
        pytest.param(
            ["--columns", "5", "--rows", "7", "--inverted"],
            "would be found as: charuco 5 x 7, DICT_4X4_50",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ["--columns", "5", "--rows", "7", "--dictionary", "DICT_6X6_250"],
            "charuco 5 x 7, DICT_4X4_50",
            marks=pytest.mark.slow,
        ),
        (["--columns", "5", "--rows", "7", "--dictionary", "DICT_4X5"], "no marker dictionary 'DICT_4X5'"),
        (["--columns", "5", "--rows", "7", "--dictionary", "ArucoDetector"], "no marker dictionary 'ArucoDetector'"),
        (["--columns", "1", "--rows", "7"], "at least 2 x 2"),
    ],
)
def test_a_wrong_description_is_told_the_right_one(shown, tmp_path, capfd, monkeypatch, flags, said):
    monkeypatch.setattr("muybridge.infer.pipelines.calibration.board._TRIED_IMAGES", 6)
    assert said in failed(capfd, "board", shown, *flags, "--square", "0.05", "--out", tmp_path / "c.toml")


@pytest.mark.parametrize(("square", "meant"), [("80", "0.08"), ("8", "0.08"), ("3.5", "0.035"), ("35", "0.035")])
def test_squares_of_metres_are_refused(tmp_path, capfd, square, meant):
    line = failed(capfd, "board", tmp_path, "--square", square)
    assert f"squares of {square} m; their side is given in metres: did you mean {meant}?" in line


def test_mirrored_pictures_and_no_board(tmp_path, capfd):
    mirrored = pictures(tmp_path / "m", count=3, cameras=1, moved=lambda image, k: image[:, ::-1])
    line = failed(capfd, "board", mirrored, *FLAGS, "--out", tmp_path / "c.toml")
    assert "is in none of the 3 images" in line and "mirrored left to right" in line
    empty = pictures(tmp_path / "e", count=3, cameras=1, moved=lambda image, k: image * 0 + 90)
    line = failed(capfd, "board", empty, *FLAGS, "--out", tmp_path / "c.toml")
    assert "is in none of the 3 images" in line and "white margin" in line
    assert not (tmp_path / "c.toml").exists()


def test_a_camera_that_sees_the_board_too_rarely_or_never_with_the_others(shown, tmp_path, capfd, monkeypatch):
    # Other descriptions are tried above, for seconds each time.
    monkeypatch.setattr("muybridge.infer.pipelines.calibration.board.fitting_descriptions", lambda wanted, images: [])
    few = shutil.copytree(shown, tmp_path / "few")
    for path in sorted((few / "cam1").iterdir())[3:]:
        path.unlink()
    line = failed(capfd, "board", few, *FLAGS, "--out", tmp_path / "c.toml")
    assert re.search("camera cam1: the board .* is seen in [1-3] of 3 images, at least 4 are needed", line)
    apart = shutil.copytree(shown, tmp_path / "apart")
    for path in sorted((apart / "cam1").iterdir()):
        path.rename(path.with_name(path.name.replace("cam1_0", "cam1_5")))
    line = failed(capfd, "board", apart, *FLAGS, "--out", tmp_path / "c.toml")
    assert "cam1: no view of the board is shared with cam0" in line


def test_images_of_different_sizes_and_broken_ones(shown, tmp_path, capfd):
    folder = shutil.copytree(shown, tmp_path / "sizes")
    odd = folder / "cam0" / "cam0_04.png"
    cv2.imwrite(str(odd), np.zeros((240, 320), np.uint8))
    line = failed(capfd, "board", folder, *FLAGS, "--out", tmp_path / "c.toml")
    assert "cam0_04.png: 320 x 240 px, the other images of camera cam0 640 x 480" in line
    odd.write_bytes(b"not an image")
    assert "cam0_04.png: cannot be read" in failed(capfd, "board", folder, *FLAGS, "--out", tmp_path / "c.toml")


def test_folders_without_pictures(tmp_path, capfd):
    assert "no such folder" in failed(capfd, "board", tmp_path / "none")
    assert "neither videos nor folders" in failed(capfd, "board", tmp_path)


def test_films_are_paired_by_their_time_stamps(make_video, tmp_path, capfd):
    for k in range(2):
        make_video(tmp_path / f"cam_{k}.mp4", frames=4)
    rows = ["sync_index,cam_id,frame_time"]
    rows += [f"{10 + n},0,{n / 30}" for n in range(4)] + [f"{11 + n},1,{n / 30}" for n in range(4)]
    (tmp_path / "timestamps.csv").write_text("\n".join(rows))
    first, second = find_images(tmp_path)
    assert first.moments.tolist() == [10, 11, 12, 13] and second.moments.tolist() == [11, 12, 13, 14]
    (tmp_path / "timestamps.csv").write_text("\n".join(rows[:-1]))
    with pytest.raises(CalibrationError, match="3 rows for cam_1, whose video has 4 frames"):
        find_images(tmp_path)
    (tmp_path / "timestamps.csv").write_text("\n".join(rows[:5]))
    with pytest.raises(CalibrationError, match="no rows for cam_1; it has cam_id 0"):
        find_images(tmp_path)
    (tmp_path / "timestamps.csv").write_text("a,b\n1,2\n")
    with pytest.raises(CalibrationError, match="needs the columns sync_index, cam_id, frame_time"):
        find_images(tmp_path)


def rectangles_of(pdf):
    """(N, 5) x, y from the top, width, height in points and how light; and the page's size, of our own PDFs."""
    assert pdf.startswith(b"%PDF-1.4") and pdf.rstrip().endswith(b"%%EOF")
    start = int(re.search(rb"startxref\n(\d+)", pdf)[1])
    assert pdf[start : start + 4] == b"xref"
    for offset in re.findall(rb"^(\d{10}) 00000 n", pdf, re.M):
        assert re.match(rb"\d+ 0 obj", pdf[int(offset) :])
    page = [float(v) for v in re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf).groups()]
    length, content = re.search(rb"/Length (\d+) >>\nstream\n(.*)\nendstream", pdf, re.S).groups()
    assert int(length) == len(content) and zlib.crc32(content)
    out, waiting, gray = [], [], 0.0
    for line in content.decode().splitlines():
        words = line.split()
        if words[-1] == "re":
            waiting.append([float(v) for v in words[:4]])
        if "f" in words:
            out += [[x, page[1] - y - h, w, h, gray] for x, y, w, h in waiting]
            waiting = []
        if "g" in words:
            gray = float(words[words.index("g") - 1])
    return np.array(out), page


@pytest.mark.parametrize(
    "board",
    [
        Board("charuco", 5, 7, 0.03),
        Board("charuco", 6, 8, 0.025, 0.7, "DICT_5X5_100", legacy=True),
        Board("charuco", 5, 6, 0.03, inverted=True),
        Board("checkerboard", 5, 8, 0.025),
    ],
)
def test_a_printed_board_is_found_and_has_its_true_size(board):
    drawing, page = rectangles_of(board_pdf(board, PAPERS["a4"]))
    np.testing.assert_allclose(sorted(page), [595.276, 841.890], atol=0.01)
    assert (drawing[:, :2] >= 0).all() and (drawing[:, 0] + drawing[:, 2] <= page[0]).all()
    image = np.full((round(page[1] * 3), round(page[0] * 3)), 255, np.uint8)  # three pixels a point
    for x, y, w, h, gray in drawing:
        left, top, right, bottom = np.round(3 * np.array([x, y, x + w, y + h])).astype(int)
        image[top:bottom, left:right] = round(255 * gray)
    ids, px = BoardDetector(board).detect(image)
    assert len(ids) == len(board.corners)
    metres = (px - px.mean(axis=0)) / 3 / 72 * 0.0254
    known = (board.corners[ids] - board.corners[ids].mean(axis=0))[:, :2]
    turned = min(np.abs(s * metres - known).max() for s in (1, -1))  # a checkerboard may be found from its end
    assert turned < 2e-4


def test_print_board(tmp_path, capfd):
    out = tmp_path / "board.pdf"
    assert run_command(["calibrate", "print-board", str(out)]) == 0
    assert "100 %" in capfd.readouterr().out
    _, page = rectangles_of(out.read_bytes())
    assert page[0] > page[1]  # the default board lies across
    assert "needs 434 x" in failed(capfd, "print-board", out, "--columns", "11", "--square", "0.038")
    assert "ends in .pdf" in failed(capfd, "print-board", tmp_path / "board.png")
    assert "larger dictionary" in failed(
        capfd, "print-board", out, "--columns", "20", "--rows", "20", "--square", "0.01"
    )


def distances(cameras):
    centers = cameras.centers_world
    return np.linalg.norm(centers[:, None] - centers, axis=-1)[np.triu_indices(len(centers), 1)]


@pytest.fixture(scope="module")
def webcams(real_data):
    """Four webcams that filmed a ChArUco board: the board, views and sizes."""
    board = Board("charuco", 4, 5, 0.054, 0.75, "DICT_4X4_1000", inverted=True)
    return board, *find_board(find_images(real_data / "charuco"), board, Progress(quiet=True))


def test_webcams_that_filmed_a_board(webcams):
    board, views, sizes = webcams
    result = calibrate_rig(board, views, sizes)
    assert np.median(result.solved.errors_px) <= 0.4
    assert (result.solved.rms_px <= 1.15 * np.array([0.54, 0.40, 0.37, 0.33])).all()
    # The other program's cameras, which take all frames for simultaneous, are 5 % off ours at most.
    assert np.abs(distances(result.cameras) / [1.149, 0.533, 0.417, 0.953, 1.438, 0.616] - 1).max() < 0.06


@pytest.mark.slow
def test_halves_of_the_moments_agree(webcams):
    board, views, sizes = webcams
    halves = []
    for half in (0, 1):
        some = {n: {t: v for t, v in mine.items() if t % 2 == half} for n, mine in views.items()}
        halves.append(distances(calibrate_rig(board, some, sizes).cameras))
    assert np.abs(halves[0] / halves[1] - 1).max() < 0.01


@pytest.mark.slow
def test_halves_of_the_moments_differ_by_what_is_told(webcams):
    board, views, sizes = webcams
    scores = []
    for name, mine in views.items():
        fit = {t: v for t, v in sorted(mine.items()) if usable(board, [v])}
        times = list(fit)
        halves = [calibrate_lens(name, board, {t: fit[t] for t in times[k::2]}, sizes[name]) for k in (0, 1)]
        (a, b), (u, v) = zip(*((h.camera.params, np.diag(h.result.covariances[0])[:8]) for h in halves), strict=True)
        scores.append((np.array(a) - b) / np.sqrt(u + v))
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.5


def test_wrong_descriptions_of_a_filmed_board(real_data):
    film = cv2.VideoCapture(str(real_data / "charuco" / "cam_0.mp4"))
    image = next(frame for k in range(36) if (frame := film.read()[1]) is not None and k == 35)
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    wrong = Board("charuco", 5, 4, 0.054, 0.75, "DICT_4X4_1000", inverted=True)
    assert fitting_descriptions(wrong, [gray])[0].startswith("charuco 4 x 5, DICT_4X4_")
    # The pictures that show the board are found among those that do not.
    blank = np.full_like(gray, 120)
    assert fitting_descriptions(wrong, [blank, blank, gray, blank, blank])[0].startswith("charuco 4 x 5, DICT_4X4_")


def test_lenses_within_a_hundredth_of_qualisys(real_data, tmp_path):
    folder = real_data / "balancing" / "calibration"
    out = tmp_path / "lenses.toml"
    flags = ["--board", "checkerboard", "--columns", "4", "--rows", "7", "--square", "0.06", "--lenses-only", "--quiet"]
    assert run_command(["calibrate", "board", str(folder / "intrinsics"), *flags, "--out", str(out)]) == 0
    theirs = load_calibration(folder / "Calib.qca.txt")
    for found, known in zip(load_calibration(out), theirs, strict=True):
        np.testing.assert_allclose(found.params[:2], known.params[:2], rtol=0.01)
