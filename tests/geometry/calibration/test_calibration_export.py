"""Every export format reads back; files as written by Vicon, Motive and EasyMocap."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import CalibrationError, OutputError
from muybridge.geometry.calibration import (
    EXPORT_FORMATS,
    export_calibration,
    find_calibration,
    load_calibration,
    read_calibration,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

_NAMES = {"easymocap": "", "colmap": "", "opencv": "rig.yml", "qualisys": "rig.qca.txt", "vicon": "rig.xcp",
          "optitrack": "rig.csv"}  # fmt: skip
_LENSES = {
    "PINHOLE": (1201.5, 1199.0, 961.25, 538.5),
    "OPENCV": (1201.5, 1199.0, 961.25, 538.5, -0.11, 0.07, 0.0011, -0.0007),
    "RADIAL": (1200.0, 960.25, 541.5, -0.09, 0.03),
    "FULL_OPENCV": (1201.5, 1199.0, 961.25, 538.5, -0.11, 0.07, 0.0011, -0.0007, 0.01, 0.02, -0.003, 0.001),
    "OPENCV_FISHEYE": (601.5, 599.0, 961.25, 538.5, 0.02, -0.01, 0.004, -0.001),
}
_RADIAL_ONLY, _NO_RATIONAL = ("vicon",), ("easymocap", "qualisys", "optitrack")


def _rig(model: str, count: int = 3) -> CameraGroup:
    rng = np.random.default_rng(3)
    cameras = []
    for k in range(count):
        rotation = Rotation.from_euler("zyx", [0.4 + k, 0.1, -1.7], degrees=False).as_matrix()
        center = np.array([3.0 * np.cos(2 * k), 3.0 * np.sin(2 * k), 1.4]) + rng.normal(0, 0.05, 3)
        pose = np.column_stack([rotation, -rotation @ center])
        cameras.append(Camera(f"cam-{k + 1:02d}", model, 1920, 1080, _LENSES[model], pose))
    return CameraGroup(tuple(cameras))


def _written(group: CameraGroup, folder: Path, how: str) -> Path:
    path = folder / _NAMES.get(how, "rig.toml") if _NAMES.get(how, "x") else folder / "model"
    export_calibration(group, path, how)  # type: ignore[arg-type]
    return path / "intri.yml" if how == "easymocap" else path


def _off_px(one: CameraGroup, two: CameraGroup) -> float:
    """Largest difference of the pixels of points all over the images."""
    across = np.stack(np.meshgrid(np.linspace(0, 1919, 13), np.linspace(0, 1079, 9)), axis=-1).reshape(-1, 2)
    worst = 0.0
    for a, b in zip(one, two, strict=True):
        points = a.center_world + 4.0 * a.rays(across)
        worst = max(worst, float(np.abs(a.project(points) - b.project(points)).max()))
    return worst


def _carries(how: str, model: str) -> bool:
    if how in ("muybridge", "colmap"):
        return True
    if how in _RADIAL_ONLY:
        return model in ("PINHOLE", "RADIAL")
    return model in ("PINHOLE", "OPENCV", "RADIAL") or how not in _NO_RATIONAL


@pytest.mark.parametrize("model", _LENSES)
@pytest.mark.parametrize("how", EXPORT_FORMATS)
def test_what_is_written_reads_back(tmp_path: Path, how: str, model: str) -> None:
    group = _rig(model)
    if not _carries(how, model):
        with pytest.raises(CalibrationError, match="cam-01"):
            _written(group, tmp_path, how)
        assert not list(tmp_path.rglob("rig*"))
        return
    back = load_calibration(_written(group, tmp_path, how))
    assert back.names == group.names
    assert [(c.width, c.height) for c in back] == [(1920, 1080)] * 3
    np.testing.assert_allclose(back.cam_from_world, group.cam_from_world, atol=1e-9)
    assert _off_px(group, back) < (0.3 if how == "vicon" and model == "RADIAL" else 1e-6)


def test_a_vicon_file_corrects_raw_pixels(tmp_path: Path) -> None:
    """Coefficients of raw pixels, against their definition; video cameras only; a camera's own axes."""
    k = (3.1e-8, 2.0e-15, 0.0)
    path = tmp_path / "take.xcp"
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n<!-- Vicon -->\n<Cameras>\n'
        '<Camera DEVICEID="101" TYPE="MX" SENSOR_SIZE="2352 1728" PIXEL_ASPECT_RATIO="1"/>\n'
        '<Camera DEVICEID="2118670" NAME="" TYPE="Vue" DISPLAY_TYPE="VideoCamera" SENSOR_SIZE="1920 1080" '
        'PIXEL_ASPECT_RATIO="1"><KeyFrames><KeyFrame FOCAL_LENGTH="1480.5" PRINCIPAL_POINT="955.5 541.25" '
        'POSITION="100 -3000 1500" ORIENTATION="-0.7071067811865476 0 0 0.7071067811865476" WORLD_ERROR="0.1" '
        f'VICON_RADIAL2="ViconRadial2 955.5 541.25 {k[0]} {k[1]} {k[2]}"/></KeyFrames></Camera>\n</Cameras>\n'
    )
    read = read_calibration(path)
    assert read.format == "Vicon" and read.cameras.names == ("2118670",) and "no video cameras" in read.notes[0]
    camera = read.cameras[0]
    np.testing.assert_allclose(camera.center_world, [0.1, -3.0, 1.5], atol=1e-12)
    # The quaternion turns world's +Y into the direction that the camera looks in.
    np.testing.assert_allclose(camera.rotation @ [0, 1, 0], [0, 0, -1], atol=1e-9)
    raw = np.array([[100.0, 80.0], [1700.0, 950.0], [955.5, 541.25], [1900.0, 20.0]])
    from_middle = raw - [955.5, 541.25]
    r2 = (from_middle**2).sum(1, keepdims=True)
    np.testing.assert_allclose(camera.unproject(raw), from_middle * (1 + k[0] * r2 + k[1] * r2**2) / 1480.5, atol=2e-5)


def test_motive_files_are_rotated_to_z_up(tmp_path: Path) -> None:
    """Two cameras as Motive writes them (UTF-16, Y up): they look at one point, which is in front of both."""
    place = np.array([0.2, 1.0, 0.1])  # Y up
    rows = []
    for serial, center in (("C1", [-0.3, 2.6, -3.5]), ("C2", [3.0, 2.0, 1.0]), ("C3", [-3.0, 2.2, 2.0])):
        back = np.array(center) - place
        back /= np.linalg.norm(back)
        right = np.cross([0, 1, 0], back)
        right /= np.linalg.norm(right)
        matrix = np.stack([right, np.cross(back, right), back], axis=1)
        turn = " ".join(f'OrientMatrix{k}="{v:.6f}"' for k, v in enumerate(matrix.ravel()))
        rows.append(
            f'<Camera Serial="{serial}"><Properties CameraID="6"/><Attributes ImagerPixelWidth="1920" '
            'ImagerPixelHeight="1080"/><IntrinsicStandardCameraModel LensCenterX="960.6" LensCenterY="538.6" '
            'HorizontalFocalLength="1247.8" VerticalFocalLength="1247.7" k1="-0.03" k2="0.02" k3="0.001" '
            f'TangentialX="0.0002" TangentialY="-0.0002"/><Extrinsic X="{center[0]}" Y="{center[1]}" Z="{center[2]}" '
            f"{turn}/></Camera>"
        )
    text = '<?xml version="1.0" encoding="UTF-16LE"?>\n<calibrationProfile version="1"><Calibration><Cameras>'
    path = tmp_path / "rig.mcal"
    path.write_bytes((text + "".join(rows) + "</Cameras></Calibration></calibrationProfile>").encode("utf-16"))
    read = read_calibration(path)
    assert read.format == "OptiTrack" and any("Y up" in n for n in read.notes)
    px = read.cameras.project(np.array([place[0], -place[2], place[1]]))
    np.testing.assert_allclose(px, np.tile([960.6, 538.6], (3, 1)), atol=0.05)
    above = read.cameras.project(np.array([place[0], -place[2], place[1] + 0.3]))
    assert (above[:, 1] < px[:, 1] - 50).all()


def test_easymocap_without_sizes_and_its_pair(tmp_path: Path) -> None:
    folder = tmp_path / "session" / "calibration"
    folder.mkdir(parents=True)
    group = _rig("OPENCV")
    export_calibration(group, folder, "easymocap")
    assert find_calibration(tmp_path / "session").stem in ("intri", "extri")
    text = (folder / "intri.yml").read_text()
    (folder / "intri.yml").write_text("\n".join(r for r in text.splitlines() if not r.startswith(("H_", "W_"))))
    read = read_calibration(folder / "extri.yml")
    assert any("image sizes" in n for n in read.notes)
    assert _off_px(group, read.cameras) < 1e-6
    (folder / "intri.yml").unlink()
    with pytest.raises(CalibrationError, match="intri.yml is missing"):
        read_calibration(folder / "extri.yml")


@pytest.mark.parametrize("how", [h for h in EXPORT_FORMATS if h != "easymocap"])
def test_names_and_their_order_are_preserved(tmp_path: Path, how: str) -> None:
    names = ("cam10", "Café", "cam2", "北", "a.left", "a.right", "c.1")
    group = _rig("PINHOLE", len(names))
    group = CameraGroup(tuple(c.renamed(n) for c, n in zip(group, names, strict=True)))
    assert load_calibration(_written(group, tmp_path, how)).names == names


def test_freemocap_is_in_millimetres(tmp_path: Path) -> None:
    group = _rig("OPENCV")
    text = _written(group, tmp_path, "freemocap").read_text()
    assert 'unit = "mm"' in text and f"{float(group[0].translation[2] * 1000)!r}" in text


@pytest.mark.parametrize(
    ("how", "old", "new", "message"),
    [
        ("vicon", "ORIENTATION=", "ORIENTED=", "has no ORIENTATION"),
        ("vicon", 'ORIENTATION="', 'ORIENTATION="7 ', "ORIENTATION"),
        ("vicon", "</KeyFrames>", "", "broken XML"),
        ("optitrack", "k3", "k3 k3", None),
        ("optitrack", "cam-02", "", "camera 2 has no Serial"),
        ("optitrack", "HorizontalFocalLength", "HFL", "HorizontalFocalLength is missing"),
        ("easymocap", "K_cam-02:", "Q_cam-02:", "camera cam-02: K_cam-02 is missing"),
        ("easymocap", "names:", "nomes:", "names"),
    ],
)
def test_damage_is_reported(tmp_path: Path, how: str, old: str, new: str, message: str | None) -> None:
    path = _written(_rig("PINHOLE"), tmp_path, how)
    path.write_text(path.read_text().replace(old, new, 1))
    if how == "easymocap" and old == "names:":
        (path.parent / "extri.yml").write_text((path.parent / "extri.yml").read_text().replace(old, new, 1))
    if message is None:
        assert len(load_calibration(path)) == 3
        return
    with pytest.raises(CalibrationError, match=message) as caught:
        load_calibration(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("how", ["vicon", "optitrack", "easymocap", "qualisys", "freemocap"])
def test_mutated_files_give_a_calibration_error_or_a_rig(tmp_path: Path, how: str) -> None:
    path = _written(_rig("RADIAL" if how == "vicon" else "OPENCV"), tmp_path, how)
    whole = path.read_bytes()
    rng = np.random.default_rng(11)
    for _ in range(120):
        data = bytearray(whole)
        at, length = int(rng.integers(len(data))), int(rng.integers(1, 40))
        kind = int(rng.integers(4))
        if kind == 0:
            del data[at:]
        elif kind == 1:
            del data[at : at + length]
        elif kind == 2:
            data[at:at] = data[max(0, at - length) : at]
        else:
            data[at : at + length] = rng.integers(32, 127, length, dtype=np.uint8).tobytes()
        path.write_bytes(bytes(data))
        try:
            assert 1 <= len(load_calibration(path)) <= 4
        except CalibrationError as error:
            assert str(tmp_path) in str(error)


def test_folders_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="there is no folder"):
        export_calibration(_rig("PINHOLE"), tmp_path / "no" / "rig.toml", "anipose")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        export_calibration(_rig("PINHOLE"), tmp_path / "file", "colmap")
