"""Options that say what a file does not: what they refuse, and what they do."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.geometry.fitting.subject import MarkerFitOptions
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.app import run_command
from muybridge.infer.commands.convert import convert
from muybridge.motion.formats.points.c3d import read_c3d, write_c3d
from muybridge.motion.formats.points.trc import write_trc
from muybridge.motion.formats.registry import ReadOptions, read_file, readable, writable
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh


def make_points(frames: int = 12) -> Points3D:
    xyz = np.random.default_rng(0).normal(0, 1, (frames, 3, 3))
    none = np.empty((0, frames, 3))
    names = LandmarkSet("m", ("LASI", "RASI", "SACR"), ())
    return Points3D(names, xyz, np.full((*xyz.shape, 3), np.nan), none, none.astype(bool), 100.0)


def make_motion() -> Motion:
    skeleton = BODY.skeleton(prior_shape(1.74))
    quat = np.tile([1.0, 0, 0, 0], (6, len(skeleton), 1))
    return Motion(skeleton, 60.0, np.tile([0.0, 0.0, 0.95], (6, 1)), quat)


def refused(capfd, *words: object) -> str:
    assert run_command([str(w) for w in words]) == 2
    said = capfd.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1, said
    return str(said)


@pytest.mark.parametrize("fps", ["0", "-30", "nan", "inf"])
def test_a_frame_rate_is_a_number_above_zero(tmp_path, capfd, fps):
    a = tmp_path / "a.trc"
    write_trc(a, make_points())
    for command in (("convert", a, tmp_path / "b.csv"), ("solve", a, "--out", tmp_path / "o"),
                    ("label", a, "--out", tmp_path / "o")):  # fmt: skip
        assert f"--fps {float(fps):g}" in refused(capfd, *command, "--fps", fps)
    assert f"--fps {float(fps):g}" in refused(capfd, "compare", a, a, "--fps", "30", fps)


def test_choices_that_do_not_exist_are_refused(tmp_path, capfd):
    write_trc(tmp_path / "a.trc", make_points())
    with pytest.raises(SystemExit):
        run_command(["compare", str(tmp_path / "a.trc"), str(tmp_path / "a.trc"), "--up", "q", "q"])
    for name in ("rounds", "calibration_frames"):
        with pytest.raises(ValueError, match=f"{name} must be at least 1"):
            MarkerFitOptions(**{name: 0})


def test_names_beyond_ascii_and_suffixes_in_capitals_are_written(tmp_path, capfd):
    motion = make_motion()
    named = replace(motion.skeleton, names=("Hüfte", *motion.skeleton.names[1:]))
    write_bvh(tmp_path / "a.bvh", replace(motion, skeleton=named))
    assert read_bvh(tmp_path / "a.bvh").skeleton.names[0] == "Hüfte"
    write_c3d(tmp_path / "X.C3D", make_points())
    assert [p.name for p in tmp_path.glob("*C3D")] == ["X.C3D"]
    assert len(read_c3d(tmp_path / "X.C3D").points_world) == 12


def test_every_motion_takes_its_frame_rate_and_refuses_what_its_format_says(tmp_path, capfd):
    write_bvh(tmp_path / "a.bvh", make_motion())
    for name in ("a.glb", "a.fbx", "a.amc"):
        assert run_command(["convert", str(tmp_path / "a.bvh"), str(tmp_path / name)]) == 0
    for name in ("a.bvh", "a.glb", "a.fbx", "a.amc"):
        assert read_file(tmp_path / name, ReadOptions(fps=50)).fps == 50
        assert read_file(tmp_path / name, ReadOptions(fps=50)).positions.fps == 50
    to = tmp_path / "b.csv"
    for name, option, value in (("a.glb", "units", "cm"), ("a.bvh", "up", "y"), ("a.amc", "units", "m"),
                                ("a.fbx", "asf", "a.asf"), ("a.bvh", "asf", "a.asf")):  # fmt: skip
        assert f"--{option}" in refused(capfd, "convert", tmp_path / name, to, f"--{option}", value)
    write_trc(tmp_path / "a.trc", read_file(tmp_path / "a.bvh").positions)
    said = ["compare", str(tmp_path / "a.trc"), str(tmp_path / "a.bvh"), "--up", "y", "y"]
    assert run_command(said) == 0, "one of the two files leaves it open"
    assert "--up" in refused(capfd, "compare", tmp_path / "a.bvh", tmp_path / "a.glb", "--up", "y", "y")


def test_the_help_of_convert_names_every_format():
    said = str(convert.__doc__)
    for suffix in {*readable(), *writable()}:
        assert f"{suffix} " in said or f"{suffix}." in said or f"{suffix};" in said or f"{suffix}," in said, suffix


@pytest.mark.parametrize("command", ["solve", "label"])
def test_results_beside_the_input_want_another_folder(tmp_path, capfd, command):
    points = make_points()
    labels, twice = LandmarkSet("m", PLUG_IN_GAIT.labels[:6], ()), np.tile(points.points_world, (1, 2, 1))
    write_trc(tmp_path / "a.trc", replace(points, landmarks=labels, points_world=twice))
    said = refused(capfd, command, tmp_path / "a.trc", "--out", tmp_path)
    assert "is the folder of the input" in said and "choose another folder with --out" in said
