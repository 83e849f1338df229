"""The command retarget, run for real."""

import json
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.characters.retarget import (
    PLACE_UNITS,
    READ_UNITS,
    output_paths,
    place,
    read_run_target,
    retarget_results,
    write_placed,
)
from muybridge.infer.pipelines.characters.takes import clip_names, find_takes
from muybridge.infer.results.names import MOTION_BVH, of_person
from muybridge.motion.character import read_character
from muybridge.motion.editing import scale as scale_motion
from muybridge.motion.formats.registry import motion_formats, read_file, write_file
from muybridge.motion.retargeting.solver import RetargetOptions
from muybridge.motion.take import Take
from tests.geometry.roles.bodies import four_legged, human
from tests.motion.formats.test_fbx_text import text_file
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


def test_progress_of_a_take_is_told_as_it_is_made(tmp_path, take, hero, capsys):
    done, target = [], read_run_target(hero)
    placed = [place(take, target, name, RetargetOptions(), advance=done.append) for name in ("a", "b")]
    assert done == [READ_UNITS, PLACE_UNITS] * 2
    write_placed(placed, target, [tmp_path / "out.glb"], done.append)
    assert done[4:] == [1, 1]
    assert run_command(["retarget", str(take), "--to", str(hero), "--out", str(tmp_path / "b.glb")]) == 0
    told = capsys.readouterr().err
    assert "walk.bvh on hero.glb: " in told and "writing: " in told


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


def test_an_fbx_keeps_its_meshes_and_gets_a_clip_for_every_take(tmp_path, take):
    target = body_file(tmp_path / "hero.fbx", human(np.random.default_rng(1), spine=4, legs=0.8), 1)
    other, out = take.with_name("jump.bvh"), tmp_path / "out.fbx"
    other.write_bytes(take.read_bytes())
    assert run_command(["retarget", str(take), str(other), "--to", str(target), "--out", str(out)]) == 0
    before, after = read_character(target), read_character(out, "jump")
    assert after.clips == (*before.clips, "walk", "jump") and len(after.motion) == 20
    assert len(before.meshes) == len(after.meshes) == 1
    np.testing.assert_array_equal(before.meshes[0].positions, after.meshes[0].positions)
    roles = [find_roles(skeleton).roles for skeleton in (read_file(take).motion.skeleton, after.skeleton)]
    gap = directions(read_file(take).motion, roles[0]) - directions(after.motion, roles[1])
    arms = gap.reshape(len(gap), 2, 4, 3)[:, :, :2]
    assert np.abs(arms).max() < 1e-3, "legs are planted"


def test_a_text_fbx_is_refused_before_anything_is_done(tmp_path, take, capsys):
    target = text_file(body_file(tmp_path / "b.fbx", human(np.random.default_rng(1)), 1), tmp_path / "hero.fbx")
    assert "FBX as text" in refused([take, "--to", target, "--out", tmp_path / "out.fbx"], capsys)
    assert not (tmp_path / "out.fbx").exists()


def test_the_motion_of_a_vrm_animation_is_replaced(tmp_path, take, hero):
    target, out = tmp_path / "idle.vrma", tmp_path / "out.vrma"
    target.write_bytes(hero.read_bytes())
    assert run_command(["retarget", str(take), "--to", str(target), "--out", str(out)]) == 0
    again = read_character(out)
    assert again.clips == ("walk",) and len(again.motion) == 20
    assert len(again.meshes) == len(read_character(target).meshes)


def test_the_motion_of_a_bvh_is_replaced_and_its_hierarchy_kept(tmp_path, take):
    target = body_file(tmp_path / "stick.bvh", human(np.random.default_rng(2), spine=2), 2)
    out = tmp_path / "out.bvh"
    assert run_command(["retarget", str(take), "--to", str(target), "--out", str(out)]) == 0
    heads = [path.read_text().split("MOTION")[0] for path in (target, out)]
    assert heads[0] == heads[1]


def test_a_bvh_whose_hips_cannot_move_is_written_anew(tmp_path, take, capsys):
    target, out = tmp_path / "stick.bvh", tmp_path / "out.bvh"
    body_file(target, human(np.random.default_rng(2), root=True), 2)
    assert run_command(["retarget", str(take), "--to", str(target), "--out", str(out)]) == 0
    assert "position channels" in capsys.readouterr().err and len(read_file(out).motion) == 20


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
    assert "by the map" in capsys.readouterr().out


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
    message = refused([take, "--to", dog, "--out", out], capsys)
    assert "four legs" in message and "steps but `plant` and `rename`" in message and "--map" not in message
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


def results_folder(folder: Path, people: int) -> Path:
    """A results folder with as many motions as `muybridge run --everyone` writes; they are empty."""
    (folder / "work").mkdir(parents=True)
    (folder / "work" / "manifest.json").write_text(json.dumps({"files": {}}))
    for number in range(1, people + 1):
        (folder / of_person(MOTION_BVH, number)).write_text("")
    return folder


def test_takes_of_a_session_are_those_of_its_results(tmp_path):
    results = results_folder(tmp_path / "dance" / "muybridge", 11)
    (results / "hero_person_1.bvh").write_text("")
    found = find_takes([tmp_path / "dance"]).files
    assert found == (results / "motion.bvh", *(results / f"motion_{n}.bvh" for n in range(2, 12)))
    assert clip_names(found, None, []) == [f"dance_person_{n}" for n in range(1, 12)]
    elsewhere = results_folder(tmp_path / "solo", 1)
    found = find_takes([elsewhere, tmp_path / "dance", elsewhere]).files
    assert clip_names(found, None, ["solo"])[:2] == ["solo_2", "dance_person_1"] and len(found) == 12
    assert clip_names([elsewhere / "motion.bvh"], None, []) == ["solo"]
    assert clip_names([results / "motion_2.bvh"], None, []) == ["dance_person_2"]


def test_every_persons_motion_is_put_onto_a_character(tmp_path, take, hero, capsys):
    results = results_folder(tmp_path / "dance" / "muybridge", 2)
    for number in (1, 2):
        (results / of_person(MOTION_BVH, number)).write_bytes(take.read_bytes())
    out = tmp_path / "out.glb"
    assert run_command(["retarget", str(tmp_path / "dance"), "--to", str(hero), "--out", str(out)]) == 0
    assert read_character(out).clips[-2:] == ("dance_person_1", "dance_person_2")


def test_a_folder_gives_every_format_of_motion_and_each_take_once(tmp_path, hero, capsys):
    for name in ("a.bvh", "b.gltf", "c.VRM", "d.vrma", "e.fbx", "f.amc", "g.mot", "h.sto", "a.glb", "a.fbx", "p.trc",
                 "f.asf", "x.png", "hero.glb"):  # fmt: skip
        (tmp_path / name).touch()
    takes = find_takes([tmp_path], but=tmp_path / "hero.glb")
    assert [f.name for f in takes.files] == ["a.bvh", "b.gltf", "c.VRM", "d.vrma", "e.fbx", "f.amc", "g.mot", "h.sto"]
    assert len(takes.notices) == 1 and "a.glb, a.fbx passed over, since a.bvh has the same name" in takes.notices[0]
    assert set(motion_formats()) == {".bvh", ".amc", ".glb", ".gltf", ".vrm", ".vrma", ".fbx", ".mot", ".sto"}
    with pytest.raises(MuybridgeError, match="holds no motion"):
        find_takes([results_folder(tmp_path / "empty", 0)])


@pytest.mark.parametrize(
    ("factor", "scale"), [(98.0, "0.01"), (0.0105, "100"), (17.5, "0.05644"), (1.8, ""), (0.3, "")]
)
def test_a_size_of_nobody_is_noticed_by_every_command_that_reads(tmp_path, hero, capsys, factor, scale):
    motion = read_file(body_file(tmp_path / "walk.glb", human(np.random.default_rng(0)), frames=3)).motion
    big = tmp_path / "big man.glb"
    write_file(big, Take(motion=scale_motion(motion, factor)))
    capsys.readouterr()
    commands = {
        "convert": [big, tmp_path / "out.npz"], "edit": [big, "turn", "90", tmp_path / "out.glb"],
        "view": [big, "--no-open"], "compare": [big, big],
        "retarget": [big, "--to", hero, "--out", tmp_path / "new.glb"],
    }  # fmt: skip
    remedy = f"muybridge edit '{big}' scale {scale} 'big man_scaled.glb'"
    for name, words in commands.items():
        assert run_command([name, *map(str, words)]) == 0
        wanted = 0 if not scale else 2 if name == "compare" else 1
        assert capsys.readouterr().err.count(remedy) == wanted, name
    words = [tmp_path / "walk.glb", "--to", big, "--out", tmp_path / "b.glb"]
    assert run_command(["retarget", *map(str, words)]) == 0
    assert (remedy in capsys.readouterr().err) == bool(scale)


def test_names_of_clips_and_files():
    takes = [Path("a/walk.bvh"), Path("b/run.bvh")]
    assert clip_names(takes, None, ["walk"]) == ["walk_2", "run"]
    assert clip_names(takes, "go", []) == ["go", "go_2"]
    assert output_paths(None, Path("x/hero.glb"), ["walk"]) == [Path("hero_walk.glb")]
    assert output_paths(None, Path("hero.vrm"), ["walk", "run"]) == [Path("hero_takes.vrm")]
    assert output_paths(None, Path("hero.fbx"), ["walk", "run"]) == [Path("hero_takes.fbx")]
    assert output_paths(None, Path("hero.bvh"), ["walk", "run"]) == [Path("hero_walk.bvh"), Path("hero_run.bvh")]


def test_motion_of_a_results_folder_goes_onto_a_character(tmp_path, take, hero):
    results = results_folder(tmp_path / "results", 1)
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
