"""The examples run as they stand, and what they print is right."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import muybridge
from muybridge.infer.demo_take.take import demo_folder, true_points
from tests.paths import REPOSITORY

EXAMPLES = REPOSITORY / "docs" / "examples"


def _run(number: int, *arguments: str | Path) -> str:
    (example,) = EXAMPLES.glob(f"{number:02d}_*.py")
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY / ".root"), "PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(
        [sys.executable, str(example), *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=600,
        env=environment,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def _numbers(pattern: str, text: str) -> list[float]:
    found = re.search(pattern, text)
    assert found, text
    return [float(group) for group in found.groups()]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the true points of the demo's take, `points.trc`, and a body fitted to them, `motion.bvh`."""
    folder = tmp_path_factory.mktemp("recorded")
    places, names = true_points(demo_folder())
    points = muybridge.make_points(places, names, fps=25)
    muybridge.write_points(folder / "points.trc", points)
    muybridge.write_motion(folder / "motion.bvh", muybridge.fit_body(points).motion)
    return folder


@pytest.mark.slow
def test_capture_of_a_session(short_demo: Path, tmp_path: Path) -> None:
    text = _run(3, short_demo, tmp_path / "out")
    assert "48 frames of 23 landmarks at 25 frames/s" in text
    coverage, away = _numbers(r"coverage ([\d.]+)%, leave-one-camera-out ([\d.]+) px", text)
    assert coverage > 95 and away < 5
    assert len(muybridge.read_motion(tmp_path / "out" / "motion.fbx")) == 48
    assert (tmp_path / "out" / "points.csv").is_file()
    ranked = _run(11, tmp_path)
    assert f"coverage {coverage:.1f}%, leave-one-camera-out {away:.1f} px" in ranked


def test_conversion_of_a_motion(recorded: Path, tmp_path: Path) -> None:
    text = _run(4, recorded / "motion.bvh", tmp_path / "first.glb", tmp_path / "joints.trc")
    assert "100 frames at 25 frames/s, 21 joints" in text
    source = muybridge.read_motion(recorded / "motion.bvh")
    whole, names = source.joint_positions_world(), source.skeleton.names
    first = muybridge.read_motion(tmp_path / "first.glb")
    order = [first.skeleton.index(name) for name in names]  # glTF lists joints depth first
    np.testing.assert_allclose(first.joint_positions_world()[:, order], whole[:25], atol=1e-4)
    points = muybridge.read_points(tmp_path / "joints.trc")
    assert points.landmarks.names == names
    np.testing.assert_allclose(points.points_world, whole[:25], atol=1e-5)


def test_triangulation_of_arrays() -> None:
    text = _run(5, str(demo_folder().joinpath("calibration.toml")))
    median, largest = _numbers(r"median error ([\d.]+) mm, largest ([\d.]+) mm", text)
    assert median < 20 and largest < 100
    assert "cam1 was ignored in 100% of the wrong cases" in text


def test_smoothing_of_points(recorded: Path, tmp_path: Path) -> None:
    text = _run(6, recorded / "points.trc", tmp_path / "smooth.trc")
    errors = [float(value) for value in re.findall(r"RMS error +([\d.]+) mm", text)]
    assert errors[0] > 50 and max(errors[1:]) < 20
    smooth = muybridge.read_points(tmp_path / "smooth.trc").points_world
    # The gap is closed; what is an outlier in the first or last frame stays missing, since nothing is extrapolated.
    assert np.isfinite(smooth[10:14, 0]).all() and np.isfinite(smooth[5:-5]).all() and np.isfinite(smooth).mean() > 0.99


def test_fit_of_a_body(recorded: Path, tmp_path: Path) -> None:
    text = _run(7, recorded / "points.trc", tmp_path / "motion.bvh")
    (stature,) = _numbers(r"stature ([\d.]+) m", text)
    assert 1.3 < stature < 1.9
    assert re.findall(r"varies by ([\d.]+) mm", text) == ["0.000"] * 4
    assert len(muybridge.read_motion(tmp_path / "motion.bvh")) == 100


def test_inverse_kinematics(recorded: Path) -> None:
    lines = _run(8, recorded / "motion.bvh").splitlines()
    assert len(lines) == 3
    for line in lines:
        assert "success True" in line and _numbers(r"([\d.]+) mm off", line)[0] < 0.2


def test_a_style_learned_from_a_take(recorded: Path, tmp_path: Path) -> None:
    line = _run(12, tmp_path / "own.style", recorded / "motion.bvh", recorded / "motion.bvh")
    examples, away = _numbers(r"(\d+) examples; the hand is ([\d.]+) mm off", line)
    assert 8 <= examples <= 100 and away < 0.5


def test_landmarks_of_an_image() -> None:
    lines = _run(9, str(demo_folder().joinpath("videos", "cam1.mp4"))).splitlines()
    assert lines[0].startswith("1 people") and len(lines) == 24
    names = [line.split()[0] for line in lines[1:]]
    assert names == list(muybridge.BODY23.names)
    x, y = np.array([line.split()[1:3] for line in lines[1:]], float).T
    assert (0 < x).all() and (x < 640).all() and (0 < y).all() and (y < 480).all()
    assert y[names.index("nose")] < y[names.index("left_hip")] < y[names.index("left_ankle")]


@pytest.mark.slow
def test_frame_by_frame(short_demo: Path) -> None:
    lines = _run(10, short_demo, 4).splitlines()
    places, names = true_points(demo_folder())
    assert len(lines) == 4
    for number, line in enumerate(lines):
        nose = _numbers(r"person 0, nose at (-?[\d.]+) (-?[\d.]+) (-?[\d.]+) m", line)
        assert line.startswith(f"frame {number}:")
        assert np.linalg.norm(np.array(nose) - places[number, names.index("nose")]) < 0.1


def test_ranking_puts_problems_first(tmp_path: Path) -> None:
    for name, away, problems in (("good", 2.0, []), ("bad", 9.0, []), ("turned", 5.0, ["cam2 was turned"])):
        cameras = {"cam1": {"leave_one_out_px": away}, "cam2": {"leave_one_out_px": away + 1}}
        quality = {"coverage": 1.0, "leave_one_out_px": away, "cameras": cameras}
        run = {"session": {"name": name}, "quality": quality, "problems": problems}
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text(json.dumps(run))
    lines = [line for line in _run(11, tmp_path).splitlines() if "coverage" in line]
    assert [line.split(":")[0] for line in lines] == ["turned", "bad", "good"]
