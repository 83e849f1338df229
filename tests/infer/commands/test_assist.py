"""The command assist, run for real."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.characters.assist import AssistRequest, complete
from muybridge.motion.editing.resampling import resample
from muybridge.motion.formats import read_file, write_file
from muybridge.motion.take import Take
from tests.motion.assistance.test_assist import without_arms
from tests.motion.editing.clips import walk


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """Key frames without arms, a take, one at another frame rate of a smaller body, and one of a single frame."""
    keys, _ = without_arms(walk(200))
    small = replace(walk(200), skeleton=replace(walk().skeleton, offsets=walk().skeleton.offsets * 0.8))
    motions = {"keys": keys, "take": walk(230), "small": resample(small, 30.0), "short": walk(1)}
    for name, motion in motions.items():
        write_file(tmp_path / f"{name}.glb", Take(motion=motion))
    return {name: tmp_path / f"{name}.glb" for name in motions}


def test_arms_are_made_and_legs_kept(files: dict[str, Path], tmp_path: Path, capsys) -> None:
    out = tmp_path / "out.glb"
    words = ["assist", str(files["keys"]), "--from", str(files["take"]), str(files["small"]), "--out", str(out)]
    assert run_command(words) == 0
    told = capsys.readouterr()
    assert "driven by left_thigh, right_thigh" in told.out and told.out.splitlines()[-1] == str(out)
    assert "small.glb: retargeted to the skeleton of the key frames" in told.err
    assert "small.glb: resampled from 30 to 60 frames/s" in told.err
    before, after = read_file(files["keys"]).motion, read_file(out).motion
    assert before is not None and after is not None
    leg, arm = (after.skeleton.index(name) for name in ("left_thigh", "left_upper_arm"))
    np.testing.assert_allclose(after.quat_wxyz[:, leg], before.quat_wxyz[:, leg], atol=1e-6)
    assert np.ptp(after.quat_wxyz[:, arm], axis=0).max() > 0.1
    assert run_command(words) == 2
    assert "overwrite" in capsys.readouterr().err


@pytest.mark.parametrize("changes, message", [
    (["--make", "tail"], "there is no joint 'tail'"),
    (["--drive", "wing"], "there is no joint 'wing'"),
    (["--make", "left_thigh"], "cannot drive and be made"),
    (["--texture", "-1"], "--texture is a factor from 0 to 10, not -1"),
])  # fmt: skip
def test_wrong_words_are_refused(files: dict[str, Path], tmp_path: Path, capsys, changes, message) -> None:
    words = ["assist", str(files["keys"]), "--from", str(files["take"]), "--out", str(tmp_path / "out.bvh")]
    drive = ["--drive", "left_thigh"] if changes[0] == "--make" and changes[1] == "left_thigh" else []
    assert run_command([*words, *changes, *drive]) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "out.bvh").exists()


@pytest.mark.parametrize("keys, take, message", [
    ("keys", "short", "short.glb: has 1 frame; at least 8 are needed"),
    ("short", "take", "the key frames have 1 frame; at least 8 are needed"),
    ("keys", "nothing", "nothing.glb: no such file"),
])  # fmt: skip
def test_files_that_cannot_be_used_are_named(files, tmp_path: Path, capsys, keys, take, message) -> None:
    paths = [str(files.get(name, tmp_path / f"{name}.glb")) for name in (keys, take)]
    assert run_command(["assist", paths[0], "--from", paths[1], "--out", str(tmp_path / "out.bvh")]) == 2
    assert message in capsys.readouterr().err


def test_each_take_counts_a_second_time_mirrored(files: dict[str, Path]) -> None:
    done = complete(AssistRequest(files["keys"], (files["take"],)))
    assert [take.mirrored for take in done.takes] == [False, True]
    alone = complete(AssistRequest(files["keys"], (files["take"],), mirror=False))
    assert [take.mirrored for take in alone.takes] == [False]
