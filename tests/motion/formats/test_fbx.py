"""FBX: the container is whole, and what another program reads from it is the motion."""

import struct
import zlib
from pathlib import Path

import numpy as np

from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.app import run_command
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh

WORLD_FROM_FBX = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) / 100


def make_motion(frames: int = 20, seed: int = 0, spin: float = 1.0) -> Motion:
    rng = np.random.default_rng(seed)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, spin, frames)[:, None, None]
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, 60.0, root, quat_from_matrix(exp_so3(turn)))


def parse(data: bytes, at: int) -> tuple[dict | None, int]:
    """A node at `at` of a binary FBX as name, properties and children; None for the mark that ends a list."""
    end, count, size, length = struct.unpack_from("<IIIB", data, at)
    if end == 0:
        return None, at + 13
    start = at + 13 + length
    node = {"name": data[at + 13 : start].decode(), "properties": [], "children": []}
    at = start
    for _ in range(count):
        letter, at = data[at : at + 1].decode(), at + 1
        if letter in "SR":
            (n,) = struct.unpack_from("<I", data, at)
            node["properties"].append(data[at + 4 : at + 4 + n])
            at += 4 + n
        elif letter in "fdil":
            n, packed, stored = struct.unpack_from("<III", data, at)
            raw = data[at + 12 : at + 12 + stored]
            kind = {"f": "<f4", "d": "<f8", "i": "<i4", "l": "<i8"}[letter]
            node["properties"].append(np.frombuffer(zlib.decompress(raw) if packed else raw, kind))
            assert len(node["properties"][-1]) == n
            at += 12 + stored
        else:
            kind = {"C": "<B", "I": "<i", "L": "<q", "D": "<d"}[letter]
            node["properties"].append(struct.unpack_from(kind, data, at)[0])
            at += struct.calcsize(kind)
    assert at == start + size
    while at < end:
        child, at = parse(data, at)
        if child is None:
            break
        node["children"].append(child)
    assert at == end
    return node, at


def tree(path: Path) -> dict[str, dict]:
    data = path.read_bytes()
    assert data.startswith(b"Kaydara FBX Binary  \x00\x1a\x00") and struct.unpack_from("<I", data, 23) == (7400,)
    nodes, at = {}, 27
    while True:
        node, at = parse(data, at)
        if node is None:
            break
        nodes[node["name"]] = node
    assert (len(data) - 140) % 16 == 0 and struct.unpack_from("<I", data, len(data) - 140) == (7400,)
    return nodes


def child(node: dict, name: str) -> dict:
    return next(c for c in node["children"] if c["name"] == name)


def joints_of(path: Path) -> tuple[list[str], np.ndarray]:
    """Names, and places (T, J, 3) in our world by forward kinematics from the file's own curves."""
    nodes = tree(path)
    objects = {o["properties"][0]: o for o in nodes["Objects"]["children"]}
    links = [c["properties"] for c in nodes["Connections"]["children"]]
    assert all(p[1] in objects and (p[2] == 0 or p[2] in objects) for p in links)
    assert len({(p[1], p[2]) for p in links}) == len(links)
    limbs = {n: o for n, o in objects.items() if o["name"] == "Model" and o["properties"][2] == b"LimbNode"}
    parent = {p[1]: p[2] for p in links if p[0] == b"OO" and p[1] in limbs and (p[2] in limbs or p[2] == 0)}
    curves = {}
    for p in links:
        if p[0] == b"OP" and p[2] in limbs:
            axes = {q[3]: objects[q[1]] for q in links if q[0] == b"OP" and q[2] == p[1]}
            keys = [child(axes[f"d|{a}".encode()], "KeyValueFloat")["properties"][0] for a in "XYZ"]
            curves[p[2], p[3]] = np.stack(keys, 1).astype(float)
    frames = len(next(iter(curves.values())))
    names, places, turns = [], {0: np.zeros((frames, 3))}, {0: np.tile(np.eye(3), (frames, 1, 1))}
    for n, limb in limbs.items():  # parents come first
        lines = child(limb, "Properties70")["children"]
        still = next(c["properties"][4:] for c in lines if c["properties"][0] == b"Lcl Translation")
        at = curves.get((n, b"Lcl Translation"), np.tile(still, (frames, 1)))
        angles = np.radians(curves.get((n, b"Lcl Rotation"), np.zeros((frames, 3))))
        x, y, z = (axis_turn(angles[:, k], k) for k in range(3))
        places[n] = places[parent[n]] + np.einsum("tij,tj->ti", turns[parent[n]], at)
        turns[n] = turns[parent[n]] @ z @ y @ x
        names.append(limb["properties"][1].split(b"\x00")[0].decode())
    return names, np.stack([places[n] for n in limbs], 1) @ WORLD_FROM_FBX.T


def axis_turn(angle: np.ndarray, axis: int) -> np.ndarray:
    out = np.zeros((len(angle), 3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out[:, axis, axis] = 1
    out[:, a, a] = out[:, b, b] = np.cos(angle)
    out[:, b, a], out[:, a, b] = np.sin(angle), -np.sin(angle)
    return out


def test_the_curves_say_the_motion(tmp_path):
    motion = make_motion(40, 2, spin=3.0)
    write_fbx(tmp_path / "m.fbx", motion)
    names, places = joints_of(tmp_path / "m.fbx")
    order = [names.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(places[:, order], motion.joint_positions_world(), atol=1e-6)
    ends = [n for n in names if n.endswith("_End")]
    assert ends and len(names) == len(motion.skeleton) + len(ends)


def test_times_rates_units_and_axes(tmp_path):
    for fps, mode in ((60.0, 3), (29.97, 14)):
        motion = make_motion(7, 1)
        motion = Motion(motion.skeleton, fps, motion.root_positions_world, motion.quat_wxyz)
        write_fbx(tmp_path / "m.fbx", motion)
        nodes = tree(tmp_path / "m.fbx")
        lines = child(nodes["GlobalSettings"], "Properties70")["children"]
        settings = {c["properties"][0].decode(): c["properties"][4] for c in lines}
        assert settings["TimeMode"] == mode and settings["CustomFrameRate"] == fps
        assert settings["UpAxis"] == 1 and settings["UnitScaleFactor"] == 1.0
        curve = child(nodes["Objects"], "AnimationCurve")
        times = child(curve, "KeyTime")["properties"][0]
        np.testing.assert_allclose(times / 46186158000, np.arange(7) / fps, atol=1e-9)


def test_the_mesh_is_bound_where_it_lies(tmp_path):
    motion = make_motion(3)
    write_fbx(tmp_path / "m.fbx", motion)
    objects = tree(tmp_path / "m.fbx")["Objects"]["children"]
    mesh = bone_mesh(motion.skeleton)
    geometry = next(o for o in objects if o["name"] == "Geometry")
    vertices = child(geometry, "Vertices")["properties"][0].reshape(-1, 3) @ WORLD_FROM_FBX.T
    np.testing.assert_allclose(vertices, mesh.positions, atol=1e-9)
    bound = np.zeros(len(vertices))
    for cluster in (o for o in objects if o["name"] == "Deformer" and o["properties"][2] == b"Cluster"):
        there = child(cluster, "Transform")["properties"][0].reshape(4, 4)
        back = child(cluster, "TransformLink")["properties"][0].reshape(4, 4)
        np.testing.assert_allclose(there @ back, np.eye(4), atol=1e-12)
        if any(c["name"] == "Indexes" for c in cluster["children"]):
            bound[child(cluster, "Indexes")["properties"][0]] += child(cluster, "Weights")["properties"][0]
    np.testing.assert_array_equal(bound, 1)


def test_convert_writes_it(tmp_path):
    write_glb(tmp_path / "m.glb", make_motion(5))
    assert run_command(["convert", str(tmp_path / "m.glb"), str(tmp_path / "m.fbx")]) == 0
    names, places = joints_of(tmp_path / "m.fbx")
    motion = make_motion(5)
    order = [names.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(places[:, order], motion.joint_positions_world(), atol=1e-5)
