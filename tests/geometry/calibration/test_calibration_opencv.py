"""OpenCV's YAML as programs write it that know one camera: a file each, arrays of one dimension, no pose."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import export_calibration, find_calibration, load_calibration, read_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.demo_take.take import demo_folder


@pytest.fixture(scope="module")
def rig() -> CameraGroup:
    """The demo's cameras."""
    return load_calibration(demo_folder() / "calibration.toml")


def write(path: Path, camera: Camera, **more: str) -> Path:
    """One camera as numpy arrays go into `cv2.FileStorage`: of one dimension where they have one."""
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_size", np.array([camera.width, camera.height]))
    storage.write("camera_matrix", camera.camera_matrix)
    storage.write("dist_coeffs", np.array(camera.params[4:]))
    storage.write("rvec", cv2.Rodrigues(np.array(camera.rotation))[0].ravel())
    storage.write("tvec", np.array(camera.translation))
    for key, value in more.items():
        storage.write(key, value)
    storage.release()
    return path


def assert_same(found: CameraGroup, expected: CameraGroup) -> None:
    world = np.random.default_rng(1).uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 1.8], (50, 3))
    assert found.names == expected.names
    assert [(c.width, c.height) for c in found] == [(c.width, c.height) for c in expected]
    np.testing.assert_allclose(found.project(world), expected.project(world), atol=1e-6)


def test_one_camera_a_file_makes_a_rig(rig: CameraGroup, tmp_path: Path) -> None:
    folder = tmp_path / "calibration"
    folder.mkdir()
    files = [write(folder / f"{c.name}.yml", c) for c in rig]
    assert find_calibration(tmp_path) == folder
    assert read_calibration(folder).format == "OpenCV YAML"
    assert_same(load_calibration(folder), rig)
    files[1].write_text(files[1].read_text().replace("rvec", "no_rvec"))
    found = read_calibration(folder)
    assert found.no_pose == (rig.names[1],) and f"no pose: {rig.names[1]}" in found.notes[-1]
    assert found.cameras.names == tuple(n for n in rig.names if n != rig.names[1])
    write(files[1], rig[1], unit="cm")
    with pytest.raises(CalibrationError, match="the units of .* differ"):
        read_calibration(folder)


def test_a_rig_beside_single_cameras_is_one_too_many(rig: CameraGroup, tmp_path: Path) -> None:
    write(tmp_path / "a.yml", rig[0])
    export_calibration(rig, tmp_path / "b.yml", "opencv")
    with pytest.raises(CalibrationError, match=r"several calibrations \(a.yml, b.yml\)"):
        find_calibration(tmp_path)


def test_a_camera_without_pose_is_left_out_of_a_file(rig: CameraGroup, tmp_path: Path) -> None:
    export_calibration(rig, tmp_path / "rig.yml", "opencv")
    text = (tmp_path / "rig.yml").read_text()
    (tmp_path / "rig.yml").write_text(text.replace("translation_vector", "nothing", 1))
    found = read_calibration(tmp_path / "rig.yml")
    assert found.no_pose == rig.names[:1] and found.cameras.names == rig.names[1:]
