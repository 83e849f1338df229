"""Results folders: whose results they have, and what is left half-written in them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from muybridge.errors import OutputError
from muybridge.files import temporary_path
from muybridge.infer.detection.detect import file_names
from muybridge.infer.pipelines.videos import result_names
from muybridge.infer.results.folder import open_output
from muybridge.infer.results.overlay_stage import is_overlay, overlay_name


def test_results_of_another_session_are_not_replaced(tmp_path: Path) -> None:
    out, first, second = tmp_path / "out", tmp_path / "first", tmp_path / "second"
    open_output(out, ("points.trc",), [], session=first).write_text("points.trc", "first's")
    assert open_output(out, ("points.trc",), [], session=first).of == str(first)
    with pytest.raises(
        OutputError, match=r"out has the results of .*first; choose another folder, or pass overwrite=True"
    ):
        open_output(out, ("points.trc",), [], session=second)
    # Nor is what no session was named for, as a calibration's check.
    assert open_output(out, (), []).of == str(first)
    open_output(out, ("points.trc",), [], True, second).write_text("points.trc", "second's")
    assert open_output(out, ("points.trc",), [], session=second).names == ("points.trc",)


def test_a_session_may_be_moved_with_its_results(tmp_path: Path) -> None:
    open_output(tmp_path / "a" / "muybridge", (), [], session=tmp_path / "a").write_text("points.trc", "a's")
    (tmp_path / "a").rename(tmp_path / "b")
    assert open_output(tmp_path / "b" / "muybridge", ("points.trc",), [], session=tmp_path / "b").owns("points.trc")


def test_opening_a_folder_removes_only_abandoned_temporary_files(tmp_path: Path) -> None:
    work = open_output(tmp_path, (), []).work
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    own = f"-{os.getpid()}-"
    video = temporary_path(work / "video-cam1.mp4").name
    for pid in (ended.pid, os.getppid(), os.getpid()):
        (work / video.replace(own, f"-{pid}-")).write_text("half")
    (work / temporary_path(work / "overlay_cam1.mp4").name.replace(own, f"-{ended.pid}-")).mkdir()
    open_output(tmp_path, (), [])
    assert [path.name for path in work.glob(".*")] == [video.replace(own, f"-{os.getppid()}-")]


def test_names_of_files_are_short_enough_and_differ() -> None:
    long = file_names(["a" * 240 + "1", "a" * 240 + "2", "ü" * 200])
    assert len(set(long)) == 3 and all(len(overlay_name(name).encode()) < 200 for name in long)
    assert [name for name in result_names(("cam1",)) if is_overlay(name)] == ["overlay_cam1.mp4"]
