"""Characters read, posed, and written back with one more clip; files are evaluated apart from the toolkit."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.character.read import read_character
from muybridge.motion.character.write import write_character_clip
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.container import Buffer, pack_glb
from tests.motion.character.node_tree import Tree
from tests.motion.formats.test_gltf import blender_sees, make_motion
from tests.motion.formats.test_gltf_rigs import HALF, write
from tests.paths import DATA

CHARACTERS = DATA / "characters"
# file: (clip, skins' parts, rigid parts, bones of a humanoid)
FILES = {
    "kaykit_knight.glb": ("Walking_A", 6, 9, 0),
    "kenney_character.glb": ("walk", 0, 6, 0),
    "mesh2motion_female.glb": (None, 2, 0, 0),
    "mesh2motion_bunny.glb": (None, 1, 0, 0),
    "mesh2motion_dog.glb": (None, 1, 0, 0),
    "mesh2motion_fox_animations.glb": ("Howl", 1, 0, 0),
    "vrmc_mtoon_test.vrm": (None, 0, 3, 53),
    "three_vrm_test.vrma": (None, 0, 0, 51),
}


def real(name: str) -> Path:
    path = CHARACTERS / name
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    return path


def moved(character: Character, frames: int = 10, seed: int = 0) -> Motion:
    """A motion of a character's skeleton that turns every joint and moves the first root."""
    rng = np.random.default_rng(seed)
    rest = character.rest_motion()
    turns = Rotation.from_rotvec(rng.normal(0, 0.3, (frames * len(rest.skeleton), 3))).as_quat()
    slides = None if rest.translations is None else np.tile(rest.translations, (frames, 1, 1))
    return replace(rest, quat_wxyz=np.roll(turns, 1, axis=1).reshape(frames, -1, 4), translations=slides,
                   root_positions_world=rest.root_positions_world + rng.normal(0, 0.2, (frames, 3)))  # fmt: skip


def check_places(path: Path, character: Character, motion: Motion, clip: str, frames: int = 10) -> None:
    """The file's own nodes and vertices are where the motion says to 0.1 mm, on up to ten frames."""
    tree = Tree(path)
    number = tree.clip(clip)
    joints, meshes = motion.joint_positions_world(), pose_meshes(character, motion)
    names = [tree.json["nodes"][n].get("name", f"node_{n}") for n in character.source.choice.order]
    start = tree.start(number)
    for t in np.unique(np.linspace(0, len(motion) - 1, min(frames, len(motion))).astype(int)):
        found = tree.joints(tuple(names), number, start + t / motion.fps)
        np.testing.assert_allclose(found, joints[t], rtol=0, atol=1e-4)
        parts = tree.vertices(number, start + t / motion.fps)
        assert len(parts) == len(meshes)
        for part, mesh in zip(parts, meshes, strict=True):
            np.testing.assert_allclose(part, mesh[t], rtol=0, atol=1e-4)


def without_added(text: str, added: str) -> dict[str, Any]:
    """The JSON of a file with the clip `added` taken out again, in the order of its keys."""
    document = json.loads(text)
    assert document["animations"][-1]["name"] == added
    samplers = document["animations"].pop()["samplers"]
    new = {k for s in samplers for k in (s["input"], s["output"])}
    count = len(document["accessors"]) - len(new)
    assert new == set(range(count, len(document["accessors"])))
    views = len(document["bufferViews"]) - len(new)
    assert [a["bufferView"] for a in document["accessors"][count:]] == list(range(views, views + len(new)))
    del document["accessors"][count:], document["bufferViews"][views:]
    if not document["animations"]:
        del document["animations"]
    return document


def check_unchanged(before: Path, after: Path, added: str) -> None:
    """Nothing but the clip differs: not the binary data, and not the JSON, down to its spelling."""
    old, new = Tree(before), Tree(after)
    length = old.json["buffers"][0]["byteLength"]
    assert new.binary[: len(old.binary)] == old.binary and len(old.binary) - length < 4
    assert new.json["buffers"][0]["byteLength"] == len(new.binary)
    taken = without_added(new.text, added)
    taken["buffers"][0]["byteLength"] = length
    assert json.dumps(taken) == json.dumps(old.json)
    # As text: the old one, with the new items at the ends of three arrays and the buffer's new length.
    text = new.text.replace(f'"byteLength":{len(new.binary)}', f'"byteLength":{length}').rstrip(" ")
    for key in ("accessors", "bufferViews", "animations"):
        before_it = len(old.json.get(key, []))
        items = json.dumps(new.json[key][before_it:], separators=(",", ":"), ensure_ascii=False)[1:-1]
        inserted = f",{items}" if before_it else f',"{key}":[{items}]'
        assert text.count(inserted) == 1
        text = text.replace(inserted, "")
    assert text == old.text.rstrip(" ")


def check_valid(path: Path, added: str) -> None:
    """What the specification asks of the clip that was added (sections 3.6.2.4, 3.6.2.5, 3.11)."""
    tree = Tree(path)
    document = tree.json
    animation = document["animations"][tree.clip(added)]
    targets = [(c["target"]["node"], c["target"]["path"]) for c in animation["channels"]]
    assert len(set(targets)) == len(targets) == len(animation["samplers"])
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        assert "matrix" not in document["nodes"][channel["target"]["node"]]
        times, values = document["accessors"][sampler["input"]], document["accessors"][sampler["output"]]
        assert times["type"] == "SCALAR" and times["componentType"] == values["componentType"] == 5126
        assert values["type"] == {"rotation": "VEC4", "translation": "VEC3"}[channel["target"]["path"]]
        assert values["count"] == times["count"]
        keys = tree.array(sampler["input"])
        assert times["min"] == [keys.min()] and times["max"] == [keys.max()] and (np.diff(keys[:, 0]) > 0).all()
        for accessor in (times, values):
            view = document["bufferViews"][accessor["bufferView"]]
            assert view["byteOffset"] % 4 == 0 and "target" not in view and "byteStride" not in view
            assert view["byteLength"] == accessor["count"] * 4 * {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
            assert view["byteOffset"] + view["byteLength"] <= document["buffers"][view["buffer"]]["byteLength"]
        if values["type"] == "VEC4":
            np.testing.assert_allclose(np.linalg.norm(tree.array(sampler["output"]), axis=1), 1, atol=1e-6)
    data = path.read_bytes()
    assert int.from_bytes(data[8:12], "little") == len(data) and len(data) % 4 == 0


@pytest.mark.parametrize("name", FILES)
def test_a_character_comes_back_with_one_more_clip_and_nothing_else(tmp_path, name):
    path = real(name)
    clip, skinned, rigid, bones = FILES[name]
    character = read_character(path, clip)
    assert len(character.attachments) == rigid and len(character.meshes) == skinned + rigid
    assert len(character.humanoid) == bones
    if bones:
        assert character.skeleton.names[character.humanoid["hips"]] == "hips"
    for mesh in character.meshes:
        np.testing.assert_allclose(mesh.weights.sum(axis=1), 1)
    for mesh, at_rest in zip(character.meshes, pose_meshes(character, character.rest_motion()), strict=True):
        np.testing.assert_allclose(at_rest[0], mesh.positions, atol=1e-5)
    motion = character.motion if clip else moved(character)
    if clip:  # the clip itself, as the file has it
        check_places(path, character, motion, clip, 3)
    out = tmp_path / path.name
    assert write_character_clip(character, motion, out, "new clip") == ()
    again = read_character(out, "new clip")
    assert again.clips == (*character.clips, "new clip") and len(again.motion) == len(motion)
    np.testing.assert_allclose(again.motion.forward(), motion.forward(), atol=1e-5)
    check_unchanged(path, out, "new clip")
    check_valid(out, "new clip")
    if path.suffix != ".vrma":
        check_places(out, character, motion, "new clip")


def rig_file(path: Path, top: dict[str, Any], **joint: Any) -> Path:
    """A skin of two joints below nodes of any kind, with a triangle, and a box that hangs on the second joint."""
    nodes = [
        {"name": "top", "children": [1], **top},
        {"name": "hips", "children": [2], "translation": [0, 1, 0.1], "rotation": [0, HALF, 0, HALF], **joint},
        {"name": "between", "children": [3], "translation": [0, 0.5, 0], "rotation": [HALF, 0, 0, HALF]},
        {"name": "head", "translation": [0.1, 0.4, 0], "children": [4]},
        {"name": "hat", "mesh": 1, "translation": [0, 0.1, 0], "scale": [2, 1, 1], "rotation": [0, 0, HALF, HALF]},
        {"name": "body", "mesh": 0, "skin": 0},
    ]
    write(path, nodes, [[1, 3]])
    tree = Tree(path)
    frames = tree.at(None, 0.0)
    buffer = Buffer()
    inverse = np.array([np.linalg.inv(frames[n]).T.ravel() for n in (1, 3)])
    points = np.array([[0, 1, 0], [0.2, 1.5, 0], [0, 2, 0.3]])
    weights = np.array([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]])
    attributes = {"POSITION": buffer.add(points, "VEC3", bounds=True), "NORMAL": buffer.add(np.eye(3), "VEC3"),
                  "JOINTS_0": buffer.add(np.array([[0, 1, 0, 0]] * 3), "VEC4", 5121),
                  "WEIGHTS_0": buffer.add(weights, "VEC4")}  # fmt: skip
    target = {"POSITION": buffer.add(np.array([[0, 0, 0], [0, 0, 0.1], [0, 0, 0]]), "VEC3", bounds=True)}
    hat = {"attributes": {"POSITION": attributes["POSITION"]}, "material": 0}
    body = {"primitives": [{"attributes": attributes, "targets": [target]}], "extras": {"targetNames": ["nod"]}}
    document = tree.json | {
        "skins": [{"joints": [1, 3], "inverseBindMatrices": buffer.add(inverse, "MAT4")}],
        "meshes": [body, {"primitives": [hat]}],
        "materials": [{"name": "felt", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.2, 0.1, 1.0]}}],
        "accessors": buffer.accessors, "bufferViews": buffer.views, "buffers": [{"byteLength": len(buffer.data)}],
    }  # fmt: skip
    path.write_bytes(pack_glb(document, bytes(buffer.data)))
    return path


def assert_standing(character: Character, vertices: list[np.ndarray]) -> None:
    """At rest the meshes are where the file's nodes put them, and where they are said to be."""
    posed = pose_meshes(character, character.rest_motion())
    for mesh, at_rest, there in zip(character.meshes, posed, vertices, strict=True):
        np.testing.assert_allclose(at_rest[0], mesh.positions, atol=1e-6)
        np.testing.assert_allclose(there, mesh.positions, atol=1e-6)


@pytest.mark.parametrize(
    ("top", "joint", "exact"),
    [
        ({"scale": [0.01] * 3, "rotation": [-HALF, 0, 0, HALF]}, {"translation": [0, 100, 10]}, True),
        ({"scale": [-1, 1, 1], "translation": [1, 0, 0]}, {}, True),
        ({}, {"scale": [2, 2, 2]}, True),
        ({"matrix": [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1]}, {}, True),
        ({"scale": [1, 2, 1]}, {}, False),
        ({}, {"scale": [1, 1, 1.5]}, False),
    ],
)
def test_clips_on_rigs_below_nodes_that_turn_scale_stretch_and_mirror(tmp_path, top, joint, exact):
    path = rig_file(tmp_path / "m.glb", top, **joint)
    character = read_character(path)
    assert character.skeleton.names == ("hips", "between", "head") and len(character.meshes) == 2
    assert character.attachments[0].name == "hat" and character.materials[0].name == "felt"
    np.testing.assert_allclose(character.materials[0].colour, [0.5, 0.2, 0.1, 1])
    assert_standing(character, Tree(path).vertices(None, 0))
    motion = moved(character)
    write_character_clip(character, motion, tmp_path / "out.glb", "new")
    tree = Tree(tmp_path / "out.glb")
    for t in range(10):
        found = tree.joints(character.skeleton.names, 0, t / motion.fps)
        np.testing.assert_allclose(found, motion.joint_positions_world()[t], atol=1e-5)
    if exact:
        check_places(tmp_path / "out.glb", character, motion, "new")
    check_unchanged(path, tmp_path / "out.glb", "new")
    check_valid(tmp_path / "out.glb", "new")


def test_morphs_are_blended(tmp_path):
    character = read_character(rig_file(tmp_path / "m.glb", {"scale": [2, 2, 2]}))
    body = next(m for m in character.meshes if not m.rigid)
    assert [m.name for m in body.morphs] == ["nod"] and body.morph_weights.tolist() == [0]
    plain, bent = (pose_meshes(character, character.rest_motion(), w)[1] for w in (None, {"nod": 0.5}))
    np.testing.assert_allclose(bent - plain, [[[0, 0, 0], [0, -0.05, 0], [0, 0, 0]]], atol=1e-7)


def test_a_joint_with_a_matrix_gets_transforms_that_can_be_animated(tmp_path):
    path = rig_file(tmp_path / "m.glb", {})
    text = Tree(path)
    hips = text.json["nodes"][1]
    del hips["translation"], hips["rotation"]
    hips["matrix"] = [0, 0, -1.5, 0, 0, 1.5, 0, 0, 1.5, 0, 0, 0, 0, 1, 0.1, 1]
    path.write_bytes(pack_glb(text.json, text.binary))
    character = read_character(path)
    motion = moved(character)
    (notice,) = write_character_clip(character, motion, tmp_path / "out.glb", "new")
    assert "the matrix of hips is written as translation, rotation and scale" in notice
    check_valid(tmp_path / "out.glb", "new")
    check_places(tmp_path / "out.glb", character, motion, "new")
    hips["matrix"] = [1, 0.5, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]
    path.write_bytes(pack_glb(text.json, text.binary))
    with pytest.raises(FormatError, match=r"node 1 \(hips\) has a sheared matrix"):
        write_character_clip(read_character(path), motion, tmp_path / "other.glb", "new")
    assert not (tmp_path / "other.glb").exists()


def test_a_gltf_keeps_its_text_and_its_other_files(tmp_path):
    glb = Tree(rig_file(tmp_path / "m.glb", {}))
    document = glb.json | {"images": [{"uri": "skin%20a.png"}], "images2": "Ünï\\u00e9 "}
    document["buffers"] = [{"byteLength": len(glb.binary), "uri": "m.bin"}]
    (tmp_path / "m.bin").write_bytes(glb.binary)
    (tmp_path / "skin a.png").write_bytes(b"no picture")
    text = json.dumps(document, indent=3, ensure_ascii=True).replace('"images2"', '"images2" ')
    (tmp_path / "m.gltf").write_text(text + "\n")
    character = read_character(tmp_path / "m.gltf")
    motion = moved(character)
    write_character_clip(character, motion, tmp_path / "sub" / "out.gltf", "new")
    assert (tmp_path / "sub" / "m.bin").read_bytes() == glb.binary
    assert (tmp_path / "sub" / "skin a.png").read_bytes() == b"no picture"
    new = (tmp_path / "sub" / "out.gltf").read_text()
    head = text[: text.index('"accessors"')]
    assert new.startswith(head) and new.endswith("\n") and '"images2" : "Ünï' not in new
    assert text[text.index('"images"') :].splitlines()[1:4] == new[new.index('"images"') :].splitlines()[1:4]
    again = read_character(tmp_path / "sub" / "out.gltf", "new")
    np.testing.assert_allclose(again.motion.forward(), motion.forward(), atol=1e-5)


def test_what_cannot_be_written_is_said_and_nothing_is_written(tmp_path):
    path = rig_file(tmp_path / "m.glb", {})
    character = read_character(path)
    motion = moved(character)
    out = tmp_path / "out.glb"

    def refused(words: str, motion: Motion = motion, out: Path = out, name: str = "new",
                character: Character = character) -> None:  # fmt: skip
        before = sorted(tmp_path.iterdir())
        with pytest.raises(FormatError, match=words) as raised:
            write_character_clip(character, motion, out, name)
        assert "\n" not in str(raised.value) and sorted(tmp_path.iterdir()) == before

    bad = motion.quat_wxyz.copy()
    bad[3, 1, 2] = np.nan
    refused("the motion of 'between' is not finite in frame 4", replace(motion, quat_wxyz=bad))
    refused("has no frames", motion.select(slice(0, 0)))
    refused("is the character's own file", out=path)
    refused("written to a .glb", out=tmp_path / "out.fbx")
    refused("a clip needs a name", name="")
    other = replace(motion, skeleton=replace(motion.skeleton, names=("a", "between", "head")))
    refused("of another skeleton .3 joints, such as 'a'", other)
    write_character_clip(character, motion, out, "new")
    refused("has a clip 'new' already", character=read_character(out), out=tmp_path / "next.glb")
    with pytest.raises(FormatError, match="no skin"):
        document = Tree(path).json
        del document["skins"]
        (tmp_path / "plain.glb").write_bytes(pack_glb(document, Tree(path).binary))
        read_character(tmp_path / "plain.glb")


def test_the_bones_of_vrm_0_have_the_names_of_vrm_1(tmp_path):
    names = ("hips", "leftThumbProximal", "leftThumbIntermediate", "leftThumbDistal")
    nodes = [{"name": f"J_{n}", "children": [k + 1]} if k < 3 else {"name": f"J_{n}"} for k, n in enumerate(names)]
    bones = [{"bone": n, "node": k} for k, n in enumerate(names)]
    path = write(tmp_path / "m.vrm", nodes, [], extensions={"VRM": {"humanoid": {"humanBones": bones}}})
    assert read_character(path).humanoid == {
        "hips": 0, "leftThumbMetacarpal": 1, "leftThumbProximal": 2, "leftThumbDistal": 3,
    }  # fmt: skip


def test_a_mesh_with_a_number_that_is_none_and_a_clip_that_is_not_there_are_refused(tmp_path):
    path = rig_file(tmp_path / "m.glb", {})
    tree = Tree(path)
    data = bytearray(tree.binary)
    view = tree.json["bufferViews"][tree.json["accessors"][1]["bufferView"]]
    data[view["byteOffset"] : view["byteOffset"] + 4] = np.float32(np.nan).tobytes()
    path.write_bytes(pack_glb(tree.json, bytes(data)))
    with pytest.raises(FormatError, match="m.glb: accessor 1 holds numbers that are not finite"):
        read_character(path)
    path = rig_file(tmp_path / "m.glb", {})
    write_character_clip(read_character(path), moved(read_character(path)), tmp_path / "n.glb", "walk")
    with pytest.raises(FormatError, match="has no clip 'run'; its clips are: 0 'walk'"):
        read_character(tmp_path / "n.glb", "run")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".glb", ".fbx"])
def test_blender_sees_an_added_clip_where_it_is(tmp_path, suffix):
    path = tmp_path / f"m{suffix}"
    if suffix == ".glb":
        rig_file(path, {"scale": [0.01] * 3, "rotation": [-HALF, 0, 0, HALF]}, translation=[0, 100, 10])
    else:
        write_fbx(path, make_motion(1))
    character = read_character(path)
    motion = moved(character)
    out = tmp_path / f"out{suffix}"
    write_character_clip(character, motion, out, "new")
    seen = blender_sees(out, motion.fps, tmp_path, "new")
    order = [list(seen["names"]).index(name) for name in character.skeleton.names]
    np.testing.assert_allclose(seen["places"][:, order], motion.joint_positions_world(), atol=1e-4)
    skin = next(v for m, v in zip(character.meshes, pose_meshes(character, motion), strict=True) if not m.rigid)[-1]
    far = np.linalg.norm(seen["vertices"][:, None] - skin[None], axis=2)
    assert far.min(axis=0).max() < 1e-4 and far.min(axis=1).max() < 1e-4
