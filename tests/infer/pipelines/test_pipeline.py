"""The whole chain: its files, its figures, resuming, and bad input that changes nothing."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest

from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.gravity import standing_axes
from muybridge.geometry.calibration.world import transform_cameras
from muybridge.geometry.landmarks.marker_sets import PLUG_IN_GAIT
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.commands.app import run_command
from muybridge.infer.detection.tracks import CameraTracks, LandmarkArrays, by_name, tracks_from
from muybridge.motion.formats.points.c3d import read_c3d
from muybridge.motion.formats.points.trc import read_trc
from muybridge.motion.formats.skeletal.bvh import read_bvh

FILES = {
    "points.trc", "points.c3d", "motion.bvh", "motion.glb", "report.html", "run.json", "calibration.toml",
    "overlay_cam1.mp4", "overlay_cam2.mp4", "overlay_cam3.mp4", "work",
}  # fmt: skip


def snapshot(folder: Path) -> dict[str, str]:
    """Every file below a folder and its digest."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() if p.is_file() else "folder"
        for p in sorted(folder.rglob("*"))
    }


def refused(done: subprocess.CompletedProcess[str], *said: str) -> None:
    """Exit code 2 and one line, with these words in it."""
    assert done.returncode == 2, done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: "), done.stderr
    for text in said:
        assert text in lines[0]
    assert done.stdout == ""


def test_a_run_writes_every_file_and_its_figures(take, staged, tmp_path):
    before = snapshot(take)
    out = tmp_path / "results"
    done = staged("run", take, "--out", out)
    assert done.returncode == 0, done.stderr
    assert {p.name for p in out.iterdir()} == FILES
    assert snapshot(take) == before
    points = read_trc(out / "points.trc")
    assert points.points_world.shape == (30, 23, 3) and points.fps == 30
    assert np.isfinite(points.points_world).mean() > 0.95
    assert read_c3d(out / "points.c3d").points_world == pytest.approx(points.points_world, abs=1e-4, nan_ok=True)
    facts = json.loads((out / "run.json").read_text())
    assert set(facts["results"]) == FILES - {"work"}
    quality = facts["quality"]
    assert quality["coverage"] > 0.95
    assert 0 < quality["reprojection_px"] < 1.0
    assert 0 < quality["leave_one_out_px"] < 3.0
    assert quality["no_point_share"] < 0.05
    assert set(quality["cameras"]) == {"cam1", "cam2", "cam3"}
    assert facts["options"]["solve"]["triangulate"]["min_views"] == 2
    assert facts["versions"]["numpy"] == np.__version__
    assert facts["session"]["cameras"]["cam2"]["video"] == "cam2.mp4"
    assert all(not stage["resumed"] for stage in facts["stages"].values())
    assert str(out) in done.stdout and "results" in done.stdout
    for camera in ("cam1", "cam2", "cam3"):
        with av.open(str(out / f"overlay_{camera}.mp4")) as film:
            assert film.streams.video[0].codec_context.name == "h264"
            assert sum(1 for _ in film.decode(video=0)) == 30


def test_the_result_is_where_the_person_is(take, staged, staged_people):
    assert staged("run", take, "--quiet").returncode == 0
    points = read_trc(take / "muybridge" / "points.trc").points_world
    error = np.linalg.norm(points - staged_people.person(30), axis=-1)
    assert np.nanmean(error) < 0.015


def test_the_world_may_be_a_cameras_own(take, staged, staged_people):
    file = take / "calibration.toml"
    cameras = load_calibration(file)
    own = np.column_stack([cameras[0].rotation, cameras[0].translation])
    save_calibration(transform_cameras(cameras, own), file)
    done = staged("run", take)
    assert done.returncode == 0 and "not +Z" in done.stderr + done.stdout
    lying = read_trc(take / "muybridge" / "points.trc").points_world
    # The stand-in stands in the upright world, in which it is read.
    assert staged("run", take, "--world", "upright", "--out", take / "upright").returncode == 0
    points = read_trc(take / "upright" / "points.trc").points_world
    assert np.nanmean(np.linalg.norm(points - staged_people.person(30), axis=-1)) < 0.015
    axes = [standing_axes(p, BODY23).mean(0) for p in (lying, points)]
    assert abs(axes[0][2]) < 0.9 < 0.99 < axes[1][2]
    # One is the other, turned.
    stood = load_calibration(take / "upright" / "calibration.toml")
    rotation = stood[0].rotation.T @ load_calibration(take / "muybridge" / "calibration.toml")[0].rotation
    assert np.nanmedian(np.linalg.norm(lying @ rotation.T - points, axis=-1)) < 0.005


def test_virtual_markers_are_written_under_a_laboratorys_names(take, staged, staged_people):
    assert staged("run", take, "--quiet", "--markers", "plug-in-gait").returncode == 0
    markers = read_c3d(take / "muybridge" / "markers.c3d")
    assert markers.landmarks.names == PLUG_IN_GAIT.labels
    truth = staged_people.skin(30)[:, PLUG_IN_GAIT.surface_indices]
    assert np.nanmax(np.linalg.norm(markers.points_world - truth, axis=-1)) < 0.02
    assert "markers.c3d" in json.loads((take / "muybridge" / "run.json").read_text())["results"]
    # Another set of names needs no network; a run without any takes the file away.
    done = staged("run", take, "--markers", "cmu")
    assert "2D landmarks resumed" in done.stderr + done.stdout
    assert "LFWT" in read_c3d(take / "muybridge" / "markers.c3d").landmarks.names
    assert staged("run", take, "--quiet").returncode == 0
    assert not (take / "muybridge" / "markers.c3d").exists()


def test_everyone_gets_files_of_their_own(take, staged, staged_people, monkeypatch):
    """Two people who walk past each other; the second stands two metres beside the first."""
    estimator = staged_people.StagedEstimator
    alone = estimator.finish

    def both(self):
        one = alone(self)
        t, j = self._frames, len(BODY23)
        far = self._camera.project(staged_people.person(t) + [0.8, 1.0, 0.0])[:, None]
        score = np.full((t, 1, j), 0.9)
        body = LandmarkArrays(BODY23, far, np.full((t, 1, j), 0.25), score, score)
        two = CameraTracks(by_name([body]), one.boxes_px, np.ones((t, 1), np.int64)).arrays()
        return tracks_from({k: np.concatenate([a, two[k]], 1) for k, a in one.arrays().items()}, [BODY23])

    monkeypatch.setattr(estimator, "finish", both)
    assert staged("run", take, "--quiet", "--everyone").returncode == 0
    out = take / "muybridge"
    found = [read_trc(out / name).points_world for name in ("points.trc", "points_2.trc")]
    truth = [staged_people.person(30), staged_people.person(30) + [0.8, 1.0, 0.0]]
    for points in found:
        assert min(np.nanmean(np.linalg.norm(points - t, axis=-1)) for t in truth) < 0.02
    assert np.linalg.norm(found[0] - found[1], axis=-1).min() > 0.5
    assert (out / "motion_2.bvh").exists() and not (out / "points_3.trc").exists()
    # Everybody has a report, whose 3D view has the others too; without --everyone they go.
    pages = [(out / name).read_text() for name in ("report.html", "report_2.html")]
    assert all(page.count('"others":[{"offset"') == 1 for page in pages)
    assert '<a href="report_2.html">' in pages[0] and '<a href="report.html">' in pages[1]
    assert json.loads((out / "run.json").read_text())["others"][0]["quality"]["coverage"] > 0.9
    assert staged("run", take, "--quiet").returncode == 0
    assert not (out / "report_2.html").exists() and "report_2" not in (out / "report.html").read_text()


def test_a_second_run_resumes_everything_and_reports_it(take, staged):
    assert staged("run", take).returncode == 0
    out = take / "muybridge"
    facts = json.loads((out / "run.json").read_text())
    before = {n: d for n, d in snapshot(out).items() if Path(n).name not in ("run.json", "manifest.json")}
    done = staged("run", take)
    assert done.returncode == 0
    assert "cam1: 2D landmarks resumed from" in done.stderr and "motion: resumed" in done.stderr
    again = json.loads((out / "run.json").read_text())
    assert all(stage["resumed"] for stage in again["stages"].values())
    assert again["quality"] == facts["quality"]
    after = {n: d for n, d in snapshot(out).items() if Path(n).name not in ("run.json", "manifest.json")}
    del before["report.html"], after["report.html"]  # it shows timings
    assert after == before


def test_only_what_changed_is_computed_again(take, staged, make_video):
    assert staged("run", take).returncode == 0
    out = take / "muybridge"
    done = staged("run", take, "--smooth.acceleration", "5")
    stages = json.loads((out / "run.json").read_text())["stages"]
    assert done.returncode == 0
    assert stages["2D cam1"]["resumed"] and stages["points"]["resumed"] and not stages["smooth"]["resumed"]

    make_video(take / "videos" / "cam2.mp4", frames=30, width=160, height=120, options={"crf": "30"})
    assert staged("run", take, "--smooth.acceleration", "5").returncode == 0
    stages = json.loads((out / "run.json").read_text())["stages"]
    assert stages["2D cam1"]["resumed"] and not stages["2D cam2"]["resumed"]
    assert not stages["points"]["resumed"]


def test_a_result_that_was_deleted_comes_back(take, staged):
    assert staged("run", take).returncode == 0
    out = take / "muybridge"
    for name in ("overlay_cam2.mp4", "points.trc"):
        (out / name).unlink()
    assert staged("run", take).returncode == 0
    assert {p.name for p in out.iterdir()} == FILES


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_run_that_was_killed_resumes_from_its_last_finished_stage(take, staged, repository):
    script = repository / "tests" / "staged_people.py"
    process = subprocess.Popen(
        [sys.executable, str(script), "run", str(take), "--workers", "1"],
        env={**os.environ, "STAGED_SECONDS_PER_FRAME": "0.05"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    out = take / "muybridge"
    finished = out / "work" / "landmarks-cam1.npz"
    for _ in range(1200):
        if finished.exists():
            break
        time.sleep(0.05)
    time.sleep(0.3)
    assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "points.trc").exists()
    assert not (out / "work" / "landmarks-cam3.npz").exists()
    stamp = finished.stat().st_mtime_ns

    done = staged("run", take)
    assert done.returncode == 0
    assert "cam1: 2D landmarks resumed" in done.stderr and "cam3: 2D landmarks resumed" not in done.stderr
    assert finished.stat().st_mtime_ns == stamp
    assert {p.name for p in out.iterdir()} == FILES
    assert not [p for p in out.rglob("*") if ".tmp" in p.name]


def test_a_stage_that_was_damaged_is_computed_again(take, staged):
    assert staged("run", take).returncode == 0
    path = take / "muybridge" / "work" / "landmarks-cam1.npz"
    path.write_bytes(path.read_bytes()[:500])
    assert staged("run", take).returncode == 0
    stages = json.loads((take / "muybridge" / "run.json").read_text())["stages"]
    assert not stages["2D cam1"]["resumed"] and stages["2D cam2"]["resumed"]


def test_videos_of_different_lengths_give_the_common_part(take, staged, make_video):
    make_video(take / "videos" / "cam3.mp4", frames=21, width=160, height=120)
    done = staged("run", take)
    assert done.returncode == 0
    assert "note: the videos differ in length" in done.stderr and "first 21 frames" in done.stderr
    assert len(read_trc(take / "muybridge" / "points.trc").points_world) == 21
    assert any("length" in n for n in json.loads((take / "muybridge" / "run.json").read_text())["notices"])


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f, _: [v.unlink() for v in (f / "videos").iterdir()], ["videos", "put one video per camera"]),
        (lambda f, _: _cut(f / "videos/cam2.mp4"), ["cam2.mp4", "copy or export it again"]),
        (
            lambda f, video: (
                video(f / "videos/cam2.mp4", frames=30, muxer={"movflags": "+faststart"}),
                _cut(f / "videos/cam2.mp4"),
            ),
            ["cam2.mp4 is truncated", "30", "re-encode"],
        ),
        (lambda f, _: (f / "videos/cam2.mp4").unlink(), ["no video for camera cam2", "--cameras cam1 cam3"]),
        (lambda f, video: video(f / "videos/extra.mp4"), ["no camera for video extra", "name each video"]),
        (lambda f, _: (f / "calibration.toml").write_text("width = [1,"), ["calibration.toml"]),
        (
            lambda f, _: (f / "calibration.toml").unlink(),
            ["no calibration", "--calibration", "calibrate board RECORDINGS"],
        ),
        (
            lambda f, _: [(f / "videos" / n).unlink() for n in ("cam1.mp4", "cam2.mp4")],
            ["one video (cam3.mp4)", "two cameras"],
        ),
        (lambda f, _: shutil.rmtree(f), ["does not exist", "a session is a folder"]),
    ],
)
def test_bad_input_is_one_line_and_changes_nothing(take, staged, make_video, spoil, said, tmp_path):
    spoil(take, make_video)
    before = snapshot(tmp_path)
    refused(staged("run", take), *said)
    refused(staged("run", take, "--out", tmp_path / "results"), *said)
    assert snapshot(tmp_path) == before


def test_an_unknown_model_is_refused(take, tmp_path, capfd):
    (tmp_path / "model.onnx").write_bytes(b"no network at all")
    before = snapshot(tmp_path)
    for flag in ("--keypoint-model",):
        assert run_command(["run", str(take), flag, str(tmp_path / "model.onnx")]) == 2
        captured = capfd.readouterr()
        assert captured.err.count("\n") == 1 and "model.onnx" in captured.err
    assert snapshot(tmp_path) == before


def test_a_results_folder_that_cannot_be_written_is_refused(take, staged, tmp_path):
    (tmp_path / "file").write_text("mine")
    before = snapshot(tmp_path)
    refused(staged("run", take, "--out", tmp_path / "file"), "is a file", "--out")
    refused(staged("run", take, "--out", tmp_path / "file" / "below"), "cannot be written", "--out")
    if Path("/proc").is_dir():
        refused(staged("run", take, "--out", "/proc/muybridge"), "cannot be written", "--out")
    assert snapshot(tmp_path) == before


@pytest.mark.parametrize("place", [".", "videos", "videos/results", "muybridge/.."])
def test_results_never_go_over_the_input(take, staged, place):
    before = snapshot(take)
    refused(staged("run", take, "--out", take / place), "takes no results", "--out")
    assert [n for n in snapshot(take) if n not in before] == []


def test_files_of_others_are_left_alone(take, staged, tmp_path):
    out = tmp_path / "results"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    (out / "motion.bvh").write_text("mine")
    before = snapshot(tmp_path)
    refused(staged("run", take, "--out", out), "motion.bvh", "--overwrite")
    after = {n: d for n, d in snapshot(tmp_path).items() if not n.startswith("results/work")}
    assert after == before
    assert staged("run", take, "--out", out, "--overwrite").returncode == 0
    assert (out / "notes.txt").read_text() == "mine"
    assert (out / "motion.bvh").read_text() != "mine"
    # From now on it is ours, until someone edits it.
    assert staged("run", take, "--out", out).returncode == 0
    (out / "motion.bvh").write_text("edited")
    refused(staged("run", take, "--out", out), "motion.bvh", "changed", "--overwrite")
    assert (out / "motion.bvh").read_text() == "edited"


def test_one_bad_session_does_not_stop_the_others(make_session, staged, tmp_path):
    good = make_session(name="good", frames=12, width=160, height=120)
    bad = make_session(name="bad", frames=12)
    also = make_session(name="also", frames=12, width=160, height=120)
    _cut(bad / "videos" / "cam1.mp4")
    out = tmp_path / "all"
    done = staged("run", good, bad, also, "--out", out)
    assert done.returncode == 2
    assert {p.name for p in out.iterdir()} == {"good", "also"}
    assert (out / "also" / "motion.bvh").is_file()
    assert "2 of 3 sessions done" in done.stdout
    assert "cam1.mp4" in done.stderr and "Traceback" not in done.stderr


def test_a_take_without_people_is_reported(take, staged):
    done = staged("run", take, STAGED_NOBODY="1")
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith("error: ")


def test_the_motion_stands_upright_with_left_on_the_left(take, staged):
    assert staged("run", take).returncode == 0
    motion = read_bvh(take / "muybridge" / "motion.bvh")
    places = motion.joint_positions_world()
    names = motion.skeleton.names
    lengths = np.linalg.norm(places[:, 1:] - places[:, list(motion.skeleton.parents[1:])], axis=-1)
    assert np.ptp(lengths, axis=0).max() < 1e-4
    assert len(places) == 30
    head, foot = (next(k for k, n in enumerate(names) if part in n) for part in ("head", "foot"))
    assert (places[:, head, 2] - places[:, foot, 2]).min() > 1.0
    hips = [next(k for k, n in enumerate(names) if side in n and "thigh" in n) for side in ("left", "right")]
    assert (places[:, hips[0], 0] > places[:, hips[1], 0]).all()
