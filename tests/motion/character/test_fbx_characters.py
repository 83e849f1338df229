"""FBX characters: their meshes follow the joints, and a clip changes nothing else in the file."""

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.character.read import read_character
from muybridge.motion.character.write import write_character_clip
from muybridge.motion.formats.fbx.container import Node, read_fbx_nodes
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.write import write_glb
from tests.motion.character.test_characters import moved
from tests.motion.formats.test_fbx_read import File
from tests.motion.formats.test_gltf import make_motion
from tests.paths import DATA

WORLD_FROM_FILE = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of files that are Y up


def raw_nodes(data: bytes, at: int = 27, limit: int | None = None) -> list[tuple[str, bytes, list]]:
    """The nodes of a file as they stand in it: name, the bytes of the properties, and the nodes within."""
    wide = struct.unpack_from("<I", data, 23)[0] >= 7500
    layout = "<QQQ" if wide else "<III"
    out = []
    while limit is None or at < limit:
        end, count, size = struct.unpack_from(layout, data, at)
        if end == 0:
            break
        length = data[at + struct.calcsize(layout)]
        start = at + struct.calcsize(layout) + 1
        name, within = data[start : start + length].decode(), start + length + size
        out.append((name, struct.pack("<Q", count) + data[start + length : within], raw_nodes(data, within, end)))
        at = end
    return out


def check_unchanged(before: bytes, after: bytes, added: int) -> None:
    """Every node is as it was, with `added` objects after those of the file."""
    old, new = raw_nodes(before), raw_nodes(after)
    assert [n[0] for n in old] == [n[0] for n in new]
    for (name, properties, within), (_, other, within_other) in zip(old, new, strict=True):
        assert properties == other
        if name == "Definitions":
            assert [n[0] for n in within_other][: len(within)] == [n[0] for n in within]
        elif name in ("Objects", "Connections", "Takes"):
            assert within_other[: len(within)] == within
            assert len(within_other) > len(within)
            assert name != "Objects" or len(within_other) - len(within) == added
        else:
            assert within == within_other
    # The counts say what there is.
    objects = [n[0] for n in dict((n[0], n[2]) for n in new)["Objects"]]
    for name, properties, within in dict((n[0], n[2]) for n in new).get("Definitions", []):
        if name == "ObjectType" and (kind := properties[13:].decode()).startswith("Animation"):
            (count,) = (struct.unpack("<i", p[-4:])[0] for n, p, _ in within if n == "Count")
            assert count == objects.count(kind), kind
    assert after[-16:] == before[-16:] and (len(after) - 16 - 120 - 4) % 16 == 0


def test_a_clip_changes_nothing_else_of_a_file_of_ours(tmp_path):
    write_fbx(tmp_path / "m.fbx", make_motion(5))
    character = read_character(tmp_path / "m.fbx")
    (bones,) = character.meshes
    assert not bones.rigid and len(bones.positions) and character.materials[0].colour[0] == pytest.approx(0.8)
    motion = moved(character, 6)
    write_character_clip(character, motion, tmp_path / "out.fbx", "new clip")
    again = read_character(tmp_path / "out.fbx", "new clip")
    assert again.clips == ("Take 001", "new clip") and again.motion.fps == motion.fps
    np.testing.assert_allclose(again.motion.forward(), motion.forward(), atol=1e-5)
    joints = len(character.skeleton)
    check_unchanged((tmp_path / "m.fbx").read_bytes(), (tmp_path / "out.fbx").read_bytes(), 2 + 4 * (joints + 1))
    # The same skeleton as glTF has the same mesh in the same place.
    write_glb(tmp_path / "m.glb", make_motion(5))
    other = read_character(tmp_path / "m.glb").meshes[0]
    shift = other.positions.min(axis=0) - bones.positions.min(axis=0)
    np.testing.assert_allclose(np.ptp(other.positions - bones.positions, axis=0), 0, atol=1e-5)
    np.testing.assert_allclose(shift[:2], 0, atol=1e-5)
    np.testing.assert_array_equal(other.triangles, bones.triangles)


def character_file(path: Path) -> Path:
    """Two joints with turns before and after, pivots and a size; a skin, a box on the second, and a shape."""
    file = File()
    file.settings.number("UnitScaleFactor", 1.0)
    top = file.joint("top", 0, (0, 0, 0), "Null", LclScaling=(2, 2, 2), LclRotation=(0, 90, 0))
    hips = file.joint("hips", top, (0, 50, 5), PreRotation=(10, 20, 30), PostRotation=(5, 0, -40), RotationOrder=2,
                      RotationPivot=(1, 2, 3), RotationOffset=(0.5, 0, 0))  # fmt: skip
    head = file.joint("head", hips, (0, 25, 0), PreRotation=(0, 0, 45))
    hat = file.joint("hat", head, (0, 5, 0), "Mesh", LclScaling=(1, 2, 1), GeometricTranslation=(0, 1, 0))
    body = file.joint("body", 0, (0, 0, 0), "Mesh")
    points = np.array([[0, 100, 0], [10, 100, 0], [10, 150, 0], [0, 160, 10.0]])
    corners = np.array([0, 1, 2, ~3], np.int32)
    for model in (hat, body):
        geometry = file.add(
            "Geometry", "g\x00\x01Geometry", "Mesh", Vertices=points.ravel(), PolygonVertexIndex=corners
        )
        file.links.add("C", "OO", geometry, model)
    skin = file.add("Deformer", "s\x00\x01Deformer", "Skin")
    file.links.add("C", "OO", skin, geometry)
    bound = {}
    for k, joint in enumerate((hips, head)):
        bound[joint] = np.eye(4)
        bound[joint][:3, :3] = 2 * Rotation.from_euler("xyz", [30 * k, 40, 10], degrees=True).as_matrix()
        bound[joint][:3, 3] = (3, 100 + 50 * k, 2)
        cluster = file.add(
            "Deformer", "c\x00\x01SubDeformer", "Cluster", Indexes=np.array([[0, 1, 2], [2, 3, 1]][k], np.int32),
            Weights=np.array([[1, 0.75, 0.5], [0.5, 1, 0.25]][k]), Transform=np.linalg.inv(bound[joint]).T.ravel(),
            TransformLink=bound[joint].T.ravel(),
        )  # fmt: skip
        file.links.add("C", "OO", cluster, skin)
        file.links.add("C", "OO", joint, cluster)
    blend, channel = (file.add("Deformer", f"nod\x00\x01{k}", k) for k in ("BlendShape", "BlendShapeChannel"))
    shape = file.add("Geometry", "nod\x00\x01Geometry", "Shape", Indexes=np.array([3], np.int32),
                     Vertices=np.array([0, 0, 10.0]))  # fmt: skip
    for child, parent in ((blend, geometry), (channel, blend), (shape, channel)):
        file.links.add("C", "OO", child, parent)
    return file.write(path)


def test_a_skin_and_a_part_that_hangs_on_a_joint(tmp_path):
    character = read_character(character_file(tmp_path / "m.fbx"))
    skeleton = character.skeleton
    assert skeleton.names == ("hips", "head") and [m.rigid for m in character.meshes] == [True, False]
    hat, body = character.meshes
    np.testing.assert_allclose(character.root_at_rest, WORLD_FROM_FILE @ [0.03, 1.0, 0.02])
    np.testing.assert_allclose(skeleton.offsets[1], WORLD_FROM_FILE @ [0, 0.5, 0], atol=1e-12)
    points = np.array([[0, 1, 0], [0.1, 1, 0], [0.1, 1.5, 0], [0, 1.6, 0.1]]) @ WORLD_FROM_FILE.T
    order = [int(np.argmin(np.linalg.norm(body.positions - p, axis=1))) for p in points]
    np.testing.assert_allclose(body.positions[order], points, atol=1e-9)
    assert sorted(map(sorted, np.argsort(order)[body.triangles].tolist())) == [[0, 1, 2], [0, 2, 3]]
    dense = np.zeros((4, 2))
    np.add.at(dense, (np.arange(4)[:, None], body.joints[order]), body.weights[order])
    np.testing.assert_allclose(dense, [[1, 0], [0.75, 0.25], [0.5, 0.5], [0, 1]])
    assert body.morphs[0].name == "nod"
    np.testing.assert_allclose(body.morphs[0].offsets[order][3], WORLD_FROM_FILE @ [0, 0, 0.1], atol=1e-12)
    for mesh, posed in zip(character.meshes, pose_meshes(character, character.rest_motion()), strict=True):
        np.testing.assert_allclose(posed[0], mesh.positions, atol=1e-9)
    # By itself: the hat turns with the head, from where its own transforms put it.
    motion = moved(character)
    frames = motion.joint_frames()[:, 1]
    local = np.array([[0, 100, 0], [10, 100, 0], [10, 150, 0], [0, 160, 10.0]]) + [0, 1, 0]
    local = 0.02 * (local * [1, 2, 1] + [0, 5, 0])
    expected = np.einsum("tab,vb->tva", frames[:, :3, :3], local) + frames[:, None, :3, 3]
    found = pose_meshes(character, motion)[0]
    distance = np.linalg.norm(found[:, :, None] - expected[:, None], axis=-1).min(axis=1)
    assert distance.max() < 1e-6


@pytest.mark.parametrize("version", [7400, 7700])
def test_a_clip_on_joints_with_turns_pivots_and_sizes(tmp_path, version, monkeypatch):
    monkeypatch.setattr("muybridge.motion.formats.fbx.container.VERSION", version)
    monkeypatch.setattr("muybridge.motion.formats.fbx.container.append_node.__defaults__", (version,))
    path = character_file(tmp_path / "m.fbx")
    assert struct.unpack_from("<I", path.read_bytes(), 23) == (version,)
    character = read_character(path)
    motion = moved(character)
    write_character_clip(character, motion, tmp_path / "out.fbx", "new")
    read, _ = read_fbx(tmp_path / "out.fbx", "new")
    np.testing.assert_allclose(read.joint_frames(), motion.joint_frames(), atol=1e-5)
    check_unchanged(path.read_bytes(), (tmp_path / "out.fbx").read_bytes(), 2 + 4 * 4)


def test_a_real_recording_with_another_clip(tmp_path):
    path = DATA / "motion" / "cmu_91_48.fbx"
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    character = read_character(path)
    motion = character.motion.select(slice(0, 20))
    write_character_clip(character, motion, tmp_path / "out.fbx", "short")
    again = read_character(tmp_path / "out.fbx", "short").motion
    assert len(again) == 20
    np.testing.assert_allclose(again.forward(), motion.forward(), atol=1e-4)  # 150 m from the origin
    objects = [n for n in read_fbx_nodes(tmp_path / "out.fbx").all("Objects")]
    assert isinstance(objects[0], Node) and len(objects[0].all("AnimationStack")) == 2
    check_unchanged(path.read_bytes(), (tmp_path / "out.fbx").read_bytes(), 2 + 4 * (len(character.skeleton) + 1))


def test_a_bvh_keeps_its_hierarchy_to_the_letter(tmp_path):
    text = """HIERARCHY\r
ROOT hips {  OFFSET 1 2 3\r
 CHANNELS 6 Yposition Xposition Zposition Xrotation Yrotation Zrotation\r
 JOINT  knee\r
 {\r
 OFFSET 0 -4.0e1 0\r
 CHANNELS 1 Xrotation\r
 End Site { OFFSET 0 -40 0 } } }\r
Motion\r
Frames: 1\r
Frame Time: 0.01\r
1 2 3 4 5 6 7\r
"""
    (tmp_path / "m.bvh").write_bytes(text.encode())
    character = read_character(tmp_path / "m.bvh")
    rest = character.rest_motion()
    turns = Rotation.from_euler("ZXY", [[[10, 20, 30], [0, 40, 0]], [[50, -20, 0], [0, 10, 0]]][0], degrees=True)
    quat = np.tile(np.roll(turns.as_quat(), 1, axis=1), (3, 1, 1))
    motion = replace(rest, quat_wxyz=quat, root_positions_world=np.arange(9.0).reshape(3, 3), fps=50.0)
    notices = write_character_clip(character, motion, tmp_path / "out.bvh", "new")
    assert notices == ()
    out = (tmp_path / "out.bvh").read_bytes().decode()
    assert out.startswith(text[: text.index("Frames")]) and "Frames: 3\r\nFrame Time: 0.020000000\r\n" in out
    again = read_character(tmp_path / "out.bvh").motion
    np.testing.assert_allclose(again.forward(), motion.forward(), atol=1e-5)
    bent = replace(motion, quat_wxyz=np.roll(motion.quat_wxyz, 1, axis=1))
    (notice,) = write_character_clip(character, bent, tmp_path / "bent.bvh", "new")
    assert "degrees of 'knee' are lost, for which it has no channels" in notice
    slid = replace(motion.skeleton, sliding=(1,))
    away = replace(motion, skeleton=slid, translations=np.ones((3, 1, 3)))
    with pytest.raises(FormatError, match="'knee' moves by 2.02 m from its OFFSET"):
        write_character_clip(character, away, tmp_path / "no.bvh", "new")
    assert not (tmp_path / "no.bvh").exists()


@pytest.mark.parametrize("skinned", [True, False])
def test_joints_that_are_no_limb_nodes(tmp_path, skinned):
    file = File()
    hips = file.joint("hips", 0, (0, 100, 0), "Null")
    head = file.joint("head", hips, (0, 50, 0), "Null")
    hat = file.joint("hat", head, (0, 5, 0), "Mesh")
    file.joint("lamp", 0, (0, 0, 0), "Mesh")
    geometry = file.add("Geometry", "g\x00\x01Geometry", "Mesh", Vertices=np.eye(3).ravel(),
                        PolygonVertexIndex=np.array([0, 1, ~2], np.int32))  # fmt: skip
    file.links.add("C", "OO", geometry, hat)
    if skinned:
        for joint in (hips, head):
            cluster = file.add("Deformer", "c\x00\x01SubDeformer", "Cluster")
            file.links.add("C", "OO", joint, cluster)
    else:
        layer = file.layer()
        for joint in (hips, head):
            file.curve(layer, joint, "Lcl Rotation", "X", [0, 0.1], [0, 30])
    character = read_character(file.write(tmp_path / "m.fbx"))
    assert character.skeleton.names == ("hips", "head") and [m.name for m in character.meshes] == ["hat"]
    motion = moved(character, 3)
    write_character_clip(character, motion, tmp_path / "out.fbx", "new")
    read, _ = read_fbx(tmp_path / "out.fbx", "new")
    np.testing.assert_allclose(read.joint_frames(), motion.joint_frames(), atol=1e-5)
