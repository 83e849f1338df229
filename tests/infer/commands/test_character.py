"""The command character, run for real on a figure of capsules."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles, suggest_role_map
from muybridge.infer.commands.motion.character import character
from muybridge.infer.commands.remedies import error_line
from muybridge.motion.character import pose_meshes, read_character
from muybridge.motion.character.rigging import rig_mesh
from muybridge.motion.character.rigging.joints_file import read_joints, write_joints
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.registry import read_file
from tests.geometry.roles.bodies import human
from tests.infer.commands.test_retarget import body_file
from tests.motion.character.meshes.bound_figures import apart
from tests.motion.character.rigging.figures import HEIGHT, animal, capsule, person, together


def obj(path, vertices, triangles, scale=1.0):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices * scale] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    path.write_text("\n".join(lines))
    return path


@pytest.fixture(scope="module")
def hero(tmp_path_factory):
    return obj(tmp_path_factory.mktemp("mesh") / "hero.obj", *person(40.0)[:2])


def test_a_mesh_is_rigged_and_moved(tmp_path, hero, capsys):
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "moved.glb"
    assert character(hero, motion=(take,), out=out, rig="mixamo") == 0
    back = read_character(out)
    assert back.clips == ("walk",) and len(back.motion) == 20
    assert "mixamorig:LeftUpLeg" in back.skeleton.names
    assert "walk: 20 frames" in capsys.readouterr().out
    rest, moved = pose_meshes(back, back.rest_motion())[0][0], pose_meshes(back, back.motion)[0]
    assert np.allclose(np.ptp(rest, axis=0), np.ptp(person(40.0)[0], axis=0), atol=1e-4)
    assert 0.05 < np.linalg.norm(moved - rest, axis=2).max() < 2.0


def test_takes_that_cannot_be_read_are_named_and_the_others_written(tmp_path, hero, capsys, monkeypatch):
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "moved.glb"
    broken = tmp_path / "broken.bvh"
    broken.write_text("HIERARCHY\nROOT")
    assert character(hero, motion=(broken, take), out=out) == 2
    said = capsys.readouterr().err
    assert f"{broken}:" in said and "1 of 2 takes failed" in said
    assert read_character(out).clips == ("walk",)

    def late(*_, **__):
        raise AssertionError("the joints were looked for before the take was read")

    monkeypatch.setattr("muybridge.infer.commands.motion.character.rig_static", late)
    assert str(broken) in refused(capsys, hero, motion=(broken,), out=tmp_path / "other.glb")
    assert not (tmp_path / "other.glb").exists()


def test_a_skinning_method_is_baked_into_morph_targets(tmp_path, hero, capsys):
    """What a viewer does, linear blending of the mesh with its morph targets, is what the method does."""
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "moved.glb"
    assert character(hero, motion=(take,), out=out, skinning="dual-quaternion") == 0
    assert "within" in capsys.readouterr().err
    document = Document(out)
    clip = document.json["animations"][0]
    channel = next(c for c in clip["channels"] if c["target"]["path"] == "weights")
    assert "mesh" in document.json["nodes"][channel["target"]["node"]]
    sampler = clip["samplers"][channel["sampler"]]
    hero_read = read_character(out)
    names = document.json["meshes"][0]["extras"]["targetNames"]
    weights = document.accessor(sampler["output"]).reshape(-1, len(names))
    motion = hero_read.motion
    assert len(weights) == len(motion) == len(document.accessor(sampler["input"]))
    plain = 0.0
    for t in range(0, len(motion), 6):
        frame = motion.select([t])
        exact = hero_read.pose(frame, "dual-quaternion")[0]
        shown = hero_read.pose(frame, morph_weights=dict(zip(names, weights[t], strict=True)))[0]
        assert apart(shown, exact) < 1.1e-3
        plain = max(plain, apart(hero_read.pose(frame)[0], exact))
    assert plain > 2e-3  # without the targets it is not
    assert ".glb and .vrm" in refused(capsys, hero, motion=(take,), out=tmp_path / "a.fbx", skinning="delta-mush")
    assert "no take" in refused(capsys, hero, rig_only=True, out=tmp_path / "a.glb", skinning="delta-mush")


def test_an_fbx_moves_as_the_glb_does(tmp_path, hero):
    take, outs = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), []
    for name in ("a.glb", "b.fbx"):
        assert character(hero, motion=(take,), out=tmp_path / name) == 0
        outs.append(read_character(tmp_path / name, "walk"))
    one, two = (np.concatenate(back.pose(back.motion), axis=1) for back in outs)
    assert apart(one, two) < 1e-4
    assert outs[1].clips == ("walk",) and outs[1].motion.fps == pytest.approx(outs[0].motion.fps)


def test_joints_are_written_corrected_and_applied(tmp_path, hero):
    toml, out = tmp_path / "joints.toml", tmp_path / "rest.glb"
    assert character(hero, write_joints=toml) == 0
    lines = toml.read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("left_shin", "right_shin"))]
    toml.write_text("\n".join([*kept, "left_shin = [0.2, -0.05, 0.6]"]))
    assert character(hero, joints=toml, rig_only=True, out=out) == 0
    back = read_character(out)
    at = dict(zip(back.skeleton.names, back.skeleton.rest_positions + back.root_at_rest, strict=True))
    assert np.allclose(at["left_shin"], [0.2, -0.05, 0.6], atol=1e-6)
    assert np.linalg.norm(at["right_shin"] - person(40.0)[2]["right_shin"]) < 0.04 * HEIGHT
    assert not back.clips


def test_a_whole_file_of_joints_is_taken_as_it_is_of_a_body_that_was_turned(tmp_path):
    vertices, triangles, _ = person(40.0)
    path, toml = obj(tmp_path / "back.obj", vertices * [-1, -1, 1], triangles), tmp_path / "joints.toml"
    outs = [tmp_path / "a.glb", tmp_path / "b.glb"]
    assert character(path, write_joints=toml, rig_only=True, out=outs[0]) == 0
    assert character(path, joints=toml, rig_only=True, out=outs[1]) == 0
    one, two = (read_character(out) for out in outs)
    assert np.allclose(one.meshes[0].positions, two.meshes[0].positions, atol=1e-6)
    assert np.allclose(one.skeleton.rest_positions, two.skeleton.rest_positions, atol=2e-4)
    assert one.skeleton.rest_positions[one.skeleton.index("left_foot"), 0] > 0


def test_units_are_guessed_and_heights_set(tmp_path, capsys):
    vertices, triangles, _ = person(40.0)
    large = obj(tmp_path / "large.obj", vertices, triangles, 100.0)
    assert character(large, rig_only=True, out=tmp_path / "a.glb") == 0
    assert "read as centimetres" in capsys.readouterr().err
    assert character(large, rig_only=True, out=tmp_path / "b.glb", height=2.0) == 0
    for name, tall in (("a", float(np.ptp(vertices[:, 2]))), ("b", 2.0)):
        back = read_character(tmp_path / f"{name}.glb")
        assert np.ptp(back.meshes[0].positions[:, 2]) == pytest.approx(tall, rel=1e-4)


def test_what_a_hand_holds_is_rigid_to_it(tmp_path, capsys):
    vertices, triangles, joints = person(0.0)
    hand = joints["left_hand"] + [0.08, 0, 0]
    sword = capsule(hand + [0, 0.1, 0], hand + [0, -0.9, 0.05], 0.03, 0.02)
    path = obj(tmp_path / "a.obj", *together([(vertices, triangles), sword]))
    assert character(path, rig_only=True, out=tmp_path / "a.glb") == 0
    assert "rigid to left_hand" in capsys.readouterr().err
    back = read_character(tmp_path / "a.glb")
    mesh = back.meshes[0]
    tip = int(np.argmin(mesh.positions[:, 1]))
    strongest = mesh.joints[tip, np.argmax(mesh.weights[tip])]
    assert back.skeleton.names[strongest] == "left_hand" and mesh.weights[tip].max() == 1.0


def refused(capsys, *args, **options):
    with pytest.raises(MuybridgeError) as raised:
        character(*args, **options)
    line = error_line(raised.value)
    assert "\n" not in line
    return line


def test_an_animal_is_told_its_template(tmp_path, capsys):
    path = obj(tmp_path / "dog.obj", *animal())
    line = refused(capsys, path, rig_only=True, out=tmp_path / "a.glb")
    assert line.startswith(str(path)) and "give --template quadruped" in line
    assert character(path, rig_only=True, out=tmp_path / "a.glb", template="quadruped") == 0
    assert "left_back_shin" in read_character(tmp_path / "a.glb").skeleton.names
    take = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))
    assert "--rig-only" in refused(capsys, path, motion=(take,), template="quadruped")


def test_other_mistakes_are_refused_in_one_line(tmp_path, hero, capsys):
    out = tmp_path / "a.glb"
    assert "--rig-only" in refused(capsys, hero)
    assert ".usda or .usdz" in refused(capsys, hero, rig_only=True, out=tmp_path / "a.dae")
    out.write_bytes(b"of another program")
    assert "give --overwrite" in refused(capsys, hero, rig_only=True, out=out)
    assert out.read_bytes() == b"of another program"
    toml = tmp_path / "joints.toml"
    for text, said in (("[joints]\nknee = [0, 0, 0]", "no joint 'knee'"), ("[joints]\nhips = [0, 1]", "three finite"),
                       ("[joints]\nhips = [0, 0, 90.0]", "far from the mesh"), ("x = 1", "table [joints]"),
                       ('template = "x"\n[joints]\nhips = [0, 0, 1]', "unknown template"),
                       ("placed = [1]\n[joints]\nhips = [0, 0, 1]", "three rows"),
                       ("placed = [[-1,0,0,0],[0,1,0,0],[0,0,1,0]]\n[joints]\nhips = [0, 0, 1]", "three rows"),
                       ("template = []\n[joints]\nhips = [0, 0, 1]", "unknown template"),
                       (f"[joints]\nhips = [1{'0' * 400}, 0, 1]", "three finite"),
                       ("[joints]\nhips = [true, 0, 1]", "three finite"),
                       ("[joints]\nhips = [0, 0, 1]\nspine = [0, 0, 1]", "hips and spine are in one place"),
                       ("not toml", "joints.toml")):  # fmt: skip
        toml.write_text(text)
        assert said in refused(capsys, hero, rig_only=True, out=tmp_path / "b.glb", joints=toml)
    assert not (tmp_path / "b.glb").exists()


def test_options_that_cannot_be_meant_are_refused_before_any_work(tmp_path, hero, capsys):
    out = tmp_path / "new" / "a.glb"
    for height in (0.0, -1.0, float("nan"), float("inf"), 180.0):
        assert "--height" in refused(capsys, hero, rig_only=True, out=out, height=height)
    toml = tmp_path / "joints.toml"
    assert "with --write-joints" in refused(capsys, hero, rig_only=True, out=out, height=1.8, joints=toml)
    assert "frames per second" in refused(capsys, hero, motion=(hero,), out=out, fps=0.0)
    assert "only with motion" in refused(capsys, hero, write_joints=toml, out=out)
    assert "of their own" in refused(capsys, hero, rig_only=True, write_joints=out, out=out)
    (tmp_path / "b.glb").mkdir()
    assert "is a folder" in refused(capsys, hero, rig_only=True, out=tmp_path / "b.glb")
    refused(capsys, tmp_path / "missing.obj", rig_only=True, out=out)
    assert not out.parent.exists() and not toml.exists()


def test_a_file_of_all_joints_rigs_a_mesh_that_is_refused_without(tmp_path, hero, capsys):
    toml = tmp_path / "joints.toml"
    assert character(hero, write_joints=toml) == 0
    lines = [line for line in toml.read_text().splitlines() if not line.startswith("placed")]
    toml.write_text("\n".join(lines))
    vertices, triangles = person(40.0)[:2]
    two = obj(tmp_path / "two.obj", *together([(vertices, triangles), (vertices + [1.7, 0, 0], triangles)]))
    assert "2 bodies" in refused(capsys, two, rig_only=True, out=tmp_path / "a.glb")
    assert character(two, rig_only=True, out=tmp_path / "a.glb", joints=toml) == 0
    assert "was written for hero.obj, not for two.obj" in " ".join(capsys.readouterr().err.split())


def test_joints_of_a_small_figure_keep_their_places(tmp_path, hero):
    rig = rig_mesh(*person(40.0)[:2])
    small = replace(rig, places={role: 1e-3 * place for role, place in rig.places.items()})
    write_joints(tmp_path / "joints.toml", hero, small)
    places = read_joints(tmp_path / "joints.toml").places
    assert max(np.abs(places[role] - place).max() for role, place in small.places.items()) < 1e-6


def test_a_rigged_file_goes_to_retarget(tmp_path, hero, capsys):
    assert character(hero, rig_only=True, out=tmp_path / "a.glb") == 0
    line = refused(capsys, tmp_path / "a.glb", rig_only=True, out=tmp_path / "b.glb")
    assert "muybridge retarget TAKE --to" in line and "a.glb" in line
    spaced = (tmp_path / "a.glb").rename(tmp_path / "my hero.glb")
    take = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))
    line = refused(capsys, spaced, motion=(take,), out=tmp_path / "b.glb")
    assert f"`muybridge retarget {take} --to '{spaced}'`" in line


def test_a_moved_motion_is_that_of_the_take(tmp_path, hero):
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "moved.glb"
    assert character(hero, motion=(take,), out=out, plant=False, fps=60.0, clip_name="stroll") == 0
    back = read_character(out, "stroll")
    assert back.motion.fps == pytest.approx(60.0)
    assert len(back.motion) == 2 * len(read_file(take).motion) - 1


def test_takes_and_options_that_cannot_be_used_are_refused_before_any_work(tmp_path, hero, capsys, monkeypatch):
    def late(*_, **__):
        raise AssertionError("the joints were looked for first")

    monkeypatch.setattr("muybridge.infer.commands.motion.character.rig_static", late)
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "a.glb"
    session = tmp_path / "my session"
    (session / "videos").mkdir(parents=True)
    (session / "videos" / "cam01.mp4").touch()
    line = refused(capsys, hero, motion=(session,), out=out)
    assert line.startswith(str(session)) and f"`muybridge run '{session}'`" in line
    assert "--clip-name is empty" in refused(capsys, hero, motion=(take,), out=out, clip_name=" ")
    assert "at most 10,000" in refused(capsys, hero, motion=(take,), out=out, fps=1e9)
    assert "leave out one of the two" in refused(capsys, hero, motion=(take,), rig_only=True, out=out)
    for option, value in (("clip_name", "x"), ("fps", 30.0), ("take_map", take)):
        line = refused(capsys, hero, rig_only=True, out=out, **{option: value})
        assert f"leave out --{option.replace('_', '-')}" in line


def test_the_joints_of_a_take_are_named_in_a_map(tmp_path, hero, capsys):
    take, out = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0))), tmp_path / "a.glb"
    skeleton = read_file(take).motion.skeleton
    toml = tmp_path / "roles.toml"
    toml.write_text('hips = "no such joint"')
    assert refused(capsys, hero, motion=(take,), out=out, take_map=toml).startswith(f"{toml}: ")
    toml.write_text(suggest_role_map(skeleton, find_roles(skeleton)))
    assert character(hero, motion=(take,), out=out, take_map=toml) == 0
    assert read_character(out).clips == ("walk",)
