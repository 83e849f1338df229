"""The commands `graph build`, `graph walk` and `graph show`, from files of motion to files of motion."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.infer.commands.motion.graph import build, show, walk
from muybridge.infer.commands.remedies import error_line
from muybridge.motion.blending import place_at
from muybridge.motion.editing.resampling import resample
from muybridge.motion.formats.registry import read_file, write_file
from muybridge.motion.take import Take
from tests.motion.editing.clips import walk as walking


def take(path, motion):
    write_file(path, Take(motion=motion))
    return path


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    folder, whole = tmp_path_factory.mktemp("takes"), walking(520)
    other = place_at(whole.select(slice(200, 520)), 2.0, np.array([3.0, -1.0]))
    return (
        take(folder / "walk_1.bvh", whole.select(slice(0, 300))),
        take(folder / "stroll.bvh", resample(other, 30.0)),
    )


@pytest.fixture(scope="module")
def graph(tmp_path_factory, takes):
    path = tmp_path_factory.mktemp("graph") / "walks.graph"
    assert build(takes, out=path) == 0
    return path


def refused(function, *args, **options):
    with pytest.raises(MuybridgeError) as raised:
        function(*args, **options)
    line = error_line(raised.value)
    assert "\n" not in line
    return line


def test_a_walk_along_a_path_stays_near_it(tmp_path, graph, capsys):
    path, out, picture = tmp_path / "path.csv", tmp_path / "out.bvh", tmp_path / "walk.html"
    path.write_text("x,y\n1,2\n1,-4\n")
    assert walk((graph, out), path=path, picture=picture) == 0
    motion = read_file(out).motion
    trail = motion.joint_positions_world()[:, 0, :2]
    assert np.abs(trail[:, 0] - 1).max() < 0.5 and abs(trail[0, 1] - 2) < 0.3 and abs(trail[-1, 1] + 4) < 0.5
    assert "from the path of 6.0 m" in capsys.readouterr().out
    assert "<img" in picture.read_text()


def test_a_walk_lasts_as_long_as_asked_and_other_frame_rates_are_said(tmp_path, takes, capsys):
    path, out = tmp_path / "again.graph", tmp_path / "out.bvh"
    assert build(takes, out=path, labels=("walk", "stroll")) == 0
    assert "stroll.bvh is resampled from 30 to 60 frames/s" in capsys.readouterr().err
    assert walk((path, out), seconds=25.0, actions=("stroll", "walk"), plant=True) == 0
    assert len(read_file(out).motion) / 60 == pytest.approx(25.0, abs=2.0)
    assert "feet planted" in capsys.readouterr().out


def test_a_graph_is_drawn(tmp_path, graph, capsys):
    assert show(graph, out=tmp_path / "a.png") == 0
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert "walk_1" in capsys.readouterr().out


def test_bad_input_is_refused_in_one_line(tmp_path, takes, graph):
    out, single = tmp_path / "a.graph", tmp_path / "single.bvh"
    take(single, walking(1))
    assert "single" in refused(build, (single,), out=out)
    assert ".graph" in refused(build, takes, out=tmp_path / "a.npz")
    assert "1 label for 2 takes" in refused(build, takes, out=out, labels=("walk",))
    whole = walking(300)
    renamed = replace(whole, skeleton=replace(whole.skeleton, names=tuple(f"j{k}" for k in range(len(whole.skeleton)))))
    alone = take(tmp_path / "crate.bvh", renamed.select(slice(0, 200)))
    broken = replace(whole.skeleton, parents=tuple(max(k - 1, -1) for k in range(len(whole.skeleton))))
    odd = take(tmp_path / "odd.bvh", replace(whole, skeleton=broken))
    assert "another skeleton" in refused(build, (takes[0], odd), out=out)
    assert build((takes[0], alone), out=out, overwrite=True) == 0, "a body with other names is put onto the first one's"
    assert "jump" in refused(walk, (graph, tmp_path / "a.bvh"), actions=("jump",))
    assert "--path or --seconds" in refused(walk, (graph, tmp_path / "a.bvh"), path=tmp_path / "p.csv", seconds=3.0)
    (tmp_path / "p.csv").write_text("x,y\n0,0\n")
    assert "p.csv" in refused(walk, (graph, tmp_path / "a.bvh"), path=tmp_path / "p.csv")
    (tmp_path / "no.graph").write_bytes(b"PK not a graph")
    assert "no.graph" in refused(walk, (tmp_path / "no.graph", tmp_path / "a.bvh"), seconds=3.0)
    assert not (tmp_path / "a.bvh").exists()
