"""Commands that write one file replace nothing unasked, and never what they read."""

import numpy as np
import pytest

from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.app import run_command
from muybridge.motion.formats.skeletal.amc import write_amc
from muybridge.motion.formats.skeletal.bvh import write_bvh


@pytest.fixture
def motion() -> Motion:
    skeleton = BODY.skeleton(prior_shape(1.74))
    quat = np.tile([1.0, 0, 0, 0], (3, len(skeleton), 1))
    return Motion(skeleton, 120.0, np.tile([0.0, 0.0, 0.95], (3, 1)), quat)


def refused(capfd, *words: object) -> str:
    assert run_command([str(w) for w in words]) == 2
    return str(capfd.readouterr().err)


def test_an_amc_replaces_no_skeleton_unasked_and_never_the_one_it_reads(tmp_path, capfd, motion):
    write_bvh(tmp_path / "take.bvh", motion)
    (tmp_path / "walk.asf").write_text("mine")
    assert "walk.asf is there already" in refused(capfd, "convert", tmp_path / "take.bvh", tmp_path / "walk.amc")
    assert (tmp_path / "walk.asf").read_text() == "mine" and not (tmp_path / "walk.amc").exists()
    assert run_command(["convert", str(tmp_path / "take.bvh"), str(tmp_path / "walk.amc"), "--overwrite"]) == 0

    (tmp_path / "trial").mkdir()
    write_amc(tmp_path / "trial" / "01_01.amc", motion)
    skeleton = (tmp_path / "trial" / "01_01.asf").rename(tmp_path / "trial" / "01.asf")
    before = skeleton.read_bytes()
    for given in ((), ("--asf", skeleton)):
        said = refused(capfd, "convert", tmp_path / "trial" / "01_01.amc", skeleton.with_suffix(".amc"), "--overwrite",
                       *given)  # fmt: skip
        assert "01.asf is a file to be read" in said and skeleton.read_bytes() == before


def test_a_marker_set_replaces_no_file_unasked(tmp_path, capfd):
    path = tmp_path / "our.txt"
    path.write_text("mine")
    assert "--overwrite" in refused(capfd, "markerset", "show", "pig39", "--out", path)
    assert "--overwrite" in refused(capfd, "markerset", "from", tmp_path / "trial.c3d", "--out", path)
    trial = tmp_path / "trial.txt"
    trial.write_text("a_x,a_y,a_z\n1,2,3\n")
    assert "file to be read" in refused(capfd, "markerset", "from", trial, "--out", trial, "--overwrite")
    assert path.read_text() == "mine" and trial.read_text().startswith("a_x")
    assert run_command(["markerset", "show", "pig39", "--out", str(path), "--overwrite"]) == 0
    assert "LASI" in path.read_text()
