"""Every known calibration format, written from a known rig, gives that rig back; damage gives one error."""

import json
import random
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pycolmap
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, read_calibration, save_calibration
from muybridge.geometry.cameras.camera import Camera, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from tests.rigs import ring_of_cameras

POINTS_WORLD = np.random.default_rng(1).uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 1.8], (50, 3))


def rig(model: str = "OPENCV", cameras: int = 3) -> CameraGroup:
    """Upright cameras on a circle of 4 m, each with its own lens."""
    distortion = {
        "OPENCV": (-0.05, 0.03, 0.002, -0.003),
        "FULL_OPENCV": (-0.05, 0.03, 0.002, -0.003, 0.01, 0.0, 0.0, 0.0),
        "OPENCV_FISHEYE": (0.03, -0.01, 0.004, -0.001),
    }[model]
    return ring_of_cameras(
        [f"cam{k + 1:02d}" for k in range(cameras)],
        height=[1.5 + 0.1 * k for k in range(cameras)],
        angles=[0.4 + 2.1 * k for k in range(cameras)],
        size=(1280, 720),
        model=model,
        params=[(900.0 + k, 910.0, 652.25, 347.875 + k, *distortion) for k in range(cameras)],
    )


def assert_same_rig(found: CameraGroup, expected: CameraGroup, atol_px: float = 1e-6) -> None:
    assert found.names == expected.names
    assert [(c.width, c.height) for c in found] == [(c.width, c.height) for c in expected]
    np.testing.assert_allclose(found.project(POINTS_WORLD), expected.project(POINTS_WORLD), atol=atol_px)
    np.testing.assert_allclose(found.centers_world, expected.centers_world, atol=1e-9)


# --- how each program writes a rig --------------------------------------------------------------------------


def qualisys_text(group: CameraGroup, left: int = 0, top: int = 0, subpixels: float = 64.0) -> str:
    blocks = []
    for c in group:
        r = np.diag([1.0, -1.0, -1.0]) @ c.rotation
        rij = " ".join(f'r{i + 1}{j + 1}="{float(r[i, j])!r}"' for i in range(3) for j in range(3))
        x, y, z = (c.center_world * 1000).tolist()
        fx, fy, cx, cy, k1, k2, p1, p2 = c.params
        fov = f'left="{left}" top="{top}" right="{left + c.width - 1}" bottom="{top + c.height - 1}"'
        whole = f'left="0" top="0" right="{left + c.width - 1}" bottom="{top + c.height - 1}"'
        blocks.append(
            f'<camera active="1" serial="{c.name}"><fov_video {fov}/><fov_video_max {whole}/>'
            f'<transform x="{x!r}" y="{y!r}" z="{z!r}" {rij}/>'
            f'<intrinsic focalLengthU="{fx * subpixels!r}" focalLengthV="{fy * subpixels!r}" skew="0.0" '
            f'centerPointU="{(cx + left) * subpixels!r}" centerPointV="{(cy + top) * subpixels!r}" '
            f'sensorMinU="0" sensorMaxU="{subpixels * (left + c.width - 1)}" '
            f'sensorMinV="0" sensorMaxV="{subpixels * (top + c.height - 1)}" '
            f'radialDistortion1="{k1!r}" radialDistortion2="{k2!r}" radialDistortion3="0.0" '
            f'tangentalDistortion1="{p1!r}" tangentalDistortion2="{p2!r}"/></camera>'
        )
    body = "\n".join(blocks)
    return f"<?xml version='1.0' encoding='ASCII'?>\n<calibration type=\"regular\">\n<cameras>\n{body}\n</cameras>\n</calibration>\n"  # noqa: E501


def rig_table(c: Camera, scale: float = 1.0, matrix_rotation: bool = False) -> str:
    k = list(c.params[4:])
    fisheye = c.model == "OPENCV_FISHEYE"
    distortions = k if fisheye or len(k) == 4 else [*k[:5]]
    rotation = c.rotation.tolist() if matrix_rotation else cv2.Rodrigues(np.array(c.rotation))[0].ravel().tolist()
    return (
        f"size = [{c.width}.0, {c.height}.0]\nmatrix = {c.camera_matrix.tolist()}\n"
        f"distortions = {distortions}\n"
        f"rotation = {rotation}\ntranslation = {(c.translation * scale).tolist()}\n"
        f"fisheye = {str(fisheye).lower()}\n"
    )


def pose2sim_text(group: CameraGroup) -> str:
    tables = "\n".join(f'[int_{c.name}_img]\nname = "{c.name}"\n{rig_table(c)}' for c in group)
    return tables + "\n[metadata]\nadjusted = false\nerror = 0.0\n"


def caliscope_text(group: CameraGroup, matrix_rotation: bool = False) -> str:
    return "\n".join(
        f"[cameras.{k}]\ncam_id = {k}\nrotation_count = 0\nignore = false\n"
        + rig_table(c, matrix_rotation=matrix_rotation)
        for k, c in enumerate(group)
    )


def opencv_text(group: CameraGroup, layout: str = "maps") -> str:
    kind = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage("calibration.yml", kind)
    if layout == "sequence":
        storage.startWriteStruct("cameras", cv2.FILE_NODE_SEQ)
    for c in group:
        if layout != "single":
            storage.startWriteStruct("" if layout == "sequence" else c.name, cv2.FILE_NODE_MAP)
        if layout == "sequence":
            storage.write("name", c.name)
        storage.write("image_width", c.width)
        storage.write("image_height", c.height)
        storage.write("camera_matrix", c.camera_matrix)
        storage.write("distortion_coefficients", np.array([c.params[4:]]))
        storage.write("rvec", cv2.Rodrigues(np.array(c.rotation))[0])
        storage.write("tvec", c.translation.reshape(3, 1))
        if c.model == "OPENCV_FISHEYE":
            storage.write("distortion_model", "fisheye")
        if layout != "single":
            storage.endWriteStruct()
    if layout == "sequence":
        storage.endWriteStruct()
    return str(storage.releaseAndGetString())


def colmap_model(group: CameraGroup, folder: Path, text: bool, names: list[str] | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    model = pycolmap.Reconstruction()
    for k, c in enumerate(group, start=1):
        lens = colmap_camera(c)
        lens.camera_id = k
        model.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(
            name=names[k - 1] if names else f"{c.name}.png",
            points2D=[pycolmap.Point2D([1.0, 2.0 + i]) for i in range(k - 1)],
            camera_id=k,
            image_id=k,
        )
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array(c.rotation)), np.array(c.translation))
        model.add_image_with_trivial_frame(image, pose)
    (model.write_text if text else model.write_binary)(folder)
    return folder


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


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


# --- damage -------------------------------------------------------------------------------------------------

WRITERS: dict[str, Callable[[], str]] = {
    "cal.qca.txt": lambda: qualisys_text(rig()),
    "pose2sim.toml": lambda: pose2sim_text(rig()),
    "caliscope.toml": lambda: caliscope_text(rig(), matrix_rotation=True),
    "opencv.yml": lambda: opencv_text(rig()),
}


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cal.qca.txt", "</cameras>", "", "damaged or incomplete Qualisys calibration: broken XML.*line"),
        (
            "cal.qca.txt",
            'focalLengthU="',
            'focalLengthU="x',
            "camera cam01: focalLengthU of <intrinsic> is 'x",
        ),
        ("cal.qca.txt", "<transform", "<transfrom", "camera cam01: <transform> is missing"),
        ("cal.qca.txt", 'serial="cam02"', 'serial="cam01"', "camera names repeat: cam01"),
        ("cal.qca.txt", 'r11="', 'r11="0" r_11="', "cam01: transform r11..r33 is not a rotation matrix"),
        ("cal.qca.txt", 'active="1"', 'active="0"', "no <camera> is active"),
        ("pose2sim.toml", "matrix = [[", "matrix = [", "broken TOML: .*line 4"),
        (
            "pose2sim.toml",
            "size = [1280.0, 720.0]",
            "size = [1280.5, 720.0]",
            "cam01: the width in size is 1280.5",
        ),
        ("pose2sim.toml", "size = ", "sise = ", "camera cam01: size is missing"),
        (
            "pose2sim.toml",
            "translation = [",
            "translation = [1.0, ",
            "translation must be a list of 3 numbers",
        ),
        ("pose2sim.toml", "distortions = [", "distortions = [nan, ", "camera cam01: distortions is nan"),
        (
            "caliscope.toml",
            "rotation = [[",
            "rotation = [[2.0], [",
            "camera cam_0: rotation must be a list of 3 or 9 numbers",
        ),
        ("opencv.yml", "cols: 3", "cols: 4", "camera cam01: camera_matrix says 3 x 4 and has 9 numbers"),
        ("opencv.yml", "image_width", "image_wide", "camera cam01: the image size is missing"),
        ("opencv.yml", "camera_matrix", "matrix", "no camera in it|no pose|not a calibration"),
    ],
)
def test_damage_is_named(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    text = WRITERS[file]()
    assert old in text
    path = write(tmp_path / file, text.replace(old, new))
    with pytest.raises(CalibrationError, match=message) as caught:
        load_calibration(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("cameras.txt", "OPENCV 1280", "OPENCV x", "cameras.txt: line 4 is not CAMERA_ID MODEL"),
        (
            "cameras.txt",
            "OPENCV",
            "FISH",
            "cameras.txt: line 4: camera model FISH is not supported; supported:",
        ),
        (
            "cameras.txt",
            "OPENCV",
            "FULL_OPENCV",
            "model FULL_OPENCV with 8 parameters; it has fx, fy, cx, cy, k1",
        ),
        (
            "images.txt",
            " 1 cam01.png",
            " 9 cam01.png",
            "image cam01.png has camera 9, which the cameras file",
        ),
        ("images.txt", "\n1 ", "\n1 9", "images.txt: line 5, image cam01.png: the rotation is not a unit"),
    ],
)
def test_damaged_colmap_text_is_named(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
    folder = colmap_model(rig(), tmp_path / "sparse", text=True)
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    with pytest.raises(CalibrationError, match=message):
        load_calibration(folder)


def mutated(data: bytes, rng: random.Random) -> bytes:
    """A few random cuts, repetitions and overwritten bytes."""
    out = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 6])):
        at = rng.randrange(len(out) + 1)
        to = min(len(out), at + rng.randrange(40))
        kind = rng.randrange(5)
        if kind == 0:
            del out[at:]
        elif kind == 1:
            del out[at:to]
        elif kind == 2:
            out[at:at] = out[at:to] * 2
        elif kind == 3:
            out[at:to] = bytes(rng.randrange(256) for _ in range(to - at))
        else:
            out[at : at + 1] = rng.choice([b"\n", b"[", b"]", b"-", b"9", b'"', b"<", b"e", b"\0", b"\xff", b" "])
    return bytes(out)


def check_only_calibration_errors(path: Path) -> bool:
    """Whether the file could be read; any exception but CalibrationError fails the test."""
    try:
        group = load_calibration(path)
    except CalibrationError as error:
        assert "\n" not in str(error)
        assert path.name in str(error) or path.parent.name in str(error)
        return False
    assert np.isfinite(group.cam_from_world).all()
    return True


@pytest.mark.parametrize("file", [*WRITERS, "own.toml"])
def test_mutated_files_give_a_calibration_error_or_a_rig(tmp_path: Path, file: str) -> None:
    path = tmp_path / file
    if file == "own.toml":
        save_calibration(rig(), path)
        original = path.read_bytes()
    else:
        original = WRITERS[file]().encode()
    read = 0
    for seed in range(400):
        path.write_bytes(mutated(original, random.Random(seed)))
        read += check_only_calibration_errors(path)
    assert 0 < read < 400, "mutations should break some files and leave others readable"


@pytest.mark.parametrize("text", [True, False])
def test_mutated_colmap_models_give_a_calibration_error_or_a_rig(tmp_path: Path, text: bool) -> None:
    folder = colmap_model(rig(), tmp_path / "sparse", text)
    files = [folder / f"{stem}{'.txt' if text else '.bin'}" for stem in ("cameras", "images")]
    originals = [f.read_bytes() for f in files]
    read = 0
    for seed in range(400):
        rng = random.Random(seed)
        which = rng.randrange(2)
        files[which].write_bytes(mutated(originals[which], rng))
        read += check_only_calibration_errors(files[which])
        files[which].write_bytes(originals[which])
    assert 0 < read < 400


@pytest.mark.parametrize("name", ["a.toml", "a.qca.txt", "a.yml", "cameras.bin", "images.txt", "a"])
def test_garbage_is_of_no_known_format(tmp_path: Path, name: str) -> None:
    for data in (
        b"",
        b"\0" * 100,
        random.Random(0).randbytes(5000),
        b"hello\n",
        json.dumps({"a": 1}).encode(),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(CalibrationError, match="known formats: Muybridge TOML, Qualisys"):
            load_calibration(tmp_path / name)


def test_hostile_texts_are_refused(tmp_path: Path) -> None:
    bomb = '<?xml version="1.0"?><!DOCTYPE c [<!ENTITY a "aaaa">]><calibration>&a;</calibration>'
    with pytest.raises(CalibrationError):
        load_calibration(write(tmp_path / "bomb.xml", bomb))
    with pytest.raises(CalibrationError, match="entities"):
        text = qualisys_text(rig()).replace("<cameras>", "<cameras><!ENTITY a 'b'>")
        load_calibration(write(tmp_path / "entity.xml", text))
    with pytest.raises(CalibrationError, match="nested too deeply"):
        load_calibration(write(tmp_path / "deep.toml", "matrix = " + "[" * 100_000))
    with pytest.raises(CalibrationError, match="Muybridge TOML"):
        load_calibration(write(tmp_path / "huge.toml", "muybridge_calibration = " + "9" * 10_000))


def test_rotations_of_few_digits_are_made_orthonormal(tmp_path: Path) -> None:
    text = qualisys_text(rig())
    for c in rig():
        for value in (np.diag([1.0, -1.0, -1.0]) @ c.rotation).ravel().tolist():
            text = text.replace(f'"{value!r}"', f'"{value:.4f}"')
    found = load_calibration(write(tmp_path / "few.qca.txt", text))
    for camera in found:
        np.testing.assert_allclose(camera.rotation @ camera.rotation.T, np.eye(3), atol=1e-12)
    assert np.abs(found.project(POINTS_WORLD) - rig().project(POINTS_WORLD)).max() < 0.5
