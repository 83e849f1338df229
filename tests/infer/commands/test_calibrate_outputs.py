"""What `muybridge calibrate` writes replaces nothing that muybridge did not write."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import OutputError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.commands.app import find_commands, run_command
from muybridge.infer.commands.parsing import parser_of
from muybridge.infer.results.folder import open_output
from muybridge.infer.results.ownership import check_replaceable

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
    (tmp_path / "sync.toml").write_text("# Clocks\nmuybridge_sync = 1\n")
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    ours = [tmp_path / name for name in ("c.toml", "sync.toml", "none.toml", "empty")]
    check_replaceable(ours)
    check_replaceable([tmp_path / "full"], True)
    with pytest.raises(OutputError, match="pass overwrite=True"):
        check_replaceable([tmp_path / "full"])
    with pytest.raises(OutputError, match="c.toml is a file to be read; choose another name"):
        check_replaceable(ours, True, [tmp_path / "empty" / ".." / "c.toml"])
    assert load_calibration(tmp_path / "c.toml").names == ("c0", "c1")


def test_folders_are_made_or_refused_beforehand(tmp_path):
    check_replaceable([tmp_path / "a" / "b" / "c.toml"])
    assert (tmp_path / "a" / "b").is_dir() and not list((tmp_path / "a" / "b").iterdir())
    (tmp_path / "file").write_text(OTHERS)
    with pytest.raises(OutputError, match=r"file.below cannot be written \(.*\); choose a folder you may write to"):
        check_replaceable([tmp_path / "file" / "below" / "c.toml"], True)


@pytest.mark.parametrize("name", ["points", "world", "board", "people", "check", "scan"])
def test_a_folder_that_cannot_be_made_is_refused_before_the_work(commands, capfd, tmp_path, name):
    (tmp_path / "file").write_text(OTHERS)
    arguments = [str(tmp_path / "file" / "below" / "x.toml") if str(a).startswith(str(commands[name][1])) else str(a)
                 for a in commands[name][0]]  # fmt: skip
    assert run_command(["calibrate", *arguments]) == 2
    assert "below cannot be written" in capfd.readouterr().err and (tmp_path / "file").read_text() == OTHERS


COMMANDS_WITH_OUT = {
    "run": ["SESSION"], "run-markers": ["SESSION"], "demo": [], "adapt": ["SESSION"], "sync": ["SESSION"],
    "label": ["FILE"], "solve": ["FILE"], "markerset": ["show", "pig39"], "calibrate board": ["FOLDER"],
    "calibrate check": ["SESSION"], "calibrate people": ["SESSION"], "calibrate points": ["FILE"],
    "calibrate scan": ["FOLDER", "--cameras", "FOLDER"], "calibrate world": ["FILE", "--turn-deg", "90"],
    "synth": [], "train": ["keypoints"], "retarget": ["FILE", "--to", "FILE"],
    "character": ["FILE", "--rig-only"], "view": ["FILE"], "assist": ["FILE", "--from", "FILE"],
    "graph build": ["FILE"], "graph show": ["FILE"],
    "match build": ["FILE"], "match play": ["FILE"], "match walk": ["FILE"],
    "join": ["FILE", "FILE"], "blend": ["FILE", "FILE"], "style": ["FILE"],
}  # fmt: skip


def test_every_command_with_an_out_is_among_these():
    with_out = set()
    for name, entry in find_commands().items():
        parser = parser_of(entry.load(), name)
        subs = [p for a in parser._actions if isinstance(a.choices, dict) for p in a.choices.values()]
        if any("--out" in a.option_strings for p in (parser, *subs) for a in p._actions):
            with_out.add(name)
    assert with_out == set(COMMANDS_WITH_OUT)


@pytest.mark.parametrize("name", COMMANDS_WITH_OUT)
def test_the_root_of_a_file_system_takes_no_results(name, capfd):
    before = set(Path("/").iterdir())
    assert run_command([*name.split(), *COMMANDS_WITH_OUT[name], "--out", "/"]) == 2
    assert "/ is the root of a file system" in capfd.readouterr().err
    assert set(Path("/").iterdir()) == before


def test_positional_outputs_and_results_folders_refuse_the_root_too(tmp_path, capfd):
    save_calibration(rig(), tmp_path / "rig.toml")
    for to in ("colmap", "easymocap"):
        assert run_command(["calibrate", "convert", str(tmp_path / "rig.toml"), "/", "--to", to, "--overwrite"]) == 2
        assert "/ is the root of a file system" in capfd.readouterr().err
    with pytest.raises(OutputError, match="is the root of a file system, .*; choose another folder"):
        open_output(tmp_path.resolve() / Path(*[".."] * 40), (), [])
