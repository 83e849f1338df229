"""The command edit, run for real."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.commands.app import run_command
from muybridge.infer.commands.motion.edit import edit
from muybridge.infer.commands.parsing import description
from muybridge.motion.editing.steps import STEPS
from muybridge.motion.formats.points.trc import read_trc, write_trc
from muybridge.motion.formats.registry import read_file, writable
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from tests.motion.editing.clips import points, two_roots, walk, with_root_bone


@pytest.fixture(scope="module")
def bvh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edit") / "walk.bvh"
    write_bvh(path, walk(150))
    return path


def test_steps_are_done_in_one_go(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.bvh"
    words = "trim 0.2 2.2 mirror turn -90 move 1 -1 0 in-place resample 30 scale 2 floor reduce 5mm"
    assert run_command(["edit", str(bvh), *words.split(), str(out), "--units", "m"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0].split()[2] for line in told[:-1]] == [w for w in words.split() if w in STEPS]
    assert told[-1].startswith(f"{out}: has 60 frames at 30 fps (2.000 s), 21 joints")
    motion = read_bvh(out)
    assert len(motion) == 60 and motion.fps == pytest.approx(30)
    assert np.abs(motion.root_positions_world[:, :2]).max() < 0.2


@pytest.mark.parametrize("suffix", writable())
def test_any_format_out(bvh: Path, tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    out = tmp_path / f"out{suffix}"
    assert run_command(["edit", str(bvh), "loop", "0.8", "rename", "vrm", str(out), "--units", "m", "-q"]) == 0
    if suffix != ".usda":
        assert len(read_file(out).positions.points_world) > 48


@pytest.mark.parametrize("suffix", [".glb", ".fbx", ".bvh"])
def test_root_motion_survives_the_file(bvh: Path, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"out{suffix}"
    assert run_command(["edit", str(bvh), "root-motion", "name=trajectory", str(out), "--units", "m"]) == 0
    motion = read_file(out).motion
    before = read_bvh(bvh)
    assert motion is not None and motion.skeleton.names[0] == "trajectory"
    hips = motion.joint_positions_world()[:, motion.skeleton.index("hips")]
    np.testing.assert_allclose(hips, before.root_positions_world, atol=2e-5)


def test_a_dry_run_says_what_it_would_do(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    words = ["trim", "0.2", "mirror", "loop", "0.8", str(folder / "out.glb")]
    assert run_command(["edit", str(bvh), *words, "--dry-run", "--units", "m"]) == 0
    told = capsys.readouterr().out
    assert "step 2, mirror: " in told and "pairs of joints exchanged" in told and "would have" in told
    assert not folder.exists()


def test_points_are_edited(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", points())
    out = tmp_path / "b.trc"
    assert run_command(["edit", str(tmp_path / "a.trc"), "trim", "0.5", "mirror", "x", str(out)]) == 0
    before, after = read_trc(tmp_path / "a.trc"), read_trc(out)
    a, b = (before.landmarks.index(f"{side}_hand") for side in ("left", "right"))
    np.testing.assert_allclose(after.points_world[:, a], before.points_world[30:, b] * (-1, 1, 1), atol=1e-6)


def _refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    assert run_command(["edit", *map(str, words)]) == 2
    told = capsys.readouterr().err.strip()
    assert told.startswith("error: ") and "\n" not in told
    return told


def test_bad_input_is_refused_in_one_line(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.glb"
    for words, expected in (
        ([], "there is no file to edit"),
        ([bvh], "there is no step"),
        ([bvh, out], "there is no step"),
        (["trim", "0", "1", out], "stands where the file to read belongs"),
        ([bvh, "trim", "0", "1"], "'1' stands where the file to write belongs"),
        ([bvh, "mirror"], "'mirror' stands where the file to write belongs"),
        ([bvh, "trimm", "0", "1", out], "did you mean 'trim'"),
        ([bvh, "trim", out], "start is missing"),
        ([bvh, "trim", "0", "99", out, "--units", "m"], "step 1, trim 0 99"),
        ([bvh, "resample", "0", out, "--units", "m"], "must be above 0"),
        ([bvh, "mirror", bvh], "is a file to be read"),
        ([bvh, "mirror", bvh, "--dry-run"], "is the file to be read"),
        ([bvh, "mirror", tmp_path / "out.xyz"], "cannot be written"),
        ([tmp_path / "none.bvh", "mirror", out], "no such file"),
    ):
        assert expected in _refused(capsys, *words), words
    assert not list(tmp_path.iterdir())


def test_an_empty_clip_and_nan_are_refused(tmp_path: Path, bvh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, _, frames = bvh.read_text().partition("MOTION")
    lines = frames.splitlines()
    values = lines[3].split()
    for name, text in (
        ("empty", "\n".join(["", "Frames: 0", lines[2], ""])),
        ("nan", "\n".join(["", "Frames: 1", lines[2], " ".join(["nan", *values[1:]]), ""])),
    ):
        path = tmp_path / f"{name}.bvh"
        path.write_text(f"{head}MOTION{text}")
        _refused(capsys, path, "mirror", tmp_path / "out.glb", "--units", "m")
    assert not (tmp_path / "out.glb").exists()


def test_what_a_format_cannot_hold_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for k, clip in enumerate((two_roots(), with_root_bone())):
        write_bvh(tmp_path / f"{k}.bvh", clip)
        out = tmp_path / "out.amc"
        assert "write .glb, .fbx or .bvh instead" in _refused(
            capsys, tmp_path / f"{k}.bvh", "mirror", out, "--units", "m"
        )
        assert not out.exists() and not out.with_suffix(".asf").exists()


def test_help_is_made_from_the_table() -> None:
    text = description(edit)
    assert "{steps}" not in text
    for step in STEPS.values():
        assert f"    {step.usage}\n" in text
        for parameter in step.parameters:
            assert f"{parameter.name}: " in text


@pytest.mark.parametrize(
    "words, message",
    [
        ("loop -1", "must last longer than 0 s"),
        ("loop 0.1 longest=0", "must last longer than 0 s"),
        ("trim 0 99", "without an end, all to its end is kept"),
        ("trim 99", "no frame is left from 99 s on"),
        ("trim -1", "begins at 0 s"),
        ("move 1e30", "takes the body 1e+30 m away"),
        ("scale 1e9", "m away; 1000 m are the most"),
    ],
)
def test_what_leads_nowhere_is_refused_without_a_trace(
    bvh: Path, tmp_path: Path, words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "deeper" / "out.bvh"
    assert run_command(["edit", str(bvh), *words.split(), str(out), "--units", "m"]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir()), "nor is a folder left"


def test_any_angle_is_an_angle(bvh: Path, tmp_path: Path) -> None:
    out = [tmp_path / "a.bvh", tmp_path / "b.bvh"]
    for angle, path in zip(("36090", "90"), out, strict=True):
        assert run_command(["edit", str(bvh), "turn", angle, str(path), "--units", "m"]) == 0
    a, b = (read_bvh(path).joint_positions_world() for path in out)
    np.testing.assert_allclose(a, b, atol=1e-5)
    assert run_command(["edit", str(bvh), "turn", "1e308", str(tmp_path / "c.bvh"), "--units", "m"]) == 0


def test_options_may_stand_between_words(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.bvh"
    for words in ([bvh, "--units", "m", "turn", "-90", "--dry-run", out], ["--units=m", bvh, "turn", "-90", "-q", out]):
        assert run_command(["edit", *map(str, words)]) == 0
        assert "turn -90" in capsys.readouterr().out
    assert out.is_file()


def test_a_dry_run_says_that_the_file_is_there(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.bvh"
    out.write_text("mine")
    assert run_command(["edit", str(bvh), "mirror", str(out), "--units", "m", "--dry-run"]) == 0
    assert "is there already; without --dry-run, --overwrite is needed" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_keys_that_come_back_are_told(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, name, told in (("reduce 2", "a.bvh", "a key in each frame"), ("reduce 2 mirror", "b.glb", "do it last"),
                              ("mirror reduce 2", "c.glb", "")):  # fmt: skip
        assert run_command(["edit", str(bvh), *words.split(), str(tmp_path / name), "--units", "m"]) == 0
        error = capsys.readouterr().err
        assert told in error and bool(told) == bool(error)


def test_one_frame_is_one_frame(bvh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["edit", str(bvh), "trim", "3f", "4f", str(tmp_path / "a.bvh"), "--units", "m"]) == 0
    assert "has 1 frame at" in capsys.readouterr().out
