"""A damaged calibration file gives one error that says what is wrong with it."""

import json
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from tests.geometry.calibration.format_texts import (
    POINTS_WORLD,
    caliscope_text,
    colmap_model,
    opencv_text,
    pose2sim_text,
    qualisys_text,
    rig,
    write,
)

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
def test_damage_is_reported(tmp_path: Path, file: str, old: str, new: str, message: str) -> None:
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
