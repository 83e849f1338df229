"""`capture` on the short demo: against the truth, the command line's files, and its own promises."""

import doctest
import functools
import json
import logging
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import muybridge
from muybridge.infer.commands.app import run_command
from muybridge.infer.demo_take.take import demo_folder, true_points

CALLS: list[tuple[str, int, int, float | None]] = []


@pytest.fixture(scope="module")
def place(short_demo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the short demo as `session`."""
    folder = tmp_path_factory.mktemp("api")
    shutil.copytree(short_demo, folder / "session")
    return folder


@pytest.fixture(scope="module")
def result(place: Path) -> muybridge.Result:
    CALLS.clear()
    return muybridge.capture(place / "session", progress=lambda *call: CALLS.append(call))


def test_it_finds_the_person_where_they_are(result: muybridge.Result) -> None:
    truth, names = true_points(demo_folder())
    points = result.points["body23"]
    columns = [points.landmarks.index(name) for name in names]
    error = np.linalg.norm(points.points_world[:, columns] - truth[: len(points.points_world)], axis=-1)
    assert np.isfinite(error).mean() > 0.99
    assert np.nanmean(error) < 0.018


def test_the_result_holds_everything(result: muybridge.Result, place: Path) -> None:
    assert result.folder == place / "session" / "muybridge" and (result.folder / "report.html").is_file()
    assert len(result.motion) == 48 and result.motion is result.people[0].motion
    assert result.quality.coverage > 0.99 and result.quality.reprojection_px < 3
    assert result.cameras.names == ("cam1", "cam2", "cam3", "cam4")
    assert result.problems == () and len(result.people) == 1


def test_progress_counts_up_and_says_what_is_left(result: muybridge.Result) -> None:
    stages = list(dict.fromkeys(stage for stage, *_ in CALLS))
    assert stages[0] == "2D landmarks" and stages[-1] == "overlays"
    counted = [(done, total, left) for stage, done, total, left in CALLS if stage == "2D landmarks"]
    assert [done for done, _, _ in counted] == sorted(done for done, _, _ in counted)
    assert counted[0] == (0, 192, None) and counted[-1][:2] == (192, 192) and counted[-1][2] == 0
    assert all(left > 0 for done, _, left in counted if 0 < done < 192)


def test_the_command_line_writes_the_same_files(result: muybridge.Result, place: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(result.folder, out)
    names = ["points.trc", "points.c3d", "motion.bvh", "motion.glb", "calibration.toml"]
    for name in names:
        (out / name).unlink()
    assert run_command(["run", str(place / "session"), "--out", str(out), "--quiet"]) == 0
    run = json.loads((out / "run.json").read_text())
    # Had the options, the networks or the code differed, a stage would not have been that of `capture`.
    assert all(stage["resumed"] for stage in run["stages"].values())
    assert run["options"] == json.loads((result.folder / "run.json").read_text())["options"]
    for name in names:
        assert (out / name).read_bytes() == (result.folder / name).read_bytes(), name


@pytest.mark.parametrize("name", ["points.trc", "points.c3d", "motion.bvh", "motion.glb"])
def test_save_writes_what_the_results_folder_has(result: muybridge.Result, tmp_path: Path, name: str) -> None:
    result.save(tmp_path / name)
    assert (tmp_path / name).read_bytes() == (result.folder / name).read_bytes()


@pytest.mark.parametrize("suffix", [".trc", ".c3d", ".csv", ".parquet", ".npz"])
def test_save_points_in_every_format(result: muybridge.Result, tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        pytest.importorskip("pyarrow", reason="pyarrow is in the parquet extra")
    result.save(tmp_path / f"take{suffix}")
    read, points = muybridge.read_points(tmp_path / f"take{suffix}"), result.points["body23"]
    np.testing.assert_allclose(read.points_world, points.points_world, atol=2e-6)
    assert read.landmarks.names == points.landmarks.names and read.fps == pytest.approx(points.fps)


@pytest.mark.parametrize("suffix", [".bvh", ".glb", ".fbx", ".amc"])
def test_save_motion_in_every_format_that_is_read_too(result: muybridge.Result, tmp_path: Path, suffix: str) -> None:
    result.save(tmp_path / f"take{suffix}")
    read = muybridge.read_motion(tmp_path / f"take{suffix}")
    there = [n for n in result.motion.skeleton.names if n in read.skeleton.names]
    assert len(there) > 15

    def places(motion: muybridge.Motion) -> np.ndarray:
        return motion.joint_positions_world()[:, [motion.skeleton.index(n) for n in there]]

    np.testing.assert_allclose(places(read), places(result.motion), atol=1e-3)


@pytest.mark.parametrize("suffix", [".mot", ".usda"])
def test_save_motion_in_formats_that_are_only_written(result: muybridge.Result, tmp_path: Path, suffix: str) -> None:
    result.save(tmp_path / f"take{suffix}")
    assert (tmp_path / f"take{suffix}").stat().st_size > 10_000


def test_save_names_what_can_be_saved(result: muybridge.Result, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="body23"):
        result.save(tmp_path / "take.trc", landmarks="body25")
    with pytest.raises(muybridge.FormatError, match=r"\.xyz.*\.trc"):
        result.save(tmp_path / "take.xyz")


def test_false_from_the_callback_cancels_and_the_next_run_resumes(result: muybridge.Result, place: Path) -> None:
    asked: list[str] = []

    def stop_at_overlays(stage: str, done: int, total: int, seconds_left: float | None) -> bool:
        asked.append(stage)
        return stage != "overlays"

    before = (result.folder / "run.json").read_bytes()
    with pytest.raises(muybridge.CaptureCancelled, match="overlays"):
        muybridge.capture(place / "session", progress=stop_at_overlays)
    assert asked.count("overlays") == 1, "a cancelled run asks nobody again"
    assert (result.folder / "run.json").read_bytes() == before
    assert muybridge.capture(place / "session").quality == result.quality


def test_what_the_callback_raises_comes_out(place: Path) -> None:
    def fail(*_: object) -> None:
        raise muybridge.FormatError("of the caller's own")

    with pytest.raises(muybridge.FormatError, match="of the caller's own"):
        muybridge.capture(place / "session", progress=fail)


def test_messages_go_to_the_log_and_nowhere_else(
    result: muybridge.Result, place: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    with caplog.at_level(logging.INFO, "muybridge"):
        muybridge.capture(place / "session")
    assert any("4 cameras, 48 frames" in record.message for record in caplog.records)
    assert capfd.readouterr() == ("", "")


def test_a_missing_folder_is_an_error_for_callers(tmp_path: Path) -> None:
    with pytest.raises(muybridge.SessionError) as error:
        muybridge.capture(tmp_path / "nothing")
    _for_callers(error.value)


def test_results_over_the_input_are_an_error_for_callers(place: Path) -> None:
    with pytest.raises(muybridge.OutputError) as error:
        muybridge.capture(place / "session", out=place / "session")
    _for_callers(error.value)


def test_someone_elses_files_are_an_error_for_callers(place: Path, tmp_path: Path) -> None:
    (tmp_path / "points.trc").write_text("mine")
    with pytest.raises(muybridge.OutputError, match="points.trc") as error:
        muybridge.capture(place / "session", out=tmp_path)
    _for_callers(error.value)
    assert (tmp_path / "points.trc").read_text() == "mine"


def test_a_missing_network_is_an_error_for_callers(place: Path, tmp_path: Path) -> None:
    options = muybridge.RunOptions(detect=muybridge.DetectOptions(keypoint_model=tmp_path / "no.onnx"))
    with pytest.raises(muybridge.ModelError, match="no.onnx") as error:
        muybridge.capture(place / "session", options=options)
    _for_callers(error.value)


def _for_callers(error: muybridge.MuybridgeError) -> None:
    """The message names no flag and no command."""
    assert "--" not in str(error) and "`muybridge " not in str(error), str(error)


EXAMPLES = [
    "capture", "CapturedPerson", "Result", "load_calibration", "save_calibration", "read_motion", "write_motion",
    "read_points", "write_points", "make_points", "triangulate", "smooth", "fit_body", "solve_ik", "PersonDetector",
    "KeypointNetwork", "LiveCapture",
]  # fmt: skip


def test_every_function_and_class_of_the_interface_has_an_example() -> None:
    finder = doctest.DocTestFinder(exclude_empty=True)
    shown = {name for name in EXAMPLES if any(test.examples for test in finder.find(getattr(muybridge, name), name))}
    assert shown == set(EXAMPLES)
    own = {n for n in muybridge.__all__ if getattr(getattr(muybridge, n), "__module__", "").startswith("muybridge.api")}
    assert {name for name in own if callable(getattr(muybridge, name))} - shown == {
        "CaptureCancelled", "ImageLandmarks", "LivePerson", "PersonBoxes",
    }  # fmt: skip


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(result: muybridge.Result, place: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(place)
    if name != "capture":  # the same result, without reading it from the disk again
        monkeypatch.setattr(muybridge, "capture", functools.partial(lambda folder, known: known, known=result))
    tests = doctest.DocTestFinder(exclude_empty=True).find(getattr(muybridge, name), name)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for test in tests:
        runner.run(test)
    summary = runner.summarize(verbose=False)
    assert summary.attempted > 0 and summary.failed == 0


def test_it_prints_nothing_in_a_process_of_its_own(result: muybridge.Result, place: Path) -> None:
    code = "import muybridge; muybridge.capture('session').save('walk.bvh')"
    done = subprocess.run([sys.executable, "-c", code], cwd=place, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (place / "walk.bvh").read_bytes() == (result.folder / "motion.bvh").read_bytes()
