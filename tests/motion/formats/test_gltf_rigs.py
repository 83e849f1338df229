"""glTF files of odd rigs: several roots, several skins, scaled holders, names that repeat, no skin at all."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.motion.formats.gltf.container import Buffer, pack_glb
from muybridge.motion.formats.gltf.read import read_gltf, read_gltf_take
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.registry import read_file
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from tests.motion.formats.test_gltf import make_motion, unpack
from tests.paths import DATA

WORLD_FROM_GLTF = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
HALF = float(np.sqrt(0.5))


def write(path: Path, nodes: list[dict], skins: list[list[int]], tracks: dict[tuple[int, str], Any] | None = None,
          **more: Any) -> Path:  # fmt: skip
    """A file of these nodes, with skins of these joints and, of one clip at 30 frames per second, these keys."""
    buffer = Buffer()
    document: dict[str, Any] = {"asset": {"version": "2.0"}, "nodes": nodes, **more}
    if skins:
        document["skins"] = [{"joints": joints} for joints in skins]
    if tracks:
        channels, samplers = [], []
        for (node, what), values in tracks.items():
            times = buffer.add(np.arange(len(values)) / 30, "SCALAR", bounds=True)
            output = buffer.add(np.array(values), "VEC4" if what == "rotation" else "VEC3")
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": what}})
            samplers.append({"input": times, "output": output})
        document["animations"] = [{"channels": channels, "samplers": samplers}]
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    path.write_bytes(pack_glb(document, bytes(buffer.data)))
    return path


def test_several_roots_under_a_scaled_holder_with_one_name(tmp_path):
    nodes = [
        {"name": "Armature", "children": [1, 3], "scale": [0.01] * 3, "translation": [1, 0, 0]},
        {"name": "bone", "children": [2], "translation": [0, 100, 0]},
        {"name": "bone", "translation": [0, 50, 0]},
        {"name": "bone", "children": [4], "translation": [30, 0, 0], "rotation": [0, 0, HALF, HALF]},
        {"name": "tip", "translation": [10, 0, 0]},
    ]
    shift = [[30, 0, 0], [30, 0, 10], [30, 0, 20]]
    motion = read_gltf(write(tmp_path / "m.glb", nodes, [[1, 2, 3, 4]], {(3, "translation"): shift}))
    skeleton = motion.skeleton
    assert skeleton.names == ("bone", "bone.001", "bone.002", "tip") and skeleton.parents == (-1, -1, 0, 1)
    assert skeleton.roots == (0, 1) and skeleton.sliding == (1,) and len(motion) == 3
    expected = np.array([[[1, 1, 0], [1.3, 0, 0.1 * t], [1, 1.5, 0], [1.3, 0.1, 0.1 * t]] for t in range(3)])
    np.testing.assert_allclose(motion.joint_positions_world(), expected @ WORLD_FROM_GLTF.T, atol=1e-7)
    np.testing.assert_allclose(skeleton.offsets[1], [0.3, 0, -1.0], atol=1e-7)
    for path, writer, reader in (
        (tmp_path / "again.glb", write_glb, read_gltf), (tmp_path / "again.bvh", write_bvh, read_bvh),
    ):  # fmt: skip
        writer(path, motion)
        back = reader(path)
        order = [back.skeleton.index(name) for name in skeleton.names]
        np.testing.assert_allclose(back.joint_positions_world()[:, order], motion.joint_positions_world(), atol=2e-6)
        np.testing.assert_allclose(back.skeleton.rest_positions[order], skeleton.rest_positions, atol=2e-6)
        assert len(back.skeleton.roots) == 2


def test_skins_that_share_joints_are_one_skeleton_and_others_are_left_out(tmp_path):
    nodes = [
        {"name": "hips", "children": [1, 2]},
        {"name": "spine", "translation": [0, 1, 0], "children": [3]},
        {"name": "leg", "translation": [0, -1, 0]},
        {"name": "hair", "translation": [0, 1, 0]},
        {"name": "dog", "children": [5]},
        {"name": "tail", "translation": [0, 0, 1]},
    ]
    path = write(tmp_path / "m.glb", nodes, [[4, 5], [0, 1, 2], [1, 3]])
    take = read_gltf_take(path)
    assert take.motion.skeleton.names == ("hips", "spine", "leg", "hair")
    assert take.notices == ("m.glb: of 2 skeletons 'hips' was read, dog not",)


@pytest.mark.parametrize("suffix", [".vrm", ".vrma"])
def test_a_humanoid_without_a_skin(tmp_path, suffix):
    nodes = [
        {"name": "top", "children": [1, 4], "translation": [0, 1, 0]},
        {"name": "hips", "children": [2]},
        {"name": "between", "children": [3], "translation": [0, 0.5, 0]},
        {"name": "head", "translation": [0, 0.5, 0], "children": [5, 6]},
        {"name": "lamp", "mesh": 0},
        {"name": "hair", "translation": [0, 0.1, 0]},
        {"name": "hat", "translation": [0, 0.2, 0], "mesh": 0},
    ]
    extension = {"VRMC_vrm": {"humanoid": {"humanBones": {"hips": {"node": 1}, "head": {"node": 3}}}}}
    old = {"VRM": {"humanoid": {"humanBones": [{"bone": "hips", "node": 1}, {"bone": "head", "node": 3}]}}}
    for extensions in (extension, old):
        path = write(tmp_path / f"m{suffix}", nodes, [], extensions=extensions)
        motion = read_file(path).motion
        assert motion.skeleton.names == ("hips", "between", "head", "hair")
        np.testing.assert_allclose(motion.joint_positions_world()[0, :, 2], [1, 1.5, 2, 2.1], atol=1e-7)


def test_only_scales_above_joints_matter(tmp_path):
    nodes = [
        {"name": "hips", "children": [1]},
        {"name": "spine", "translation": [0, 1, 0], "scale": [1, 2, 1]},
        {"name": "prop", "scale": [-1, 1, 1]},
    ]
    assert len(read_gltf(write(tmp_path / "m.glb", nodes, [[0, 1]])).skeleton) == 2
    assert not read_gltf_take(tmp_path / "m.glb").notices


@pytest.mark.parametrize("linear", [np.diag([1.0, 1, -1]), np.diag([1.0, 2, 1]), [[1, 0.2, 0], [0, 1, 0], [0, 0, 2]]])
@pytest.mark.parametrize("how", ["matrix", "scale", "above"])
def test_joints_below_nodes_that_stretch_or_mirror_are_where_they_are(tmp_path, linear, how):
    linear = np.array(linear)
    nodes: list[dict] = [
        {"name": "hips", "children": [1]},
        {"name": "spine", "translation": [0.3, 1, 0.2], "rotation": [0.1, 0, 0, np.sqrt(0.99)], "children": [2]},
        {"name": "head", "translation": [0.1, 0.5, 0.2], "rotation": [0, 0, HALF, HALF]},
    ]
    turns = [[0, 0, 0, 1], [0, HALF, 0, HALF]]
    if how == "above":
        nodes.append({"name": "top", "children": [0]})
    top = nodes[-1 if how == "above" else 0]
    if how == "scale":
        linear = np.diag(np.diag(linear))
        top["scale"] = np.diag(linear).tolist()
    else:
        matrix = np.eye(4)
        matrix[:3, :3] = linear
        top["matrix"] = matrix.T.ravel().tolist()
    path = write(tmp_path / "m.glb", nodes, [[0, 1, 2]], {(1, "rotation"): turns})
    take = read_gltf_take(path)
    places = take.motion.joint_positions_world()
    for t, turn in enumerate(turns):
        spine = linear @ [0.3, 1, 0.2]
        head = spine + linear @ Rotation.from_quat(turn).apply([0.1, 0.5, 0.2])
        np.testing.assert_allclose(places[t, 1:], np.array([spine, head]) @ WORLD_FROM_GLTF.T, atol=1e-7)
    name = "node 3 (top)" if how == "above" else "node 0 (hips)"
    assert f"{name} stretches or mirrors what is below it" in take.notices[0]
    # A mirrored turn is a turn by the same angle.
    if abs(abs(np.linalg.det(linear)) - 1) < 1e-9:
        quats = take.motion.quat_wxyz[:, 1]
        first, second = Rotation.from_quat(np.roll(quats, -1, axis=-1))
        assert (first.inv() * second).magnitude() == pytest.approx(np.pi / 2, abs=1e-6)


def test_a_scale_that_changes_moves_what_is_below(tmp_path):
    nodes = [{"name": "hips", "children": [1]}, {"name": "spine", "translation": [0, 1, 0]}]
    motion = read_gltf(write(tmp_path / "m.glb", nodes, [[0, 1]], {(0, "scale"): [[1, 1, 1], [2, 2, 2]]}))
    np.testing.assert_allclose(motion.joint_positions_world()[:, 1, 2], [1, 2], atol=1e-7)
    assert motion.skeleton.sliding == (1,)


def test_sparse_keys_are_sampled_between_them(tmp_path):
    nodes = [{"name": "hips", "children": [1]}, {"name": "spine", "translation": [0, 1, 0]}]
    path = write(tmp_path / "m.glb", nodes, [[0, 1]], {(0, "translation"): [[0, 0, 0], [0, 0, 0], [3, 0, 0]]})
    assert read_gltf(path).fps == 30 and len(read_gltf(path)) == 3
    data = path.read_bytes()
    keys = np.arange(3, dtype="<f4") / np.float32(30)
    assert data.count(keys.tobytes()) == 1
    # Keys at 0, 0.7 and 1.4 s: 1.43 a second are no frames.
    path.write_bytes(data.replace(keys.tobytes(), (0.7 * np.arange(3)).astype("<f4").tobytes()))
    motion = read_gltf(path)
    assert motion.fps == pytest.approx(30.0) and len(motion) == 43
    np.testing.assert_allclose(motion.root_positions_world[[0, 21, 42], 0], [0, 0, 3], atol=1e-6)
    np.testing.assert_allclose(np.diff(motion.root_positions_world[21:, 0]), 3 / 21, atol=1e-5)


@pytest.mark.parametrize(("clip", "kept"), [(None, 0), ("second", 1), (1, 1)])
def test_a_file_of_animations_alone_is_read_by_clip(tmp_path: Path, clip: Any, kept: int) -> None:
    """As libraries of animations are: nodes and clips, no skin and no mesh."""
    motion = make_motion(6)
    write_glb(tmp_path / "m.glb", motion)
    document, binary = unpack(tmp_path / "m.glb")
    for key in ("skins", "meshes", "materials"):
        document.pop(key, None)
    for node in document["nodes"]:
        node.pop("skin", None)
        node.pop("mesh", None)
    first = document["animations"][0]
    short = {**first, "name": "second", "channels": [c for c in first["channels"] if c["target"]["path"] == "rotation"]}
    document["animations"] = [{**first, "name": "first"}, short]
    (tmp_path / "a.glb").write_bytes(pack_glb(document, binary))
    take = read_gltf_take(tmp_path / "a.glb", clip)
    assert take.motion is not None and set(motion.skeleton.names) <= set(take.motion.skeleton.names)
    moves = np.ptp(take.motion.root_positions_world, axis=0).max() > 0.1
    assert moves == (kept == 0)
    assert any("first of its 2 clips" in n for n in take.notices) == (clip is None)


def test_a_fox_whose_hips_move_under_its_root_keeps_them(tmp_path: Path) -> None:
    path = DATA / "cases" / "motion_hips_slide" / "Fox.glb"
    if not path.exists():
        pytest.skip(f"{path} is absent")
    motion = read_gltf(path, 0)
    assert motion.skeleton.sliding
    write_bvh(tmp_path / "fox.bvh", motion)
    back = read_bvh(tmp_path / "fox.bvh")
    order = [back.skeleton.index(n) for n in motion.skeleton.names]
    places = back.joint_positions_world()[:, order]
    np.testing.assert_allclose(places, motion.joint_positions_world(), rtol=0, atol=1e-4)
