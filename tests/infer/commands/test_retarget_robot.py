"""`muybridge retarget` onto a robot: files that are written, maps, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.motion.retarget import retarget
from muybridge.motion.formats.skeletal.bvh import write_bvh
from tests.motion.robots.humanoids import write_small, write_tall
from tests.motion.robots.test_robots import walk


@pytest.fixture
def take(tmp_path: Path) -> Path:
    path = tmp_path / "walk.bvh"
    write_bvh(path, walk(40))
    return path


def test_a_take_becomes_a_file_of_each_format(take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                              capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert retarget((take,), to=write_small(tmp_path), fps=30.0) == 0
    arrays = np.load(tmp_path / "small_walk.npz")
    assert arrays["fps"] == 30.0 and len(arrays["joint_names"]) == arrays["joint_pos"].shape[1]
    assert (tmp_path / "small_walk.csv").is_file() and (tmp_path / "small_walk.pkl").is_file()
    told = capsys.readouterr().out
    assert "found by geometry" in told and "small_walk.csv" in told
    with pytest.raises(MuybridgeError, match=r"small_walk\.\w+ is there already"):
        retarget((take,), to=tmp_path / "small.urdf")


def test_a_map_is_suggested_and_used(take: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot, table, out = write_tall(tmp_path), tmp_path / "map.toml", tmp_path / "only.csv"
    assert retarget(to=robot, suggest_map=True, out=table) == 0
    assert 'left_shin = "left_shank"' in table.read_text(encoding="utf-8")
    assert retarget((take,), to=robot, map=table, out=out) == 0
    assert out.is_file() and "found by map" in capsys.readouterr().out
    assert not list(tmp_path.glob("*.npz"))


def test_what_cannot_be_done_is_said_and_writes_nothing(take: Path, tmp_path: Path) -> None:
    robot = write_tall(tmp_path)
    before = sorted(tmp_path.iterdir())
    for takes, options, message in (
        ((take,), {"out": tmp_path / "a.bvh"}, "a robot's motion is written as"),
        ((), {}, "no take is named"),
        ((tmp_path / "none.bvh",), {}, "no such file"),
        ((take,), {"out": robot.with_suffix(".csv"), "to": tmp_path / "none.xml"}, "none.xml"),
    ):
        with pytest.raises(MuybridgeError, match=message):
            retarget(takes, **{"to": robot, **options})  # type: ignore[arg-type]
    assert sorted(tmp_path.iterdir()) == before
