"""The commands `match build`, `match play` and `match walk`, from takes to a page and to motion."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError, MuybridgeError
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.characters.matching import parse_ignored
from muybridge.motion.formats.registry import read_file, write_file
from muybridge.motion.graphs.paths import read_corners
from muybridge.motion.matching import Ignored, read_database
from muybridge.motion.take import Take
from tests.motion.matching.walks import walk, walks
from tests.paths import SHARED


@pytest.fixture(scope="module")
def takes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("takes")
    for motion, name in zip(*walks(), strict=True):
        write_file(folder / f"{name}.bvh", Take(motion=motion))
    return folder


@pytest.fixture(scope="module")
def database(takes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("database") / "walks.match"
    assert run_command(["match", "build", str(takes), "--out", str(path)]) == 0
    return path


def test_build_says_what_it_holds(takes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "w.match"
    words = ["match", "build", str(takes), "--mirror", "--fps", "30", "--ignore", "walk_1.2_0:0-0.5", "--out", str(out)]
    assert run_command(words) == 0
    said = capsys.readouterr()
    assert "has 10 clips, 1210 frames at 30 fps" in said.out and "resampled from 60 to 30 frames/s" in said.err
    assert read_database(out).ignored.sum() == 2 * 16


def test_a_path_becomes_a_motion(database: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "path.csv", tmp_path / "walk.bvh"
    path.write_text("x,y\n0,0\n3,0\n5,2\n")
    assert run_command(["match", "walk", str(database), "--path", str(path), "--out", str(out)]) == 0
    assert "cm from the path" in capsys.readouterr().out
    motion = read_file(out).motion
    assert motion is not None
    assert np.linalg.norm(motion.joint_positions_world()[-1, 0, :2] - [5, 2]) < 0.4
    assert run_command(["match", "walk", str(database), "--path", str(path), "--out", str(out)]) == 2
    assert "is there already" in capsys.readouterr().err


def test_seconds_and_speed_are_kept(database: Path, tmp_path: Path) -> None:
    out = tmp_path / "walk.bvh"
    words = ["match", "walk", str(database), "--seconds", "5", "--speed", "1.2", "--out", str(out)]
    assert run_command(words) == 0
    motion = read_file(out).motion
    assert motion is not None and len(motion) == 301
    assert np.linalg.norm(np.diff(motion.joint_positions_world()[[0, -1], 0, :2], axis=0)) == pytest.approx(6, abs=0.6)


def test_bad_takes_are_named(takes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, out = str(takes / "walk_1.2_0.bvh"), str(tmp_path / "w.match")
    write_file(tmp_path / "pose.bvh", Take(motion=walk(0.0)))
    assert run_command(["match", "build", str(tmp_path / "pose.bvh"), "--out", out]) == 2
    assert "pose, has 1" in capsys.readouterr().err
    assert run_command(["match", "build", good, str(tmp_path / "pose.bvh"), "--out", out]) == 0
    assert "pose is left out: it has 1 of the" in capsys.readouterr().err
    for words, what in (
        (["match", "build", good, "--out", str(tmp_path / "w.txt")], "suffix .match"),
        (["match", "build", good, "--ignore", "walk", "--out", out, "--overwrite"], "CLIP:FROM-TO"),
        (["match", "build", str(tmp_path / "none.bvh"), "--out", out, "--overwrite"], "no such file"),
        (["match", "play", good, "--out", str(tmp_path / "p.html")], "walk_1.2_0.bvh"),
        (["match", "walk", out, "--speed", "nan", "--out", str(tmp_path / "w.bvh")], "speed must be"),
        (["match", "walk", out, "--seconds", "0", "--out", str(tmp_path / "w.bvh")], "seconds must be"),
        (["match", "walk", out, "--out", str(tmp_path / "w.xyz")], "w.xyz"),
    ):
        assert run_command(words) == 2, words
        error = capsys.readouterr().err
        assert what in error and "Traceback" not in error, error


def test_takes_of_another_skeleton_are_refused(takes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = SHARED / "data" / "motion" / "01_01.bvh"
    if not other.is_file():
        pytest.skip(f"{other} is absent")
    good, out = str(takes / "walk_1.2_0.bvh"), tmp_path / "w.match"
    assert run_command(["match", "build", good, str(other), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "01_01 moves another skeleton than walk_1.2_0" in error and "muybridge retarget" in error
    assert not out.exists()


def test_recorded_walks_and_runs_are_matched(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [SHARED / "data" / "motion" / name for name in ("02_01.amc", "02_03.amc")]
    if not all(f.is_file() for f in files):
        pytest.skip(f"{files[0]} is absent")
    out = tmp_path / "w.match"
    assert run_command(["match", "build", *map(str, files), "--out", str(out)]) == 0
    assert "has 2 clips, 516 frames at 120 fps" in capsys.readouterr().out
    words = ["match", "walk", str(out), "--seconds", "8", "--speed", "1.2", "--out", str(tmp_path / "w.bvh")]
    assert run_command(words) == 0
    motion = read_file(tmp_path / "w.bvh").motion
    assert motion is not None and len(motion) == 961


def test_paths_over_the_ground(tmp_path: Path) -> None:
    path = tmp_path / "p.csv"
    for text in ("0,0\n1,2\n", "name,Y,X\na,0,0\nb,2,1\n", "\ufeffx,y\n0,0\n\n1,2\n"):
        path.write_text(text, encoding="utf-8")
        np.testing.assert_array_equal(read_corners(path), [[0, 0], [1, 2]])
    for text, what in (
        ("a,b\n0,0\n1,2\n", "x and y"),
        ("x,y\n0,0\n1,nan\n", "line 3"),
        ("x,y\n0,0\n1\n", "line 3"),
        ("", "at least two"),
    ):
        path.write_text(text)
        with pytest.raises(FormatError, match=what):
            read_corners(path)
    with pytest.raises(FormatError, match=r"none\.csv"):
        read_corners(tmp_path / "none.csv")


def test_parts_to_be_ignored() -> None:
    assert parse_ignored("a:b:1-2.5") == Ignored("a:b", 1.0, 2.5)
    for text in ("a", "a:1", "a:1-x", ":1-2", "a:1.2.3-4"):
        with pytest.raises(MuybridgeError, match="names no part"):
            parse_ignored(text)
