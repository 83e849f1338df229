"""What `muybridge calibrate` writes replaces nothing that muybridge did not write."""

import numpy as np
import pytest

from muybridge.errors import OutputError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.commands.app import run_command
from muybridge.infer.commands.calibrate.outputs import check_replaceable

OTHERS = "mine, and not a calibration of muybridge\n"


def rig():
    lens = (1000.0, 1000.0, 640.0, 360.0)
    shift = ([0.0, 0.0, 4.0], [0.5, 0.0, 4.0])
    return CameraGroup(tuple(
        Camera(f"c{k}", "PINHOLE", 1280, 720, lens, np.column_stack([np.eye(3), s])) for k, s in enumerate(shift)
    ))  # fmt: skip


def points_table(folder):
    points = np.random.default_rng(0).uniform(-0.8, 0.8, size=(12, 3))
    rows = ["camera,x,y,z,u,v"]
    for c in rig():
        rows += [",".join([c.name, *map(str, (*x, *px))]) for x, px in zip(points, c.project(points), strict=True)]
    (folder / "p.csv").write_text("\n".join(rows))
    return folder / "p.csv"


@pytest.fixture
def commands(tmp_path):
    """Arguments, and the file that each writes last."""
    save_calibration(rig(), tmp_path / "rig.toml")
    out = tmp_path / "out.toml"
    points = ["points", points_table(tmp_path), "--size", "1280", "720", "--out", out]
    (tmp_path / "boards" / "cam").mkdir(parents=True)
    (tmp_path / "boards" / "cam" / "0.png").touch()
    (tmp_path / "session").mkdir()
    return {
        "points": (points, out),
        "points page": (points, tmp_path / "out.html"),
        "world": (["world", tmp_path / "rig.toml", "--turn-deg", "90", "--out", out], out),
        "convert": (["convert", tmp_path / "rig.toml", out], out),
        "model": (["convert", tmp_path / "rig.toml", tmp_path / "m", "--to", "colmap"], tmp_path / "m" / "images.txt"),
        "print": (["print-board", tmp_path / "b.pdf"], tmp_path / "b.pdf"),
        "board": (["board", tmp_path / "boards", "--out", out], out),
        "people": (["people", tmp_path / "session", "--out", out], out),
        "check": (["check", tmp_path / "session", "--out", tmp_path / "c.html"], tmp_path / "c.html"),
        "scan": (["scan", tmp_path / "boards", "--cameras", tmp_path / "boards", "--out", out], out),
    }


@pytest.mark.parametrize("which", ["points", "points page", "world", "convert", "model", "print"])
def test_other_peoples_files_stay_and_our_own_are_replaced(commands, capfd, which):
    arguments, path = commands[which]
    arguments = ["calibrate", *map(str, arguments)]
    path.parent.mkdir(exist_ok=True)
    path.write_text(OTHERS)
    assert run_command(arguments) == 2 and path.read_text() == OTHERS
    assert f"{path} is there already and was not made by muybridge" in capfd.readouterr().err
    assert run_command([*arguments, "--overwrite"]) == 0 and path.read_bytes() != OTHERS.encode()
    # Other programs' formats do not say who wrote them.
    assert run_command(arguments) == (2 if which == "model" else 0)


@pytest.mark.parametrize("which", ["board", "people", "check", "scan"])
def test_it_is_said_before_the_work(commands, capfd, which):
    arguments, path = commands[which]
    path.write_text(OTHERS)
    assert run_command(["calibrate", *map(str, arguments)]) == 2 and path.read_text() == OTHERS
    assert f"{path} is there already" in capfd.readouterr().err


def test_what_may_be_replaced(tmp_path):
    save_calibration(rig(), tmp_path / "c.toml")
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    check_replaceable([tmp_path / "c.toml", tmp_path / "none.toml", tmp_path / "empty"], False)
    check_replaceable([tmp_path / "full"], True)
    with pytest.raises(OutputError, match="give --overwrite"):
        check_replaceable([tmp_path / "full"], False)
    assert load_calibration(tmp_path / "c.toml").names == ("c0", "c1")
