"""Every known calibration format, written from a known rig, gives that rig back."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, read_calibration, save_calibration
from muybridge.geometry.cameras.group import CameraGroup
from tests.geometry.calibration.format_texts import (
    POINTS_WORLD,
    assert_same_rig,
    caliscope_text,
    colmap_model,
    opencv_text,
    pose2sim_text,
    qualisys_text,
    rig,
    rig_table,
    write,
)


def test_qualisys(tmp_path: Path) -> None:
    calibration = read_calibration(write(tmp_path / "a.qca.txt", qualisys_text(rig())))
    assert calibration.format == "Qualisys" and calibration.notes == ()
    assert_same_rig(calibration.cameras, rig())


def test_qualisys_window_of_the_sensor_and_reduced_video(tmp_path: Path) -> None:
    assert_same_rig(load_calibration(write(tmp_path / "w.txt", qualisys_text(rig(), left=64, top=32))), rig())
    assert_same_rig(load_calibration(write(tmp_path / "h.txt", qualisys_text(rig(), subpixels=128.0))), rig())


def test_qualisys_leaves_out_inactive_cameras_and_says_so(tmp_path: Path) -> None:
    text = qualisys_text(rig()).replace('active="1" serial="cam02"', 'active="0" serial="cam02"')
    calibration = read_calibration(write(tmp_path / "a.qca.txt", text))
    assert calibration.cameras.names == ("cam01", "cam03")
    assert "cam02" in calibration.notes[0]


@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_pose2sim_and_anipose(tmp_path: Path, model: str) -> None:
    calibration = read_calibration(write(tmp_path / "Calib.toml", pose2sim_text(rig(model))))
    assert calibration.format == "Pose2Sim/Anipose TOML" and calibration.notes == ()
    assert [c.model for c in calibration.cameras] == [model] * 3
    assert_same_rig(calibration.cameras, rig(model))


def test_a_rig_in_millimetres_is_recognised_or_declared(tmp_path: Path) -> None:
    tables = "\n".join(f"[{c.name}]\n{rig_table(c, scale=1000.0)}" for c in rig())
    calibration = read_calibration(write(tmp_path / "mm.toml", tables))
    assert_same_rig(calibration.cameras, rig())
    assert "millimetres" in calibration.notes[0] and "unit" in calibration.notes[0]
    tables = "\n".join(f"[{c.name}]\n{rig_table(c, scale=100.0)}" for c in rig())
    calibration = read_calibration(write(tmp_path / "cm.toml", tables + '\n[metadata]\nunit = "cm"\n'))
    assert_same_rig(calibration.cameras, rig())
    assert calibration.notes == ()
    with pytest.raises(CalibrationError, match="unit 'furlong' is unknown; valid: m, cm, mm, in"):
        load_calibration(write(tmp_path / "f.toml", tables + '\n[metadata]\nunit = "furlong"\n'))


@pytest.mark.parametrize("matrix_rotation", [True, False])
def test_caliscope(tmp_path: Path, matrix_rotation: bool) -> None:
    text = caliscope_text(rig(), matrix_rotation)
    calibration = read_calibration(write(tmp_path / "camera_array.toml", text))
    assert calibration.format == "Caliscope TOML"
    assert calibration.cameras.names == ("cam_0", "cam_1", "cam_2")
    expected = CameraGroup(tuple(c.renamed(f"cam_{k}") for k, c in enumerate(rig())))
    assert_same_rig(calibration.cameras, expected)


def test_caliscope_cameras_without_pose_are_named(tmp_path: Path) -> None:
    lines = caliscope_text(rig()).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("rotation ="))
    lines[first] = 'rotation = "null"'
    last = max(i for i, line in enumerate(lines) if line.startswith("translation ="))
    del lines[last]
    with pytest.raises(CalibrationError, match="no pose .* for cam_0, cam_2: finish the calibration"):
        load_calibration(write(tmp_path / "camera_array.toml", "\n".join(lines)))
    lines = caliscope_text(rig()).replace("rotation = [", "nothing = [", 1)
    found = read_calibration(write(tmp_path / "camera_array.toml", lines))
    assert found.cameras.names == ("cam_1", "cam_2") and found.no_pose == ("cam_0",)


def test_caliscope_ignored_cameras_are_left_out(tmp_path: Path) -> None:
    text = caliscope_text(rig()).replace("ignore = false", "ignore = true", 1)
    calibration = read_calibration(write(tmp_path / "camera_array.toml", text))
    assert calibration.cameras.names == ("cam_1", "cam_2") and "cam_0" in calibration.notes[0]


@pytest.mark.parametrize("layout", ["maps", "sequence"])
@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_opencv_yaml_of_several_cameras(tmp_path: Path, layout: str, model: str) -> None:
    calibration = read_calibration(write(tmp_path / "rig.yml", opencv_text(rig(model), layout)))
    assert calibration.format == "OpenCV YAML"
    assert_same_rig(calibration.cameras, rig(model))


def test_opencv_yaml_of_one_camera_is_named_after_its_file(tmp_path: Path) -> None:
    one = CameraGroup((rig()[0],))
    assert_same_rig(load_calibration(write(tmp_path / "cam01.yaml", opencv_text(one, "single"))), one)


def test_opencv_yaml_written_by_hand(tmp_path: Path) -> None:
    c = rig()[0]
    text = (
        "top:\n"
        f"   image_size: [{c.width}, {c.height}]\n"
        f"   K: {c.camera_matrix.ravel().tolist()}\n"
        f"   D: {list(c.params[4:])}\n"
        f"   R: {c.rotation.ravel().tolist()}\n"
        f"   T: {c.translation.tolist()}\n"
    )
    assert_same_rig(load_calibration(write(tmp_path / "rig.yml", text)), CameraGroup((c.renamed("top"),)))
    with pytest.raises(CalibrationError, match="camera top: K and M are both given"):
        load_calibration(write(tmp_path / "two.yml", text + "   M: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n"))
    with pytest.raises(CalibrationError, match="no pose for top: each camera needs a rotation"):
        load_calibration(write(tmp_path / "no.yml", text.replace("   T:", "   X:")))


@pytest.mark.parametrize("text", [True, False])
@pytest.mark.parametrize("model", ["OPENCV", "FULL_OPENCV", "OPENCV_FISHEYE"])
def test_colmap(tmp_path: Path, text: bool, model: str) -> None:
    folder = colmap_model(rig(model), tmp_path / "sparse", text)
    suffix = ".txt" if text else ".bin"
    for path in (
        folder,
        folder / f"cameras{suffix}",
        folder / f"images{suffix}",
        folder / f"points3D{suffix}",
    ):
        calibration = read_calibration(path)
        assert calibration.format == "COLMAP model" and "metres with Z up" in calibration.notes[0]
        assert_same_rig(calibration.cameras, rig(model))


def test_colmap_reader_agrees_with_pycolmap(tmp_path: Path) -> None:
    folder = colmap_model(rig(), tmp_path / "sparse", text=False)
    reference = pycolmap.Reconstruction(folder)
    found = load_calibration(folder)
    for image in reference.images.values():
        camera = found[Path(image.name).stem]
        points_cam = image.cam_from_world() * POINTS_WORLD
        expected = reference.cameras[image.camera_id].img_from_cam(points_cam) - 0.5
        np.testing.assert_allclose(camera.project(POINTS_WORLD), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("images", "names"),
    [
        (["b/0.png", "a/0.png", "c/0.png"], ("b", "a", "c")),
        (["x/a/0.png", "x/b/0.png", "y/a/0.png"], ("x_a_0", "x_b_0", "y_a_0")),
        (["two words.png", "B.jpg", "c.d.png"], ("two words", "B", "c.d")),
    ],
)
def test_colmap_names(tmp_path: Path, images: list[str], names: tuple[str, ...]) -> None:
    for text in (True, False):
        folder = colmap_model(rig(), tmp_path / f"model{text}", text, images)
        assert load_calibration(folder).names == names


def test_half_a_colmap_model_is_explained(tmp_path: Path) -> None:
    folder = colmap_model(rig(), tmp_path / "sparse", text=True)
    (folder / "images.txt").unlink()
    with pytest.raises(CalibrationError, match="both cameras and images are needed"):
        load_calibration(folder / "cameras.txt")
    with pytest.raises(CalibrationError, match="holds no COLMAP model"):
        load_calibration(folder)


def test_a_world_on_its_side_is_noted(tmp_path: Path) -> None:
    y_up_from_world = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    poses = [np.column_stack([c.rotation @ y_up_from_world.T, c.translation]) for c in rig()]
    sideways = CameraGroup(tuple(c.posed(p) for c, p in zip(rig(), poses, strict=True)))
    save_calibration(sideways, tmp_path / "calibration.toml")
    (note,) = read_calibration(tmp_path / "calibration.toml").notes
    assert "up is about the calibration's +Y axis" in note
