"""glTF: round trips, the rules of the specification, other programs' files, what Blender sees."""

import base64
import copy
import importlib.util
import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.container import Buffer, pack_glb
from muybridge.motion.formats.gltf.read import clip_names, read_gltf, read_gltf_take
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh
from muybridge.motion.formats.skeletal.bvh import write_bvh

# A Python that has Blender's module: its own process, since Blender takes over much of the one it runs in.
BLENDER = os.environ.get("MUYBRIDGE_BLENDER_PYTHON") or (sys.executable if importlib.util.find_spec("bpy") else None)


def make_motion(frames: int = 20, seed: int = 0, spin: float = 1.0, fps: float = 60.0) -> Motion:
    rng = np.random.default_rng(seed)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, spin, frames)[:, None, None]
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, fps, root, quat_from_matrix(exp_so3(turn)))


def unpack(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def assert_same(back: Motion, motion: Motion, atol: float = 2e-6) -> None:
    assert set(back.skeleton.names) == set(motion.skeleton.names) and back.fps == pytest.approx(motion.fps)
    order = [back.skeleton.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(back.forward()[:, order], motion.forward(), atol=atol)
    np.testing.assert_allclose(back.skeleton.offsets[order], motion.skeleton.offsets, atol=atol)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 999),
    frames=st.integers(1, 6),
    spin=st.sampled_from([0.0, 0.5, 3.0]),
    fps=st.sampled_from([24, 29.97, 120.0]),
)
def test_round_trip(tmp_path_factory, seed, frames, spin, fps):
    motion = make_motion(frames, seed, spin, fps)
    path = tmp_path_factory.mktemp("gltf") / "m.glb"
    write_glb(path, motion)
    back = read_gltf(path)
    assert_same(back, motion)
    order = [back.skeleton.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(back.skeleton.tips[order], motion.skeleton.tips, atol=1e-6)
    assert list(path.parent.iterdir()) == [path]


def test_what_is_written_keeps_the_rules(tmp_path):
    write_glb(tmp_path / "m.glb", make_motion(300, spin=6.0))
    data = (tmp_path / "m.glb").read_bytes()
    assert struct.unpack_from("<III", data) == (0x46546C67, 2, len(data))
    document, binary = unpack(tmp_path / "m.glb")
    joints = document["skins"][0]["joints"]
    children = [c for n in document["nodes"] for c in n.get("children", [])]
    assert [j for j in joints if j not in children] == [document["skins"][0]["skeleton"]], "one root"
    assert set(document["scenes"][0]["nodes"]) == set(range(len(document["nodes"]))) - set(children)
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0 and view["byteOffset"] + view["byteLength"] <= len(binary)

    def array(index: int) -> np.ndarray:
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        dtype = {5126: "<f4", 5121: "<u1"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
        values = np.frombuffer(binary, dtype, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
        if "min" in accessor:
            assert (values.min(0) == np.float32(accessor["min"])).all()
            assert (values.max(0) == np.float32(accessor["max"])).all()
        return values

    (primitive,) = document["meshes"][0]["primitives"]
    at = {key: array(index) for key, index in primitive["attributes"].items()}
    assert len({len(a) for a in at.values()}) == 1 and len(at["POSITION"]) % 3 == 0
    assert (at["WEIGHTS_0"].sum(1) == 1).all() and at["JOINTS_0"].max() < len(joints)
    np.testing.assert_allclose(np.linalg.norm(at["NORMAL"], axis=1), 1, atol=1e-6)
    assert abs(at["POSITION"][:, 1].min()) < 0.03, "at rest it stands on the ground"
    ibm = array(document["skins"][0]["inverseBindMatrices"]).reshape(-1, 4, 4)
    assert (ibm[:, :, 3] == [0, 0, 0, 1]).all()
    place = [np.array(n.get("translation", [0, 0, 0])) for n in document["nodes"]]
    for i, node in enumerate(document["nodes"]):
        for child in node.get("children", []):
            place[child] = place[child] + place[i]
    np.testing.assert_allclose(ibm[:, 3, :3], -np.array(place)[joints], atol=1e-6)
    animation = document["animations"][0]
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        times, values = array(sampler["input"])[:, 0], array(sampler["output"])
        assert times[0] == 0 and (np.diff(times) > 0).all() and len(times) == len(values) == 300
        if channel["target"]["path"] == "rotation":
            np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, atol=1e-6)
            assert (np.sum(values[1:] * values[:-1], axis=1) > 0).all(), "no jump of sign"


def test_other_readers_take_it(tmp_path):
    import pygltflib

    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    motion = make_motion()
    write_glb(tmp_path / "m.glb", motion)
    seen = pygltflib.GLTF2().load(tmp_path / "m.glb")
    assert len(seen.skins[0].joints) == len(motion.skeleton) and len(seen.animations) == 1
    scene = trimesh.load(tmp_path / "m.glb")
    assert 1.5 < scene.extents[1] < 1.8 and scene.extents[0] > 1.4, "upright, with arms spread"


def test_bone_mesh_is_closed_and_faces_outward():
    skeleton = BODY.skeleton(prior_shape(1.7))
    mesh = bone_mesh(skeleton)
    triangles = mesh.positions.reshape(-1, 8, 3, 3)
    volumes = np.einsum("bti,bti->b", triangles[..., 0, :], np.cross(triangles[..., 1, :], triangles[..., 2, :])) / 6
    assert (volumes > 0).all() and len(volumes) >= len(skeleton) - 1
    start = skeleton.rest_positions[mesh.joints]
    assert np.linalg.norm(mesh.positions - start, axis=1).max() < 0.5


def foreign(motion: Motion, scale: float = 1.0, cubic: bool = False, matrix: bool = False, seed: int = 3) -> bytes:
    """The motion as another program might have it: joints with axes of their own at rest, under a node that turns
    and scales, with every bone's translation animated, and a second skin-less object."""
    rng = np.random.default_rng(seed)
    skeleton = motion.skeleton
    to_gltf = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    own = Rotation.random(len(skeleton), rng=rng).as_matrix()  # rest axes of each joint in glTF's world
    holder = Rotation.from_euler("xyz", [90, 20, -30], degrees=True).as_matrix()
    turns, places = skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))
    turns, places = to_gltf @ turns @ to_gltf.T @ own, places @ to_gltf.T
    rest = skeleton.rest_positions @ to_gltf.T
    buffer = Buffer()
    nodes, channels, samplers = [], [], []
    times = buffer.add(0.5 + np.arange(len(motion)) / motion.fps, "SCALAR", bounds=True)
    for j, parent in enumerate(skeleton.parents):
        up, at = (np.broadcast_to(holder, turns[:, 0].shape), np.zeros(3)) if parent < 0 else (
            turns[:, parent], places[:, parent])  # fmt: skip
        local = np.swapaxes(up, 1, 2) @ turns[:, j]
        place = (np.swapaxes(up, 1, 2) @ (places[:, j] - at)[..., None])[..., 0] / scale
        rest_up, rest_at = (holder, np.zeros(3)) if parent < 0 else (own[parent], rest[parent])
        node = {"name": skeleton.names[j], "children": [k for k, p in enumerate(skeleton.parents) if p == j]}
        if not node["children"]:
            del node["children"]
        local_rest = rest_up.T @ own[j]
        node["translation"] = (rest_up.T @ (rest[j] - rest_at) / scale).tolist()
        node["rotation"] = Rotation.from_matrix(local_rest).as_quat().tolist()
        if matrix and j > 2:  # glTF forbids matrices on animated nodes; readers meet them all the same
            square = np.eye(4)
            square[:3, :3], square[:3, 3] = local_rest, node.pop("translation")
            del node["rotation"]
            node["matrix"] = square.T.ravel().tolist()
        nodes.append(node)
        quat = Rotation.from_matrix(local).as_quat()
        for what, values in (("rotation", quat), ("translation", place)):
            if cubic:
                flat = np.zeros_like(values)
                values = np.stack([flat, values, flat], axis=1).reshape(-1, values.shape[1])
            kind = "CUBICSPLINE" if cubic else "STEP" if what == "translation" else "LINEAR"
            output = buffer.add(values, "VEC4" if what == "rotation" else "VEC3")
            samplers.append({"input": times, "output": output, "interpolation": kind})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": j, "path": what}})
    nodes.append({"name": "holder", "children": [0], "scale": [scale] * 3,
                  "rotation": Rotation.from_matrix(holder).as_quat().tolist()})  # fmt: skip
    bind = np.tile(np.eye(4), (len(skeleton), 1, 1))
    bind[:, :3, :3], bind[:, :3, 3] = own * scale, rest
    inverse = buffer.add(np.swapaxes(np.linalg.inv(bind), 1, 2).reshape(-1, 16), "MAT4")
    document = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "skins": [{"joints": list(range(len(skeleton))), "inverseBindMatrices": inverse}],
        "animations": [{"channels": channels, "samplers": samplers}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    return pack_glb(document, bytes(buffer.data))


@pytest.mark.parametrize("kind", [{}, {"scale": 0.01}, {"cubic": True}, {"matrix": True}])
def test_other_programs_files(tmp_path, kind):
    motion = make_motion(9, 4, fps=30.0)
    (tmp_path / "m.glb").write_bytes(foreign(motion, **kind))
    assert_same(read_gltf(tmp_path / "m.glb"), motion, atol=2e-5)


def test_text_form_with_its_buffer_inside_or_beside(tmp_path):
    motion = make_motion(4)
    write_glb(tmp_path / "m.glb", motion)
    document, binary = unpack(tmp_path / "m.glb")
    document["buffers"][0]["uri"] = "the%20data.bin"
    (tmp_path / "the data.bin").write_bytes(binary)
    (tmp_path / "beside.gltf").write_text(json.dumps(document))
    assert_same(read_gltf(tmp_path / "beside.gltf"), motion)
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    (tmp_path / "inside.gltf").write_text(json.dumps(document))
    assert_same(read_gltf(tmp_path / "inside.gltf"), motion)
    document["buffers"][0]["uri"] = "gone.bin"
    (tmp_path / "gone.gltf").write_text(json.dumps(document))
    with pytest.raises(FormatError, match=r"gone\.bin cannot be read"):
        read_gltf(tmp_path / "gone.gltf")


def damage(document: dict, what: str) -> None:
    if what == "asset":
        document["asset"]["version"] = "1.0"
    elif what == "skins":
        del document["skins"], document["animations"]
    elif what == "cycle":
        document["nodes"][-2]["children"] = [0]
    elif what == "two parents":
        document["nodes"][-1]["children"] = [1]
    elif what == "far joint":
        document["skins"][0]["joints"].append(999)
    elif what == "nan":
        document["nodes"][1]["translation"] = [0, "x", 0]
    elif what == "beyond":
        document["accessors"][-1]["count"] = 10**9
    elif what == "keys":
        document["animations"][0]["samplers"][1]["output"] = document["animations"][0]["samplers"][0]["output"]
    elif what == "accessor":
        document["animations"][0]["samplers"][1]["output"] = 10**6


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("asset", "not glTF 2.0"),
        ("skins", "holds no skin"),
        ("cycle", "its own ancestor|another parent"),
        ("two parents", "another parent"),
        ("far joint", "not among the nodes"),
        ("nan", "not a glTF 2.0 file: could not convert"),
        ("beyond", "beyond its buffer"),
        ("keys", "do not fit together"),
        ("accessor", "not a glTF 2.0 file: list index out of range"),
    ],
)
def test_malformed(tmp_path, what, says):
    write_glb(tmp_path / "m.glb", make_motion(4))
    document, binary = unpack(tmp_path / "m.glb")
    changed = copy.deepcopy(document)
    damage(changed, what)
    (tmp_path / "bad.glb").write_bytes(pack_glb(changed, binary))
    with pytest.raises(FormatError, match=says) as raised:
        read_gltf(tmp_path / "bad.glb")
    assert "bad.glb" in str(raised.value) and "\n" not in str(raised.value)
    (tmp_path / "short.glb").write_bytes((tmp_path / "m.glb").read_bytes()[:-7])
    with pytest.raises(FormatError, match="cut off"):
        read_gltf(tmp_path / "short.glb")


def test_sliding_bones_keep_their_translations(tmp_path):
    motion = make_motion(5)
    write_glb(tmp_path / "m.glb", motion)
    document, binary = unpack(tmp_path / "m.glb")
    root, name = document["nodes"][0]["translation"], document["nodes"][4]["name"]
    document["animations"][0]["channels"][0]["target"]["node"] = 4
    (tmp_path / "s.glb").write_bytes(pack_glb(document, binary))
    seen = read_gltf(tmp_path / "s.glb")
    j = seen.skeleton.index(name)
    assert seen.skeleton.sliding == (j,)
    # The track of the root's places now moves joint 4 against its parent, and the root stays where its node is.
    np.testing.assert_allclose(seen.translations[:, 0], motion.root_positions_world, atol=1e-6)
    np.testing.assert_allclose(seen.root_positions_world, np.tile([root[0], -root[2], root[1]], (5, 1)), atol=1e-6)
    np.testing.assert_allclose(seen.skeleton.offsets[j], motion.skeleton.offsets[4], atol=1e-6)


def test_without_a_skin_what_moves_is_a_joint(tmp_path):
    motion = make_motion(6)
    write_glb(tmp_path / "m.glb", motion)
    document, binary = unpack(tmp_path / "m.glb")
    del document["skins"], document["meshes"]
    document["nodes"][-1] = {"name": "bones"}
    (tmp_path / "a.glb").write_bytes(pack_glb(document, binary))
    assert_same(read_gltf(tmp_path / "a.glb"), motion)


def test_a_clip_is_chosen_by_name_or_number(tmp_path):
    one, two = make_motion(6, 1), make_motion(6, 2)
    write_glb(tmp_path / "1.glb", one)
    write_glb(tmp_path / "2.glb", two)
    document, binary = unpack(tmp_path / "1.glb")
    other, more = unpack(tmp_path / "2.glb")
    views, accessors = len(document["bufferViews"]), len(document["accessors"])
    for view in other["bufferViews"]:
        document["bufferViews"].append(view | {"byteOffset": view["byteOffset"] + len(binary)})
    for accessor in other["accessors"]:
        document["accessors"].append(accessor | {"bufferView": accessor["bufferView"] + views})
    clip = other["animations"][0]
    for sampler in clip["samplers"]:
        sampler["input"], sampler["output"] = sampler["input"] + accessors, sampler["output"] + accessors
    document["animations"][0]["name"] = clip["name"] = "walk"
    document["animations"].append(clip)
    document["buffers"][0]["byteLength"] = len(binary + more)
    (tmp_path / "both.glb").write_bytes(pack_glb(document, binary + more))
    path = tmp_path / "both.glb"
    assert clip_names(path) == ("walk", "walk.001")
    for clip, motion in ((None, one), ("walk", one), (0, one), ("walk.001", two), (1, two), ("1", two)):
        assert_same(read_gltf(path, clip), motion)
    assert read_gltf_take(path).notices == ("both.glb: the first of its 2 clips was read, 'walk'",)
    assert not read_gltf_take(path, 1).notices
    for clip in ("run", 2, -1):
        with pytest.raises(FormatError, match=r"has no clip .*; its clips are: 0 'walk', 1 'walk\.001'; pass `clip`"):
            read_gltf(path, clip)


def blender_sees(path: Path, fps: float, folder: Path, clip: str = "") -> dict[str, np.ndarray]:
    if not BLENDER or not shutil.which(BLENDER):
        pytest.skip("Blender's Python module is not here: pip install bpy, or set MUYBRIDGE_BLENDER_PYTHON")
    out = folder / f"{path.suffix[1:]}.npz"
    script = Path(__file__).with_name("blender_joints.py")
    done = subprocess.run([BLENDER, script, path, str(fps), out, "", clip], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return dict(np.load(out))


@pytest.mark.parametrize("suffix", [".glb", ".bvh", ".fbx"])
def test_blender_sees_the_joints_where_they_are(tmp_path, suffix):
    motion = make_motion(40, 2, spin=3.0)
    path = tmp_path / f"m{suffix}"
    {".glb": write_glb, ".bvh": write_bvh, ".fbx": write_fbx}[suffix](path, motion)
    seen = blender_sees(path, motion.fps, tmp_path)
    names = list(seen["names"])
    order = [names.index(n) for n in motion.skeleton.names]
    ends = [n for n in names if n.endswith("_End")]  # FBX has joints where the last bones end
    assert len(names) == len(motion.skeleton) + len(ends) and bool(ends) == (suffix == ".fbx")
    np.testing.assert_allclose(seen["places"][:, order], motion.joint_positions_world(), atol=1e-4)
    if suffix == ".glb":
        mesh = bone_mesh(motion.skeleton)
        joint = motion.forward()[-1][mesh.joints]
        local = mesh.positions - motion.skeleton.rest_positions[mesh.joints]
        skin = np.einsum("vij,vj->vi", joint[:, :3, :3], local) + joint[:, :3, 3]
        far = np.linalg.norm(seen["vertices"][:, None] - skin[None], axis=2)
        assert far.min(axis=0).max() < 1e-4 and far.min(axis=1).max() < 1e-4
