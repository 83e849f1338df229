"""The demo, and the pipeline's accuracy on it and on the real take."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.commands.app import run_command
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name
from muybridge.infer.pipelines.demo import score
from muybridge.motion.formats.points.trc import read_trc
from tests.infer.pipelines.test_pipeline import FILES, refused


@pytest.fixture
def little_demo(take, staged_people) -> Path:
    """A take like the demo's."""
    points = staged_people.person(30)
    np.savez(take / "truth.npz", points_world=points, names=np.array(BODY23.names))
    return take


def test_the_demo_reports_its_error(little_demo, staged, monkeypatch, tmp_path):
    monkeypatch.setattr("muybridge.infer.pipelines.demo.demo_folder", lambda: little_demo)
    out = tmp_path / "shown"
    done = staged("demo", "--out", out)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("MPJPE ")]
    assert len(lines) == 1 and lines[0].endswith(" mm")
    assert 0 < float(lines[0].split()[1]) < 15
    assert str(out) in done.stdout.splitlines()[-1]
    assert {p.name for p in out.iterdir()} == {*FILES, "take"}
    again = staged("demo", "--out", out)
    assert again.returncode == 0 and "cam1: 2D landmarks resumed" in again.stderr


def test_the_demo_refuses_a_folder_of_someone_else(little_demo, staged, monkeypatch, tmp_path):
    monkeypatch.setattr("muybridge.infer.pipelines.demo.demo_folder", lambda: little_demo)
    out = tmp_path / "shown"
    (out / "take").mkdir(parents=True)
    (out / "take" / "calibration.toml").write_text("mine")
    refused(staged("demo", "--out", out), "calibration.toml", "--out")
    assert (out / "take" / "calibration.toml").read_text() == "mine"


def test_the_score_is_a_plain_distance():
    truth = np.zeros((4, 2, 3))
    truth[0, 0] = np.nan
    found = np.full((4, 23, 3), np.nan)
    found[:, BODY23.index("nose")] = (0.03, 0.04, 0)
    found[1:3, BODY23.index("left_hip")] = (0, 0, 0.1)
    points = Points3D(BODY23, found, np.full((4, 23, 3, 3), np.nan), np.empty((0, 4, 23)), np.empty((0, 4, 23)), 30)
    result = score(points, truth, ["nose", "left_hip"])
    assert result.mpjpe_mm == pytest.approx((3 * 50 + 2 * 100) / 5)
    assert result.coverage == pytest.approx(5 / 7)
    with pytest.raises(ValueError, match="truth of 3"):
        score(points, truth[:3], ["nose", "left_hip"])


def test_the_real_demo_is_near_its_truth(tmp_path, capfd):
    assert run_command(["demo", "--out", str(tmp_path / "demo")]) == 0
    line = next(line for line in capfd.readouterr().out.splitlines() if line.startswith("MPJPE "))
    assert float(line.split()[1]) <= 30
    # Its calibration is that of the cameras that rendered it.
    assert json.loads((tmp_path / "demo" / "run.json").read_text())["calibration"]["faults"] == []


@pytest.mark.slow  # the demo runs the networks too, and the next test has this footage
def test_the_real_take_is_accurate(real_data, tmp_path):
    out = tmp_path / "balancing"
    # In a process of its own, whose memory is its alone.
    run = [sys.executable, "-m", "muybridge", "run", real_data / "balancing", "--out", out]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = {"points.trc", "points.c3d", "motion.bvh", "motion.glb", "report.html", "run.json", "calibration.toml"}
    assert {p.name for p in out.iterdir()} == names | {f"overlay_cam0{k}.mp4" for k in (1, 2, 3, 4)} | {"work"}
    scored = subprocess.run(
        [sys.executable, real_data.parent / "tools" / "score_balancing.py", out / "points.trc", "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    figures = json.loads(scored.stdout)
    assert figures["coverage"] >= 0.99
    assert figures["mpjpe_aligned_mm"] <= 55
    assert figures["mpjpe_offset_free_mm"] <= 42
    facts = json.loads((out / "run.json").read_text())
    assert facts["quality"]["leave_one_out_px"] <= 25
    assert facts["machine"]["peak_memory_mb"] <= 2000


def test_the_real_take_with_the_references_landmarks(real_data, tmp_path, staged, staged_people, monkeypatch):
    """Everything but the networks, on real footage: what another system saw gives what it found in 3D."""
    reference = np.load(real_data / "balancing" / "reference" / "openpose_body25b.npz")
    columns = [list(reference["names"]).index(n) for n in BODY23.names]
    seen = reference["keypoints2d_px"][:, :, columns]

    def finish(estimator):
        camera = int(estimator._camera.name[-1]) - 1
        known = seen[camera, ..., 2] > 0.3
        points = np.where(known[..., None], seen[camera, ..., :2], np.nan)[:, None]
        known = known[:, None]
        score = np.where(known, 0.9, 0.0)
        body = LandmarkArrays(BODY23, points, np.where(known, 16.0, np.nan), score, score)
        return CameraTracks(by_name([body]), np.full((100, 1, 4), np.nan), np.zeros((100, 1), np.int64))

    monkeypatch.setattr(staged_people.StagedEstimator, "finish", finish)
    assert staged("run", real_data / "balancing", "--out", tmp_path / "out").returncode == 0
    found = read_trc(tmp_path / "out" / "points.trc").points_world
    error = np.linalg.norm(found - reference["points3d_world"][:, columns], axis=-1)
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmedian(error) < 0.035
    quality = json.loads((tmp_path / "out" / "run.json").read_text())["quality"]
    assert quality["leave_one_out_px"] < 30  # the notes say 22.7 for these landmarks and this calibration
