"""Digests of files and code: the same for the same content, another for any other."""

import os
from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.runtime.digests import code_digest, digest, file_digest, sampled_digest
from muybridge.infer.runtime.stages import StageStore

LARGE = 20 * 2**20


def test_a_copy_of_another_name_and_time_has_the_same_digest(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).write_bytes(b"frames")
    os.utime(tmp_path / "b.mp4", (0, 0))
    assert sampled_digest(tmp_path / "a.mp4") == sampled_digest(tmp_path / "b.mp4")
    (tmp_path / "b.mp4").write_bytes(b"Frames")
    assert sampled_digest(tmp_path / "a.mp4") != sampled_digest(tmp_path / "b.mp4")


@pytest.mark.parametrize("at", [0, LARGE // 2, LARGE - 1])
def test_large_files_are_sampled_from_the_first_to_the_last_byte(tmp_path: Path, at: int) -> None:
    path = tmp_path / "a.mp4"
    path.write_bytes(bytes(LARGE))
    before = sampled_digest(path)
    with path.open("r+b") as file:
        file.seek(at - at % 2**18 if 0 < at < LARGE - 1 else at)
        # Blocks of 256 KiB lie less than 70 KiB apart here.
        file.write(b"x" * (70 * 2**10 if 0 < at < LARGE - 1 else 1))
    assert sampled_digest(path) != before
    path.write_bytes(bytes(LARGE + 1))
    assert sampled_digest(path) != before


def test_code_is_keyed_by_whole_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "keyed_package"
    (package / "below").mkdir(parents=True)
    for file in ("__init__.py", "below/__init__.py", "below/deep.py", "table.npz", "notes.txt"):
        (package / file).write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))

    def key() -> str:
        code_digest.cache_clear()
        return code_digest("keyed_package")

    first = key()
    (package / "notes.txt").write_text("changed")
    assert key() == first
    for file in ("below/deep.py", "table.npz"):
        (package / file).write_text("changed")
        assert key() != first
        (package / file).write_text("")
    (package / "below/deep.py").rename(package / "below/other.py")
    assert key() != first
    code_digest.cache_clear()
    with pytest.raises(ValueError, match="no package json.decoder"):
        code_digest("json.decoder")


def test_values_of_any_kind_have_digests(tmp_path: Path) -> None:
    array = np.arange(6.0).reshape(2, 3)
    assert digest(array) == digest(array.copy()) != digest(array.reshape(3, 2))
    assert digest({"a": 1, "b": (2,)}) == digest({"b": [2], "a": np.int64(1)}) != digest({"a": 1, "b": [3]})
    (tmp_path / "a").write_text("x")
    assert len(file_digest(tmp_path / "a")) == 64


def test_a_stage_is_stored_for_its_key_alone(tmp_path: Path) -> None:
    store = StageStore(tmp_path)
    store.save("points", "key", {"xyz": np.ones(3)}, {"noise": 1.5}, 2.0)
    loaded = store.load("points", "key")
    assert loaded is not None and loaded.resumed and loaded.facts == {"noise": 1.5} and loaded.seconds == 2.0
    assert np.array_equal(loaded.arrays["xyz"], np.ones(3))
    assert store.holds("points", "key") and not store.holds("points", "other") and store.load("points", "other") is None
    (tmp_path / "points.npz").write_bytes(b"damaged")
    assert store.load("points", "key") is None and os.listdir(tmp_path) == ["points.npz"]
