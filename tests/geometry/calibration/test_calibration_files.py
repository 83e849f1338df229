"""Our own calibration file keeps every bit; a session's calibration is found or its absence explained."""

import os
import shutil
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.errors import CalibrationError, OutputError
from muybridge.geometry.calibration import (
    find_calibration,
    load_calibration,
    read_calibration,
    save_calibration,
)
from muybridge.geometry.cameras.camera import CAMERA_MODELS, Camera
from muybridge.geometry.cameras.group import CameraGroup
from tests.paths import DATA

N_PARAMS = dict(
    SIMPLE_PINHOLE=3, PINHOLE=4, SIMPLE_RADIAL=4, SIMPLE_RADIAL_FISHEYE=4, RADIAL=5, RADIAL_FISHEYE=5,
    OPENCV=8, OPENCV_FISHEYE=8, FULL_OPENCV=12, FOV=5, THIN_PRISM_FISHEYE=12, RAD_TAN_THIN_PRISM_FISHEYE=16,
    SIMPLE_DIVISION=4, DIVISION=5, SIMPLE_FISHEYE=3, FISHEYE=4, EUCM=6,
)  # fmt: skip

SINGLE_FOCAL = [m for m in N_PARAMS if m.startswith("SIMPLE") or m.startswith("RADIAL")]
names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)


@st.composite
def any_camera(draw: st.DrawFn, name: str) -> Camera:
    model = draw(st.sampled_from(CAMERA_MODELS))
    sides = draw(st.integers(2, 100_000)), draw(st.integers(2, 100_000))
    focal = st.floats(0.01, 1000.0).map(lambda ratio: max(ratio * max(sides), 0.01 * max(sides)))
    term = st.floats(-1e6, 1e6)
    focals = 1 if model in SINGLE_FOCAL else 2
    middle = [side / 2 + draw(st.floats(-9.9, 9.9)) * max(sides) for side in sides]
    params = [draw(focal) for _ in range(focals)] + middle
    params += [draw(term) for _ in range(N_PARAMS[model] - len(params))]
    vector = np.array(draw(st.lists(st.floats(-4, 4), min_size=3, max_size=3)))
    translation = draw(st.lists(st.floats(-500, 500), min_size=3, max_size=3))
    pose = np.column_stack([cv2.Rodrigues(vector)[0], translation])
    return Camera(name, model, *sides, tuple(params), pose)


@st.composite
def any_group(draw: st.DrawFn) -> CameraGroup:
    return CameraGroup(tuple(draw(any_camera(n)) for n in draw(st.lists(names, min_size=1, max_size=4, unique=True))))


@settings(max_examples=200, deadline=None)
@given(group=any_group())
def test_own_toml_keeps_every_bit(tmp_path_factory: pytest.TempPathFactory, group: CameraGroup) -> None:
    path = tmp_path_factory.mktemp("own") / "calibration.toml"
    save_calibration(group, path)
    assert load_calibration(path) == group  # cameras compare by the value of every stored number
    for a, b in zip(load_calibration(path), group, strict=True):
        assert a.cam_from_world.tobytes() == b.cam_from_world.tobytes()
        assert np.array(a.params).tobytes() == np.array(b.params).tobytes()


def group_of(n: int = 2) -> CameraGroup:
    params = (500.0, 500.0, 319.5, 239.5)
    poses = [np.column_stack([cv2.Rodrigues(np.array([1.2, 0.1 * k, 0.0]))[0], [0.5 * k, 0.0, 3.0]]) for k in range(n)]
    return CameraGroup(tuple(Camera(f"cam{k}", "PINHOLE", 640, 480, params, p) for k, p in enumerate(poses)))


def test_own_toml_is_readable(tmp_path: Path) -> None:
    save_calibration(group_of(), tmp_path / "calibration.toml")
    text = (tmp_path / "calibration.toml").read_text()
    assert tomllib.loads(text)["muybridge_calibration"] == 1
    assert "params = [500.0, 500.0, 319.5, 239.5]  # fx, fy, cx, cy" in text
    assert "Pixel (0, 0) is the centre of the top-left pixel" in text
    assert os.listdir(tmp_path) == ["calibration.toml"]  # nothing temporary is left


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("muybridge_calibration = 1", "muybridge_calibration = 2", "is 2; this release reads version 1"),
        ("height = 480", "", "camera cam0: height missing"),
        ("height = 480", "hight = 480\nheight = 480", "camera cam0: unknown field hight; valid: name"),
        ('"PINHOLE"', '"FISH"', "camera cam0: unknown camera model 'FISH'; known: SIMPLE_PINHOLE"),
        ("width = 640", "width = -640", "camera cam0: width is -640"),
        ("params = [500.0, ", "params = [", "camera cam0: model PINHOLE has 4 parameters, not 3"),
        ('name = "cam0"', 'name = ""', "camera 1: a camera needs a name"),
        ('name = "cam0"', 'name = "cam1"', "camera names repeat: cam1"),
        ("[[cameras]]", "[[camera]]", "it has no \\[\\[cameras\\]\\]"),
        ("cam_from_world = [", "cam_from_world = [1.0, ", "must be a list of 12 numbers"),
    ],
)
def test_errors_of_own_toml(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "calibration.toml"
    save_calibration(group_of(), path)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(CalibrationError, match=message) as caught:
        load_calibration(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_saving_where_there_is_no_folder(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="No such file or directory; choose a folder"):
        save_calibration(group_of(), tmp_path / "nowhere" / "calibration.toml")


def test_saving_replaces_whole_files_only(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    save_calibration(group_of(2), path)
    save_calibration(group_of(3), path)
    assert len(load_calibration(path)) == 3


def session_with(tmp_path: Path, **files: str) -> Path:
    (tmp_path / "calibration").mkdir()
    for name, text in files.items():
        (tmp_path / "calibration" / name.replace("__", ".")).write_text(text)
    return tmp_path


def own_text(tmp_path: Path) -> str:
    save_calibration(group_of(), tmp_path / "x")
    text = (tmp_path / "x").read_text()
    (tmp_path / "x").unlink()
    return text


def test_calibration_toml_in_the_session_comes_first(tmp_path: Path) -> None:
    text = own_text(tmp_path)
    session_with(tmp_path, a__toml=text, b__toml=text)
    (tmp_path / "calibration.toml").write_text(text)
    assert find_calibration(tmp_path) == tmp_path / "calibration.toml"


def test_the_only_calibration_is_found_among_other_files(tmp_path: Path) -> None:
    session_with(tmp_path, rig__toml=own_text(tmp_path), charuco__toml="columns = 4\n", notes__txt="hello")
    (tmp_path / "calibration" / ".rig.toml").write_text(own_text(tmp_path))
    (tmp_path / "calibration" / "old").mkdir()
    (tmp_path / "calibration" / "old" / "rig.toml").write_text(own_text(tmp_path))
    assert find_calibration(tmp_path) == tmp_path / "calibration" / "rig.toml"


def test_several_calibrations_are_an_error(tmp_path: Path) -> None:
    text = own_text(tmp_path)
    session_with(tmp_path, a__toml=text, b__toml=text)
    with pytest.raises(CalibrationError, match=r"several calibrations \(a.toml, b.toml\); leave one"):
        find_calibration(tmp_path)


def test_a_damaged_calibration_is_found_and_its_damage_reported(tmp_path: Path) -> None:
    text = own_text(tmp_path)
    session_with(tmp_path, rig__toml=text[: len(text) // 2])
    with pytest.raises(CalibrationError, match="damaged or incomplete Muybridge TOML calibration: broken TOML"):
        load_calibration(find_calibration(tmp_path))


@pytest.mark.parametrize("text", [True, False])
def test_a_colmap_model_counts_as_one(tmp_path: Path, text: bool) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    session_with(tmp_path, readme__txt="hello")
    model = pycolmap.Reconstruction()
    for k in (1, 2):
        lens = pycolmap.Camera(model="PINHOLE", width=64, height=48, params=[50, 50, 32, 24], camera_id=k)
        model.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(name=f"cam{k}.png", camera_id=k, image_id=k)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pycolmap.Rotation3d(), np.array([0, 0, k])))
    (model.write_text if text else model.write_binary)(tmp_path / "calibration")
    assert find_calibration(tmp_path) == tmp_path / "calibration"
    assert load_calibration(find_calibration(tmp_path)).names == ("cam1", "cam2")
    (tmp_path / "calibration" / "rig.toml").write_text(own_text(tmp_path))
    with pytest.raises(CalibrationError, match=r"several calibrations \(a COLMAP model, rig.toml\)"):
        find_calibration(tmp_path)


def test_no_calibration_says_what_is_expected(tmp_path: Path) -> None:
    expected = "put calibration.toml into .* known formats: Muybridge TOML, Qualisys"
    with pytest.raises(CalibrationError, match=f"no calibration; {expected}"):
        find_calibration(tmp_path)
    session_with(tmp_path)
    with pytest.raises(CalibrationError, match=f"known format; {expected}"):
        find_calibration(tmp_path)
    (tmp_path / "calibration" / "notes.txt").write_text("hello")
    with pytest.raises(CalibrationError, match=rf"known format \(notes.txt is of none\); {expected}"):
        find_calibration(tmp_path)
    with pytest.raises(CalibrationError, match="there is no such calibration file"):
        load_calibration(tmp_path / "nothing.toml")


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser reads every file")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    save_calibration(group_of(), path)
    path.chmod(0)
    with pytest.raises(CalibrationError, match="cannot be read: Permission denied"):
        load_calibration(path)


# --- real files ---------------------------------------------------------------------------------------------

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is not here")


@needs_data
def test_qualisys_file_of_the_balancing_take() -> None:
    calibration = read_calibration(find_calibration(DATA / "balancing"))
    assert calibration.format == "Qualisys" and calibration.notes == ()
    cameras = calibration.cameras
    assert cameras.names == ("cam01", "cam02", "cam03", "cam04")
    assert {(c.width, c.height) for c in cameras} == {(1088, 1920)}
    reference = np.load(DATA / "balancing" / "reference" / "openpose_body25b.npz")
    seen = reference["keypoints2d_px"].astype(np.float64)
    error = np.linalg.norm(cameras.project(reference["points3d_world"]) - seen[..., :2], axis=-1)
    median = np.nanmedian(np.where(seen[..., 2] > 0.3, error, np.nan), axis=(1, 2))
    # Other readers divide the distortion by 64; the poses themselves fit these keypoints to some 12 px.
    assert median.max() < 17 and median.mean() < 13


@needs_data
def test_qualisys_file_agrees_with_another_reader_of_it() -> None:
    """The triangulation case holds the same rig in OpenCV's terms, read by other code: K, pose, and the
    distortion divided by 64, which is that code's error."""
    case = np.load(DATA / "triangulation_case.npz")
    for k, camera in enumerate(load_calibration(find_calibration(DATA / "balancing"))):
        rotation = cv2.Rodrigues(case["rotvec_cam_from_world"][k])[0]
        np.testing.assert_allclose(camera.camera_matrix, case["camera_matrix"][k], rtol=1e-9)
        np.testing.assert_allclose(camera.rotation, rotation, atol=1e-6)
        np.testing.assert_allclose(camera.translation, case["translation_cam_from_world"][k], atol=1e-6)
        np.testing.assert_allclose(camera.params[4:], 64 * case["distortion_k1k2p1p2"][k], rtol=1e-9)


@needs_data
def test_caliscope_file_of_the_charuco_take_sees_the_board_from_all_cameras() -> None:
    """Corners of one board, seen at one time, triangulate well: the poses are world to camera."""
    cameras = load_calibration(DATA / "charuco" / "camera_array.toml")
    assert cameras.names == ("cam_0", "cam_1", "cam_2", "cam_3")
    residuals = board_residuals(cameras)
    assert len(residuals) > 30
    assert np.median(residuals) < 1.5


def board_residuals(cameras: CameraGroup) -> list[float]:
    """Reprojection error, px, of ChArUco corners seen by two cameras or more at one time."""
    rows = (DATA / "charuco" / "timestamps.csv").read_text().splitlines()
    frame_of: dict[tuple[int, int], int] = {}
    count = [0] * len(cameras)
    header = rows[0].split(",")
    for row in rows[1:]:
        value = dict(zip(header, row.split(","), strict=True))
        cam = int(value.get("cam_id", value.get("port", "0")))
        frame_of[cam, int(value["sync_index"])] = count[cam]
        count[cam] += 1
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((4, 5), 0.054, 0.0405, dictionary)
    detector = cv2.aruco.CharucoDetector(board)
    frames = [read_gray(DATA / "charuco" / f"cam_{k}.mp4") for k in range(len(cameras))]
    syncs = sorted({s for _, s in frame_of})
    residuals: list[float] = []
    for sync in syncs[:: max(1, len(syncs) // 8)]:
        seen: dict[int, list[tuple[int, np.ndarray]]] = {}
        for k in range(len(cameras)):
            index = frame_of.get((k, sync))
            if index is None or index >= len(frames[k]):
                continue
            corners, ids, _, _ = detector.detectBoard(255 - frames[k][index])
            if ids is None:
                continue
            for corner, number in zip(np.reshape(corners, (-1, 2)), np.ravel(ids), strict=True):
                seen.setdefault(int(number), []).append((k, corner))
        for views in seen.values():
            if len(views) >= 2:
                residuals += triangulated_residuals(cameras, views)
    return residuals


def triangulated_residuals(cameras: CameraGroup, views: list[tuple[int, np.ndarray]]) -> list[float]:
    """Linear triangulation of one point and its distance, px, in every view."""
    rows = []
    for k, pixel in views:
        x, y = cameras[k].unproject(pixel)
        pose = cameras[k].cam_from_world
        rows += [x * pose[2] - pose[0], y * pose[2] - pose[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return [float(np.linalg.norm(cameras[k].project(point[:3] / point[3]) - pixel)) for k, pixel in views]


def read_gray(path: Path) -> list[np.ndarray]:
    video = cv2.VideoCapture(str(path))
    frames = []
    while True:
        ok, frame = video.read()
        if not ok:
            return frames
        frames.append(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))


@needs_data
def test_a_copied_session_folder_is_found(tmp_path: Path) -> None:
    shutil.copytree(DATA / "charuco", tmp_path / "calibration", ignore=shutil.ignore_patterns("*.mp4"))
    assert find_calibration(tmp_path) == tmp_path / "calibration" / "camera_array.toml"
