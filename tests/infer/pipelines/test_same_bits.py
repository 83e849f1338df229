"""The same results whatever the number of workers, and nearly the same on another processor."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from muybridge.infer.commands.app import run_command
from scripts.benchmarks.takes.processors import rounding, stages
from tests.conftest import first_frames_of_demo

_FRAMES = 10


def _run(take: Path, out: Path, *options: str) -> Path:
    assert run_command(["run", str(take), "--out", str(out), "--quiet", *options]) == 0
    return out


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return first_frames_of_demo(tmp_path_factory.mktemp("bits") / "take", _FRAMES)


@pytest.fixture(scope="module")
def first(take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(take, tmp_path_factory.mktemp("bits") / "one", "--workers", "1", "--everyone", "--markers", "all")


def _content(path: Path) -> Any:
    """A result without what depends on the clock, the folder and the number of workers."""
    if path.suffix == ".npz":
        with np.load(path) as stored:
            arrays = {name: stored[name] for name in stored.files}
        head = json.loads(str(arrays.pop("stage")))
        head.pop("seconds")
        return head, {name: (a.dtype.str, a.shape, a.tobytes()) for name, a in arrays.items()}
    if path.suffix == ".json":
        return _without_time(json.loads(path.read_text()))
    if path.suffix == ".html":  # times, and the bars of a chart of them
        return re.sub(r">[\d.]+ m?s\b|width:[\d.]+%|workers[^,]*", "", path.read_text())
    return path.read_bytes()


def _without_time(value: Any) -> Any:
    if isinstance(value, dict):
        dropped = {"seconds", "started", "workers", "machine", "command", "modified", "mtime_ns"}
        return {name: _without_time(v) for name, v in value.items() if name not in dropped}
    return [_without_time(v) for v in value] if isinstance(value, list) else value


def test_the_number_of_workers_changes_no_bit(take, first, tmp_path):
    other = _run(take, tmp_path / "three", "--workers", "3", "--everyone", "--markers", "all")
    names = sorted(p.relative_to(first) for p in first.rglob("*") if p.is_file())
    assert names == sorted(p.relative_to(other) for p in other.rglob("*") if p.is_file())
    assert {"points.trc", "motion.bvh", "report.html", "markers.c3d"} <= {str(name) for name in names}
    compared = [name for name in names if name.name != "manifest.json"]  # digests of the others
    assert [str(name) for name in compared if _content(first / name) != _content(other / name)] == []


def test_the_last_places_of_the_networks_outputs_hardly_move_a_point(take, first, tmp_path):
    with rounding(seed=1):
        other = _run(take, tmp_path / "rounded", "--workers", "1", "--everyone", "--markers", "all")
    away = {}
    for one, two in zip(stages(first), stages(other), strict=True):
        assert one.values.shape == two.values.shape and one.name == two.name
        np.testing.assert_array_equal(np.isfinite(one.values), np.isfinite(two.values), err_msg=one.name)
        if one.unit == "mm":
            away[one.name] = float(np.nanmax(np.linalg.norm(one.values - two.values, axis=-1)))
    assert {"points", "points, refined", "smooth", "motion: joints"} <= set(away)
    assert any(away.values())  # there was a difference at all
    assert max(away.values()) < 0.3, away
