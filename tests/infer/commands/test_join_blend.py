"""The commands join and blend, run for real."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.commands.app import run_command
from muybridge.infer.commands.motion.blend import blend
from muybridge.infer.commands.motion.join import Making, join
from muybridge.motion.formats.points.trc import write_trc
from muybridge.motion.formats.registry import read_file
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from tests.motion.editing.clips import points, uneven, walk


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("join")
    motion = walk(150)
    write_bvh(path / "walk.bvh", motion)
    faster = motion.root_positions_world * [1.0, 1.3, 1.0]
    write_bvh(path / "fast.bvh", replace(motion, root_positions_world=faster))
    write_bvh(path / "slow.bvh", replace(motion.select(slice(0, None, 2)), fps=30.0))
    write_bvh(path / "one.bvh", motion.select(slice(0, 1)))
    wide = uneven()
    offsets = wide.skeleton.offsets * 1.3
    write_bvh(path / "other.bvh", replace(wide, skeleton=replace(wide.skeleton, offsets=offsets)))
    write_trc(path / "points.trc", points())
    return path


@pytest.mark.parametrize("how", ["inertial", "crossfade", "quadratic", "align"])
def test_files_are_joined(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], how: str) -> None:
    out = tmp_path / "both.bvh"
    words = [str(folder / "walk.bvh"), str(folder / "fast.bvh"), "--out", str(out), "--how", how, "--units", "m"]
    assert run_command(["join", *words]) == 0
    told = capsys.readouterr().out
    assert "walk.bvh at " in told and "-> fast.bvh at " in told and f"{out}: has " in told
    motion = read_bvh(out)
    assert 150 < len(motion) <= 300
    # As long as both walks, one behind the other, but for what was left out.
    x = motion.root_positions_world[:, :2]
    assert np.linalg.norm(x[-1] - x[0]) > 4.0


def test_a_join_at_given_times_and_other_frame_rates(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [folder / "walk.bvh", folder / "slow.bvh", folder / "walk.bvh"]
    assert join(tuple(files), options=Making(tmp_path / "all.glb", units="m"), at=(2.0, 0.5, 2.0, 0.5)) == 0
    printed = capsys.readouterr()
    assert "slow.bvh is resampled from 30 to 60 frames/s" in " ".join(printed.err.split())
    assert "walk.bvh at 2.00 s -> slow.bvh at 0.50 s: frame 121" in printed.out
    motion = read_file(tmp_path / "all.glb").motion
    assert motion is not None and motion.fps == pytest.approx(60)


def test_files_are_blended(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    speeds = []
    for k, weights in enumerate((["1", "0"], ["0.5", "0.5"], ["0", "1"])):
        out = tmp_path / f"{k}.bvh"
        files = [str(folder / "walk.bvh"), str(folder / "fast.bvh")]
        assert (
            run_command(["blend", *files, "--out", str(out), "--weights", *weights, "--no-plant", "--units", "m"]) == 0
        )
        x = read_bvh(out).root_positions_world[:, :2]
        speeds.append(float(np.linalg.norm(x[-1] - x[0])) / len(x))
    assert speeds[2] / speeds[0] == pytest.approx(1.3, rel=0.03)
    assert speeds[1] == pytest.approx(0.5 * (speeds[0] + speeds[2]), rel=0.02)
    assert "fast.bvh from 0.00 to" in capsys.readouterr().out


@pytest.mark.parametrize(("command", "files", "options", "message"), [
    ("join", ["walk", "one"], [], "one.bvh has 1 frame, and a join needs at least 3"),
    ("blend", ["one", "walk"], [], "one.bvh has 1 frame, and a blend needs at least 3"),
    ("join", ["walk", "other"], [], "other.bvh moves another skeleton than walk.bvh"),
    ("blend", ["walk", "other"], [], "muybridge retarget"),
    ("join", ["walk"], [], "a join needs at least two files"),
    ("blend", ["walk", "gone"], [], "gone.bvh: no such file"),
    ("join", ["walk", "fast"], ["--overlap", "0"], "nothing would overlap"),
    ("join", ["walk", "fast"], ["--at", "1"], "1 join needs 2 times, not 1"),
    ("join", ["walk", "fast"], ["--at", "9", "0"], "has no frame at 9 s"),
    ("join", ["walk", "fast"], ["--seconds", "0"], "must last longer than 0 s"),
    ("blend", ["walk", "fast"], ["--weights", "1", "-1"], "from 0 to 1, not -1"),
    ("blend", ["walk", "fast"], ["--weights", "0", "0"], "all zero"),
    ("blend", ["walk", "fast"], ["--weights", "1"], "do not fit 2 motions"),
])  # fmt: skip
def test_what_cannot_be_done_is_said(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, files: list[str],
    options: list[str], message: str,
) -> None:  # fmt: skip
    out = tmp_path / "out.bvh"
    named = [str(folder / f"{name}.bvh") for name in files]
    assert run_command([command, *named, "--out", str(out), "--units", "m", *options]) == 2
    assert message in " ".join(capfd.readouterr().err.split())
    assert not out.exists()


def test_points_and_files_that_are_there_are_refused(
    folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.bvh"
    words = [str(folder / "walk.bvh"), str(folder / "points.trc"), "--out", str(out)]
    assert run_command(["join", *words]) == 2
    assert "points.trc holds points" in " ".join(capfd.readouterr().err.split())
    out.write_text("mine")
    for command in ("join", "blend"):
        assert run_command([command, str(folder / "walk.bvh"), str(folder / "fast.bvh"), "--out", str(out)]) == 2
        assert "is there already" in capfd.readouterr().err
    assert out.read_text() == "mine"
    assert run_command(["blend", str(out), str(folder / "walk.bvh"), "--out", str(out), "--overwrite"]) == 2
    assert "is a file to be read" in capfd.readouterr().err


def test_commands_can_be_called_from_python(folder: Path, tmp_path: Path) -> None:
    files = (folder / "walk.bvh", folder / "fast.bvh")
    assert blend(files, options=Making(tmp_path / "b.bvh", units="m"), plant=False) == 0
    assert (tmp_path / "b.bvh").is_file()


def test_options_may_stand_between_the_files(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "both.bvh"
    words = [str(folder / "walk.bvh"), "--out", str(out), "--units", "m", "--no-plant", str(folder / "fast.bvh")]
    assert run_command(["join", *words]) == 0
    assert out.is_file()
