"""Calibrations of data sets and other programs, hostile and implausible ones, and what is no calibration."""

import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import (
    export_calibration,
    find_calibration,
    load_calibration,
    read_calibration,
    save_calibration,
)
from muybridge.geometry.cameras.group import CameraGroup
from tests.geometry.calibration.format_texts import POINTS_WORLD, assert_same_rig, rig, write
from tests.paths import DATA

CASES = DATA / "cases"


@pytest.fixture(scope="module")
def case() -> Path:
    folder = CASES / "calib_unknown"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent")
    return folder


def centred(group: CameraGroup) -> CameraGroup:
    """The rig with its principal points where a guessed image size has its middle."""
    cameras = [
        type(c)(c.name, c.model, c.width, c.height, (*c.params[:2], 639.5, 359.5, *c.params[4:]), c.cam_from_world)
        for c in group
    ]
    return CameraGroup(tuple(cameras))


def voxelpose_text(group: CameraGroup) -> str:
    tables = {}
    for k, c in enumerate(group):
        fx, fy, cx, cy, k1, k2, p1, p2 = c.params
        tables[str(k)] = {
            "k": [[k1], [k2], [0.0]], "p": [[p1], [p2]], "R": c.rotation.tolist(),
            "T": (c.center_world[:, None] * 1000).tolist(), "fx": fx, "fy": fy, "cx": cx, "cy": cy,
        }  # fmt: skip
    return json.dumps(tables)


def human36m_text(group: CameraGroup, subjects: tuple[str, ...] = ("S1",)) -> str:
    lenses, poses = {}, {}
    for c in group:
        k1, k2, p1, p2 = c.params[4:]
        lenses[c.name] = {"calibration_matrix": c.camera_matrix.tolist(), "distortion": [k1, k2, p1, p2, 0.0]}
        poses[c.name] = {"R": c.rotation.tolist(), "t": (c.translation[:, None] * 1000).tolist()}
    return json.dumps({"intrinsics": lenses, "extrinsics": dict.fromkeys(subjects, poses)})


def panoptic_text(group: CameraGroup) -> str:
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # z up from y down
    cameras = [
        {
            "name": c.name, "type": "hd", "resolution": [c.width, c.height], "K": c.camera_matrix.tolist(),
            "distCoef": [*c.params[4:], 0.0], "R": (c.rotation @ turn).tolist(),
            "t": (c.translation[:, None] * 100).tolist(),
        }
        for c in group
    ]  # fmt: skip
    return json.dumps({"calibDataSource": "160906_ian2_calib_norm", "cameras": cameras})


def test_voxelpose(tmp_path: Path) -> None:
    group = centred(rig(cameras=4))
    found = read_calibration(write(tmp_path / "calibration_shelf.json", voxelpose_text(group)))
    assert found.format == "VoxelPose JSON" and found.cameras.names == ("cam0", "cam1", "cam2", "cam3")
    assert found.guessed_sizes == set(found.cameras.names) and "image sizes are not in it" in "".join(found.notes)
    np.testing.assert_allclose(found.cameras.project(POINTS_WORLD), group.project(POINTS_WORLD), atol=1e-6)
    assert [(c.width, c.height) for c in found.cameras] == [(1280, 720)] * 4
    with pytest.raises(CalibrationError, match=r"x\.json: .*VoxelPose.*camera cam1: fy missing"):
        tables = json.loads(voxelpose_text(group))
        del tables["1"]["fy"]
        load_calibration(write(tmp_path / "x.json", json.dumps(tables)))


def test_shelf_stands_around_its_scene(case: Path) -> None:
    found = load_calibration(case / "calibration_shelf.json")
    assert len(found) == 5
    centers, forward = found.centers_world, np.stack([c.rotation[2] for c in found])
    assert ((centers[:, 2] > 0.5) & (centers[:, 2] < 3)).all()  # metres above the floor, world with Z up
    middle = centers.mean(axis=0)
    assert (((middle - centers) * forward)[:, :2].sum(axis=1) > 0).all()  # and each looks inwards


def test_human36m(tmp_path: Path) -> None:
    group = centred(rig())
    found = read_calibration(write(tmp_path / "cameras.json", human36m_text(group)))
    assert_same_rig(found.cameras, group)
    assert found.format == "Human3.6M JSON" and found.guessed_sizes == set(group.names)
    several = human36m_text(group, ("S1", "S9"))
    first = read_calibration(write(tmp_path / "cameras.json", several))
    assert "subject S1 were read, not those of S9" in first.notes[0]
    (tmp_path / "S9").mkdir()
    named = read_calibration(write(tmp_path / "S9" / "cameras.json", several))
    assert "subject S9 were read, not those of S1" in named.notes[0]


def test_panoptic_is_turned_upright(tmp_path: Path) -> None:
    group = rig()
    found = read_calibration(write(tmp_path / "calibration_160906_ian2.json", panoptic_text(group)))
    assert found.format == "Panoptic JSON" and not found.notes
    assert_same_rig(found.cameras, group)


def test_gaussian_splatting(tmp_path: Path) -> None:
    group = centred(rig())
    rows = [
        {
            "id": k, "img_name": f"{c.name}.jpg", "width": c.width, "height": c.height,
            "position": c.center_world.tolist(), "rotation": c.rotation.T.tolist(), "fx": c.params[0],
            "fy": c.params[1],
        }
        for k, c in enumerate(group)
    ]  # fmt: skip
    found = read_calibration(write(tmp_path / "cameras.json", json.dumps(rows)))
    assert found.cameras.names == group.names and "scale and axes are arbitrary" in found.notes[0]
    assert [c.model for c in found.cameras] == ["PINHOLE"] * 3
    np.testing.assert_allclose(found.cameras.centers_world, group.centers_world, atol=1e-12)
    np.testing.assert_allclose([c.rotation for c in found.cameras], [c.rotation for c in group], atol=1e-12)


def openpose_xml(camera, path: Path) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("CameraMatrix", np.array(camera.cam_from_world))
    storage.write("Intrinsics", camera.camera_matrix)
    storage.write("Distortion", np.array([*camera.params[4:], 0.0, 0.0, 0.0, 0.0]).reshape(8, 1))
    storage.release()
    return path


def test_openpose_xml_and_opencv_xml(tmp_path: Path) -> None:
    group = centred(rig())
    folder = tmp_path / "calibration"
    folder.mkdir()
    for c in group:
        openpose_xml(c, folder / f"{c.name}.xml")
    assert find_calibration(tmp_path) == folder
    found = read_calibration(folder)
    assert found.format == "OpenCV XML" and found.guessed_sizes == set(group.names)
    assert_same_rig(found.cameras, group)
    storage = cv2.FileStorage(str(tmp_path / "own.xml"), cv2.FILE_STORAGE_WRITE)
    c = group[0]
    for key, value in (
        ("image_width", c.width), ("image_height", c.height), ("camera_name", "left"), ("K", c.camera_matrix),
        ("dist", np.array(c.params[4:])), ("rvec", cv2.Rodrigues(np.array(c.rotation))[0]),
        ("tvec", np.array(c.translation)),
    ):  # fmt: skip
        storage.write(key, value)
    storage.release()
    own = read_calibration(tmp_path / "own.xml")
    assert own.cameras.names == ("left",) and not own.guessed_sizes
    np.testing.assert_allclose(own.cameras[0].project(POINTS_WORLD), c.project(POINTS_WORLD), atol=1e-6)


def test_openpose_example(case: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "17012332.xml", (case / "17012332.xml.example").read_text())
    found = read_calibration(path)
    assert found.cameras.names == ("17012332",) and found.cameras[0].params[0] == 817.93481631740565
    assert (found.cameras[0].width, found.cameras[0].height) == (1202, 1037)


def test_easymocap_lenses_without_poses_are_left_out(case: Path, tmp_path: Path) -> None:
    for name in ("intri.yml", "extri.yml"):
        found = read_calibration(case / name)
        assert len(found.cameras) == 11 and len(found.no_pose) == 21
        assert "left out, as they have no pose: " in found.notes[-1] and "32" in found.notes[-1]
    group = rig(cameras=4)
    export_calibration(group, tmp_path, "easymocap")
    extri = tmp_path / "extri.yml"
    text = extri.read_text()
    extri.write_text(text.replace("T_cam02", "T_other"))
    made = read_calibration(extri)
    assert made.no_pose == ("cam02",) and made.cameras.names == ("cam01", "cam03", "cam04")
    extri.write_text(text.replace("T_", "S_"))
    with pytest.raises(CalibrationError, match="extri.yml is missing"):
        load_calibration(extri)


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("cam0.pickle", pickle.dumps({"intrinsicMat": np.eye(3), "rotation": np.eye(3)}), "OpenCap"),
        ("transforms.json", b'{"camera_angle_x": 0.7, "frames": [{"transform_matrix": [[1]]}]}', "NeRF"),
        ("camchain.yaml", b"cam0:\n  camera_model: pinhole\n  T_cn_cnm1:\n  - [1.0]\n", "Kalibr"),
        ("c.mat", b"MATLAB 5.0 MAT-file", "MATLAB"),
        ("c.npz", b"PK\x03\x04rest", "NumPy data"),
        ("sync.toml", b"muybridge_sync = 1\n[cameras.cam1]\noffset = 0.1\n", "clocks of synchronised"),
        ("board.toml", b"columns = 4\nrows = 5\naruco_scale = 0.75\n", "calibration board"),
        ("c.png", b"\x89PNG\r\n", "an image"),
        ("c.mp4", b"\x00\x00\x00\x18ftypmp42", "a video"),
        ("calibration.html", b"<!doctype html>\n<p>\n  K: 3\n", "a web page"),
    ],
)
def test_what_is_no_calibration_names_what_it_looks_like(tmp_path: Path, name: str, data: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(CalibrationError, match=rf"{name}: not a calibration .*looks like .*{words}") as caught:
        load_calibration(tmp_path / name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["deep.yml", "smaller.yml"])
def test_deep_yaml_of_the_case_is_refused(name: str) -> None:
    path = CASES / "yaml_segfault" / name
    if not path.is_file():
        pytest.skip(f"{path} is absent")
    with pytest.raises(CalibrationError, match=f"{name}.*nested too deeply"):
        load_calibration(path)


@pytest.mark.parametrize(
    "text",
    [
        "%YAML:1.0\n---\na: " + "[" * 100_000,
        "%YAML:1.0\n---\na: " + "{a: " * 50_000,
        "%YAML:1.0\n---\na: " + '["]", ' * 50_000,
        "%YAML:1.0\n---\na:\n  " + "- " * 50_000,
        "%YAML:1.0\n---\n" + "".join(" " * k + "a:\n" for k in range(1500)),
        "<?xml version='1.0'?><opencv_storage>" + "<a>" * 100_000,
        "<?xml version='1.0'?><opencv_storage>" + "<a>" * 50_000 + "</a>" * 50_000 + "</opencv_storage>",
        '{"fx": 1, "R": 1, "T": ' + "[" * 100_000,
        '{"fx": 1, "R": 1, "T": ' + '{"a":' * 100_000,
        "[" * 100_000 + '"img_name": "rotation":',
    ],
)
def test_deep_nesting_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(CalibrationError, match="deep.cal: ") as caught:
        load_calibration(write(tmp_path / "deep.cal", text))
    assert "\n" not in str(caught.value)


HOSTILE = [
    ({"fx": 1e-320}, "cam02: .*focal"),
    ({"fx": 0.0}, "cam02"),
    ({"fx": -900.0}, "cam02"),
    ({"fx": 1e300}, "cam02: a focal length of 1e\\+300 px"),
    ({"fx": float("nan")}, "cam02"),
    ({"fx": float("inf")}, "cam02"),
    ({"cx": 1e12}, "cam02: .*principal point"),
    ({"k1": 1e30}, "cam02: .*distortion"),
    ({"width": 900_000}, "cam02: an image of 900000 x 720 px"),
    ({"z": 5e6}, "cam02: .* m from the origin, which is beyond any room"),
]


@pytest.mark.parametrize(("change", "message"), HOSTILE)
@pytest.mark.parametrize("how", ["muybridge", "pose2sim", "caliscope", "opencv"])
def test_implausible_cameras_are_refused_by_all_formats(tmp_path: Path, how, change, message) -> None:
    group = rig()
    marked = {"fx": 901.0, "cx": 652.25, "k1": -0.05, "width": 1280, "z": float(group[1].translation[2])}
    key, value = next(iter(change.items()))
    path = tmp_path / ("cameras.yml" if how == "opencv" else "cameras.toml")
    export_calibration(group, path, how)
    text = path.read_text()
    old = repr(marked[key])
    starts = [k for k in range(len(text)) if text.startswith(old, k)]
    # Each camera has the width, the principal point and the distortion once: those of the second camera.
    at = starts[0] if key in ("fx", "z") else starts[1]
    new = {"inf": ".Inf", "nan": ".NaN"}.get(repr(value), repr(value)) if how == "opencv" else repr(value)
    path.write_text(text[:at] + new + text[at + len(old) :])
    with pytest.raises(CalibrationError, match=rf"{path.name}: .*{message}") as caught:
        load_calibration(path)
    assert "\n" not in str(caught.value)


def test_own_files_beside_another_calibration_are_no_calibration(tmp_path: Path) -> None:
    export_calibration(rig(), tmp_path / "Calib.toml", "pose2sim")
    (tmp_path / "sync.toml").write_text("muybridge_sync = 1\n\n[cameras.cam01]\noffset = 0.0\nmatrix = 3\n")
    (tmp_path / "timestamps.csv").write_text("sync_index,cam_id,frame_time\n0,0,0.0\n")
    (tmp_path / "report.html").write_text("<!doctype html><script>\n  K: 3,\n  M: 4,\n</script>")
    (tmp_path / "run.json").write_text(json.dumps({"cameras": [{"name": "cam01"}], "R": 1}))
    (tmp_path / "charuco.toml").write_text("columns = 4\nrows = 5\nsquare_size_override_cm = 5.4\n")
    assert find_calibration(tmp_path).name == "Calib.toml"
    folder = tmp_path / "calibration"
    folder.mkdir()
    (folder / "sync.toml").write_text("muybridge_sync = 1\n[cameras.cam01]\noffset = 0.0\n")
    save_calibration(rig(), folder / "rig.toml")
    assert find_calibration(tmp_path) == folder / "rig.toml"
