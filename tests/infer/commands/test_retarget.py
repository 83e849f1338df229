"""The command retarget, run for real."""

import json
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.characters.retarget import (
    clip_names,
    find_takes,
    output_paths,
    read_run_target,
    retarget_results,
)
from muybridge.motion.character import read_character
from muybridge.motion.formats.registry import read_file, write_file
from muybridge.motion.take import Take
from tests.geometry.roles.bodies import four_legged, human
from tests.motion.retargeting.test_retarget import directions, moving

QUIET = 0.1


def body_file(path: Path, builder, seed=0, frames=20) -> Path:
    """A file of a body, named as nobody names joints, that hardly moves."""
    skeleton, _ = builder.build(None, 1.0, np.random.default_rng(seed))
    write_file(path, Take(motion=moving(skeleton, seed, frames, size=QUIET)))
    return path


@pytest.fixture
def take(tmp_path):
    return body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))


@pytest.fixture
def hero(tmp_path):
    return body_file(tmp_path / "hero.glb", human(np.random.default_rng(1), spine=4, fingers=5, legs=0.8), 1)


def test_a_take_becomes_one_more_clip_of_the_characters_file(tmp_path, take, hero, capsys):
    out = tmp_path / "out.glb"
    assert run_command(["retarget", str(take), "--to", str(hero), "--out", str(out), "--clip-name", "stroll"]) == 0
    before, after = read_character(hero), read_character(out, "stroll")
    assert after.clips == (*before.clips, "stroll") and len(after.motion) == 20
    assert after.skeleton.names == before.skeleton.names
    printed = capsys.readouterr().out
    assert "stroll: 20 frames at 30 fps" in printed and "by geometry" in printed and str(out) in printed


def test_a_folder_of_takes_becomes_clips_of_their_names(tmp_path, hero):
    folder = tmp_path / "takes"
    folder.mkdir()
    for name in ("run", "walk"):
        body_file(folder / f"{name}.bvh", human(np.random.default_rng(0)), frames=8)
    out = tmp_path / "out.glb"
    assert run_command(["retarget", str(folder), "--to", str(hero), "--out", str(out), "--no-plant"]) == 0
    assert read_character(out).clips[-2:] == ("run", "walk")
    motion, hero = read_file(folder / "walk.bvh").motion, read_character(out, "walk")
    roles = [find_roles(skeleton).roles for skeleton in (motion.skeleton, hero.skeleton)]
    gap = directions(motion, roles[0]) - directions(hero.motion, roles[1])
    assert np.abs(gap).max() < 1e-3, "as single precision in the file has it"


def test_takes_on_a_bvh_are_files_each(tmp_path, take, capsys):
    target = body_file(tmp_path / "stick.bvh", human(np.random.default_rng(2), spine=2), 2)
    other = take.with_name("jump.bvh")
    other.write_bytes(take.read_bytes())
    out = tmp_path / "on_stick.bvh"
    assert run_command(["retarget", str(take), str(other), "--to", str(target), "--out", str(out)]) == 0
    assert (tmp_path / "on_stick_walk.bvh").is_file() and (tmp_path / "on_stick_jump.bvh").is_file()
    assert "no mesh of the feet" in capsys.readouterr().out


def test_frame_rates_that_differ_are_resampled_and_said(tmp_path, take, hero, capsys):
    out = tmp_path / "out.glb"
    assert run_command(["retarget", str(take), "--to", str(hero), "--out", str(out), "--fps", "60"]) == 0
    assert len(read_character(out, "walk").motion) == 39
    assert "resampled from 30 to 60 frames per second, as asked" in capsys.readouterr().err


def test_a_suggested_map_is_written_and_taken(tmp_path, take, hero, capsys):
    path, out = tmp_path / "hero.toml", tmp_path / "out.glb"
    assert run_command(["retarget", "--to", str(hero), "--suggest", "--out", str(path)]) == 0
    assert "by geometry" in capsys.readouterr().out and 'left_thigh = "b' in path.read_text()
    assert run_command(["retarget", str(take), "--to", str(hero), "--map", str(path), "--out", str(out)]) == 0
    assert "by map" in capsys.readouterr().out


def refused(words, capsys):
    """The one line that a refused command prints."""
    assert run_command(["retarget", *map(str, words)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_bad_input_is_one_line_and_nothing_written(tmp_path, take, hero, capsys):
    dog = body_file(tmp_path / "dog.glb", four_legged(np.random.default_rng(0)))
    overlap = tmp_path / "overlap.toml"
    overlap.write_text('hips = "b0"\nleft_thigh = "b0"\n')
    unknown = tmp_path / "unknown.toml"
    unknown.write_text('hips = "pelvis"\n')
    part = tmp_path / "part.toml"
    part.write_text('hips = "b0"\n')
    empty = tmp_path / "empty"
    empty.mkdir()
    out = tmp_path / "out.glb"
    there = set(tmp_path.iterdir())
    on_hero = ["--to", hero, "--out", out]
    assert "four legs" in refused([take, "--to", dog, "--out", out], capsys)
    assert "dog.glb" in refused([dog, *on_hero], capsys)
    assert "both given to the joint 'b0'" in refused([take, *on_hero, "--map", overlap], capsys)
    assert "no such joint" in refused([take, *on_hero, "--map", unknown], capsys)
    assert "no joint was found for left_thigh" in refused([take, *on_hero, "--map", part], capsys)
    assert "is a file to be read" in refused([take, "--to", hero, "--out", hero, "--overwrite"], capsys)
    assert "written as .glb" in refused([take, "--to", hero, "--out", tmp_path / "out.bvh"], capsys)
    assert "no take is named" in refused(on_hero, capsys)
    assert "holds no motion" in refused([empty, *on_hero], capsys)
    assert "no such file" in refused([tmp_path / "lost.bvh", *on_hero], capsys)
    clip = read_character(hero).clips[0]
    assert "already" in refused([take, *on_hero, "--clip-name", clip], capsys)
    assert set(tmp_path.iterdir()) == there


def test_takes_of_a_session_are_those_of_its_results(tmp_path):
    results = tmp_path / "session" / "muybridge"
    (results / "work").mkdir(parents=True)
    (results / "work" / "manifest.json").write_text(json.dumps({"files": {}}))
    for folder in (results / "person_1", results / "person_2"):
        folder.mkdir()
        (folder / "motion.bvh").write_text("")
    found = find_takes([tmp_path / "session"])
    assert found == [results / "person_1" / "motion.bvh", results / "person_2" / "motion.bvh"]
    assert clip_names(found, None, []) == ["person_1_motion", "person_2_motion"]


def test_names_of_clips_and_files():
    takes = [Path("a/walk.bvh"), Path("b/run.bvh")]
    assert clip_names(takes, None, ["walk"]) == ["walk_2", "run"]
    assert clip_names(takes, "go", []) == ["go", "go_2"]
    assert output_paths(None, Path("x/hero.glb"), ["walk"]) == [Path("hero_walk.glb")]
    assert output_paths(None, Path("hero.vrm"), ["walk", "run"]) == [Path("hero_takes.vrm")]
    assert output_paths(None, Path("hero.fbx"), ["walk", "run"]) == [Path("hero_walk.fbx"), Path("hero_run.fbx")]


def test_motion_of_a_results_folder_goes_onto_a_character(tmp_path, take, hero):
    results = tmp_path / "results"
    (results / "work").mkdir(parents=True)
    (results / "work" / "manifest.json").write_text(json.dumps({"files": {}}))
    (results / "motion.bvh").write_bytes(take.read_bytes())
    own = read_character(hero).clips
    for _ in range(2):  # the second run replaces what the first one wrote
        notices = retarget_results(results, read_run_target(hero))
        assert all("no foot stands" in notice for notice in notices)
        clips = read_character(results / "hero.glb").clips
        assert len(clips) == len(own) + 1 and clips[:-1] == own
    with pytest.raises(MuybridgeError, match="save it as .glb"):
        read_run_target(tmp_path / "hero.gltf")


def test_takes_that_can_be_read_are_written_beside_broken_ones(tmp_path, take, hero, capsys):
    broken = tmp_path / "broken.bvh"
    broken.write_bytes(take.read_bytes()[:3000])
    out, stick = tmp_path / "out.glb", body_file(tmp_path / "stick.bvh", human(np.random.default_rng(2)), 2)
    for to, wanted in ((hero, out), (stick, tmp_path / "out.bvh")):
        assert run_command(["retarget", str(broken), str(take), "--to", str(to), "--out", str(wanted)]) == 2
        said = capsys.readouterr()
        assert "walk: 20 frames" in said.out and "broken" not in said.out
        assert said.err.count("error:") == 2 and "1 of 2 takes failed" in said.err and str(broken) in said.err
    assert read_character(out).clips[-1] == "walk"
    assert (tmp_path / "out_walk.bvh").is_file() and not (tmp_path / "out_broken.bvh").exists()


def test_options_without_a_meaning_are_refused(tmp_path, take, hero, capsys):
    there = set(tmp_path.iterdir())
    on_hero = [take, "--to", hero, "--out", tmp_path / "new" / "out.glb"]
    for fps in ("0", "-5", "nan"):
        assert "must be above zero" in refused([*on_hero, "--fps", fps], capsys)
    assert "leave out --take-clip" in refused([*on_hero, "--take-clip", "3"], capsys)
    assert "--clip-name is empty" in refused([*on_hero, "--clip-name", " "], capsys)
    assert set(tmp_path.iterdir()) == there, "nor is a folder left"


def test_options_may_stand_between_takes(tmp_path, take, hero):
    other, out = take.with_name("jump.bvh"), tmp_path / "out.glb"
    other.write_bytes(take.read_bytes())
    assert run_command(["retarget", str(take), "--to", str(hero), str(other), f"--out={out}", "--no-plant"]) == 0
    assert read_character(out).clips[-2:] == ("walk", "jump")
