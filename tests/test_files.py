"""Files that take their place when they are whole."""

import os
import time
from pathlib import Path

import pytest

from muybridge.files import replacing


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


def test_what_killed_runs_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "take [1].npz"
    old = [f".{path.stem}.4711.tmp.npz", "take [1].npz.old", ".take 1.4711.tmp.npz", f".{path.stem}.4711.tmp.npy"]
    for name in [*old, f".{path.stem}.4712.tmp.npz"]:
        (tmp_path / name).write_text("half")
    for name in old:
        os.utime(tmp_path / name, (time.time() - 90000,) * 2)
    with replacing(path) as temporary:
        temporary.write_text("whole")
    assert set(os.listdir(tmp_path)) == {path.name, *old[1:], f".{path.stem}.4712.tmp.npz"}
