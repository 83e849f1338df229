"""Files that take their place when they are whole."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from muybridge.errors import OutputError
from muybridge.files import replacing, temporary_path


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "points.npz"
    with replacing(path) as temporary:
        temporary.write_text("first")
        assert temporary.suffix == ".npz" and not path.exists()
    with pytest.raises(KeyError), replacing(path) as temporary:
        temporary.write_text("second")
        raise KeyError
    assert path.read_text() == "first" and os.listdir(path.parent) == ["points.npz"]


def test_a_temporary_name_has_the_suffix_in_small_letters(tmp_path: Path) -> None:
    with replacing(tmp_path / "X.C3D") as temporary:
        temporary.write_text("whole")
        assert temporary.suffix == ".c3d"
    assert os.listdir(tmp_path) == ["X.C3D"]


def test_abandoned_temporary_files_are_removed_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "take [1].npz"
    ours = temporary_path(path).name
    host, own = ours.split(".")[-3].split("-")[0], f"-{os.getpid()}-"
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    elsewhere = ours.replace(f".{host}-", ".0123abcd-")
    gone = [ours.replace(own, f"-{ended.pid}-"), elsewhere]
    old = ["take [1].npz.old", gone[0].replace("[1]", "1"), gone[0].replace(".npz", ".npy"), ".take [1].4711.tmp.npz"]
    kept = [*old, elsewhere.replace(own, "-1-"), ours.replace(own, f"-{os.getppid()}-")]
    for name in [*gone, *kept]:
        (tmp_path / name).write_text("half")
    for name in [*gone, *old]:
        os.utime(tmp_path / name, (time.time() - 90000,) * 2)
    with replacing(path) as temporary:
        temporary.write_text("whole")
    assert set(os.listdir(tmp_path)) == {path.name, *kept}


def test_no_two_writers_share_a_temporary_name(tmp_path: Path) -> None:
    with replacing(tmp_path / "a.npz") as first, replacing(tmp_path / "a.npz") as second:
        first.write_text("first")
        second.write_text("second")
        assert first != second
    assert os.listdir(tmp_path) == ["a.npz"] and (tmp_path / "a.npz").read_text() == "first"


def test_a_temporary_file_elsewhere_keeps_its_name(tmp_path: Path) -> None:
    with replacing(tmp_path / "points.trc", tmp_path / "work") as temporary:
        temporary.write_text("whole")
        assert temporary.name == "points.trc" and temporary.parent.parent == tmp_path / "work"
    assert (tmp_path / "points.trc").read_text() == "whole" and not os.listdir(tmp_path / "work")


def test_an_error_names_the_final_path(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="b.trc cannot be written .no space left.*free its disk") as raised:
        with replacing(tmp_path / "b.trc", tmp_path / "work") as outer, replacing(outer):
            raise OSError(28, "No space left on device")
    assert ".tmp" not in str(raised.value) and not list((tmp_path / "work").iterdir())
