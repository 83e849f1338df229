"""Real characters and recordings: read with all their joints, and written again without moving one of them.

The glTF files are evaluated independently: the products of 4 x 4 matrices of the JSON's own nodes and keys.
"""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.fbx.container import read_fbx_nodes
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.read import clip_names, read_gltf, read_gltf_take
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.registry import ReadOptions, read_file
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from tests.paths import DATA

CHARACTERS, MOTION = DATA / "characters", DATA / "motion"
WORLD_FROM_GLTF = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
# file: (joints, roots, clips, kind of clip to follow)
FILES = {
    "kaykit_knight.glb": (41, ("root",), 76, ("1H_Melee_Attack_Chop", "Death_B", "Walking_A", "T-Pose")),
    "kenney_character.glb": (7, ("root",), 4, ("static", "idle", "walk", "jump")),
    "mesh2motion_female.glb": (66, ("root",), 0, (None,)),
    "mesh2motion_bunny.glb": (66, ("root",), 0, (None,)),
    "mesh2motion_dog.glb": (48, ("root",), 0, (None,)),
    "mesh2motion_fox_animations.glb": (49, ("root",), 14, ("Bark", "Death", "Howl")),
    "vrmc_mtoon_test.vrm": (53, ("hips",), 0, (None,)),
    "three_vrm_test.vrma": (51, ("hips",), 1, ("animation_0",)),
}


def real(path: Path) -> Path:
    if not path.is_file():
        pytest.skip(f"{path} is absent: shared real data is not part of a checkout")
    return path


def load(path: Path) -> tuple[dict, bytes]:
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data), b""
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[28 + size :]


def array(document: dict, binary: bytes, index: int) -> np.ndarray:
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    dtype = np.dtype({5126: "<f4", 5121: "<u1", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]])
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
    assert "byteStride" not in view and not accessor.get("normalized")
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    return np.frombuffer(binary, dtype, accessor["count"] * width, start).reshape(-1, width).astype(float)


def value(keys: np.ndarray, values: np.ndarray, kind: str, time: float, rotation: bool) -> np.ndarray:
    time = min(max(time, keys[0]), keys[-1])
    if kind == "STEP" or len(keys) == 1:
        return values[max(int(np.searchsorted(keys, time + 1e-6, side="right")) - 1, 0)]
    assert kind == "LINEAR"
    if rotation:
        return Slerp(keys, Rotation.from_quat(values))(time).as_quat()
    return np.array([np.interp(time, keys, column) for column in values.T])


def places(path: Path, names: tuple[str, ...], clip: int | None, times: np.ndarray) -> np.ndarray:
    """(T, J, 3) in our world, metres: where the nodes of these names are at these times of a clip."""
    document, binary = load(path)
    nodes = document["nodes"]
    parents = {child: i for i, node in enumerate(nodes) for child in node.get("children", [])}
    tracks = {}
    if clip is not None:
        animation = document["animations"][clip]
        for channel in animation["channels"]:
            sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
            if target["path"] != "weights":
                tracks[target["node"], target["path"]] = (
                    array(document, binary, sampler["input"])[:, 0], array(document, binary, sampler["output"]),
                    sampler.get("interpolation", "LINEAR"),
                )  # fmt: skip

    def local(n: int, time: float) -> np.ndarray:
        node = nodes[n]
        if "matrix" in node:
            return np.array(node["matrix"]).reshape(4, 4).T
        parts = {}
        for what, usual in (("translation", [0, 0, 0]), ("rotation", [0, 0, 0, 1]), ("scale", [1, 1, 1])):
            parts[what] = np.array(node.get(what, usual), float)
            if (n, what) in tracks:
                parts[what] = value(*tracks[n, what], time, what == "rotation")
        out = np.eye(4)
        out[:3, :3] = Rotation.from_quat(parts["rotation"]).as_matrix() @ np.diag(parts["scale"])
        out[:3, 3] = parts["translation"]
        return out

    out = np.zeros((len(times), len(names), 3))
    index = {node.get("name"): i for i, node in enumerate(nodes)}
    for t, time in enumerate(times):
        known: dict[int, np.ndarray] = {}

        def world(n: int, time: float = time, known: dict[int, np.ndarray] = known) -> np.ndarray:
            if n not in known:
                above = world(parents[n]) if n in parents else np.eye(4)
                known[n] = above @ local(n, time)
            return known[n]

        out[t] = [world(index[name])[:3, 3] for name in names]
    return out @ WORLD_FROM_GLTF.T


def first_key(path: Path, clip: int, names: tuple[str, ...]) -> float:
    document, binary = load(path)
    animation = document["animations"][clip]
    of = {document["nodes"][c["target"]["node"]].get("name"): c for c in animation["channels"]}
    assert set(of) & set(names)
    inputs = {animation["samplers"][c["sampler"]]["input"] for c in animation["channels"]
              if document["nodes"][c["target"]["node"]].get("name") in names}  # fmt: skip
    return min(array(document, binary, i)[0, 0] for i in inputs)


def same_places(back: Motion, motion: Motion) -> float:
    order = [back.skeleton.index(n) for n in motion.skeleton.names]
    assert len(back) == len(motion) and back.fps == pytest.approx(motion.fps, rel=1e-6)
    return float(np.abs(back.joint_positions_world()[:, order] - motion.joint_positions_world()).max())


@pytest.mark.parametrize("name", FILES)
def test_characters_are_read_with_all_their_joints(tmp_path, name):
    path = real(CHARACTERS / name)
    joints, roots, clips, followed = FILES[name]
    assert len(clip_names(path)) == clips
    for clip in followed:
        take = read_gltf_take(path, clip)
        motion = take.motion
        skeleton = motion.skeleton
        assert len(skeleton) == joints and tuple(skeleton.names[r] for r in skeleton.roots) == roots
        number = None if clip is None else clip_names(path).index(clip)
        start = 0.0 if number is None else first_key(path, number, skeleton.names)
        truth = places(path, skeleton.names, number, start + np.arange(len(motion)) / motion.fps)
        np.testing.assert_allclose(motion.joint_positions_world(), truth, atol=1e-5, err_msg=str(clip))
        # Written and read again, and the file that was written, evaluated by itself.
        write_glb(tmp_path / "again.glb", motion)
        assert same_places(read_gltf(tmp_path / "again.glb"), motion) < 1e-5
        times = np.arange(len(motion)) / motion.fps
        np.testing.assert_allclose(places(tmp_path / "again.glb", skeleton.names, 0, times), truth, atol=1e-5)


def test_every_joint_of_a_skin_is_a_joint(tmp_path):
    for name in ("kaykit_knight.glb", *(f"mesh2motion_{n}.glb" for n in ("female", "dog", "fox_animations"))):
        path = real(CHARACTERS / name)
        document, _ = load(path)
        bound = {document["nodes"][n]["name"] for n in document["skins"][0]["joints"]}
        assert set(read_gltf(path).skeleton.names) == bound


def test_a_humanoid_s_bones_are_its_joints():
    for name, extension in (("vrmc_mtoon_test.vrm", "VRMC_vrm"), ("three_vrm_test.vrma", "VRMC_vrm_animation")):
        path = real(CHARACTERS / name)
        document, _ = load(path)
        bones = document["extensions"][extension]["humanoid"]["humanBones"]
        bound = {document["nodes"][b["node"]]["name"] for b in bones.values()}
        assert set(read_file(path).motion.skeleton.names) == bound


def test_a_root_bone_over_moving_hips():
    path = real(CHARACTERS / "kaykit_knight.glb")
    motion = read_gltf(path, "Walking_A")
    skeleton = motion.skeleton
    hips = skeleton.index("hips")
    assert skeleton.names[skeleton.parents[hips]] == "root" and hips in skeleton.sliding
    assert np.ptp(motion.joint_positions_world()[:, hips], axis=0).max() > 0.01
    assert np.ptp(motion.root_positions_world, axis=0).max() < 1e-6
    # The controls of the feet hang below the root too, not below the hips.
    assert len([j for j, p in enumerate(skeleton.parents) if p == 0]) > 5


@pytest.mark.parametrize("suffix", [".bvh", ".fbx"])
@pytest.mark.parametrize(
    ("name", "clip"), [("kaykit_knight.glb", "Walking_A"), ("mesh2motion_fox_animations.glb", "Death")]
)
def test_rigs_as_bvh_and_fbx(tmp_path, name, clip, suffix):
    motion = read_gltf(real(CHARACTERS / name), clip)
    path = tmp_path / f"m{suffix}"
    if suffix == ".bvh":
        write_bvh(path, motion)
        back = read_bvh(path)
    else:
        write_fbx(path, motion)
        back, _ = read_fbx(path)
        order = [back.skeleton.index(n) for n in motion.skeleton.names]
        np.testing.assert_allclose(back.skeleton.axes[order], motion.skeleton.axes, atol=1e-9)
        np.testing.assert_allclose(back.joint_frames()[:, order], motion.joint_frames(), atol=1e-5)
    assert back.skeleton.sliding and same_places(back, motion) < 1e-5


def test_a_clip_is_chosen_through_the_options():
    path = real(CHARACTERS / "kaykit_knight.glb")
    assert len(read_file(path, ReadOptions(clip="Walking_A")).motion) == len(read_gltf(path, "Walking_A"))
    with pytest.raises(FormatError, match="has no clip 'Fly'; its clips are: 0 '1H_Melee_Attack_Chop', .*75 'Walking"):
        read_file(path, ReadOptions(clip="Fly"))


def test_formats_that_need_rigid_bones_refuse_a_sliding_rig(tmp_path):
    from muybridge.motion.formats.registry import write_file

    take = read_file(real(CHARACTERS / "kaykit_knight.glb"))
    for suffix in (".amc", ".mot"):
        with pytest.raises(FormatError, match=r"slides by \d+\.\d mm against its parent.*write .glb, .fbx or .bvh"):
            write_file(tmp_path / f"m{suffix}", take)
        assert not list(tmp_path.iterdir())


def joints_in(path: Path) -> int:
    """How many joints a recording's file lists, by its own words."""
    if path.suffix == ".bvh":
        words = path.read_text().split()
        return words.count("ROOT") + words.count("JOINT")
    if path.suffix == ".amc":
        asf = path.with_name(f"{path.name.split('_')[0]}.asf").read_text()
        return 1 + asf.split(":bonedata")[1].split(":hierarchy")[0].split().count("begin")
    (objects,) = read_fbx_nodes(path).all("Objects")
    limbs = [m for m in objects.all("Model") if m.properties[2] in ("LimbNode", "Root")]
    names = [str(m.properties[1]).split("\x00")[0] for m in limbs]
    return sum(not name.endswith(("_End", "_end", "_Nub")) for name in names)


@pytest.mark.parametrize("name", ["01_01.bvh", "01_01.amc", "02_01.amc", "02_03.amc", "cmu_91_48.fbx"])
def test_recordings_are_read_with_all_their_joints(name):
    path = real(MOTION / name)
    motion = read_file(path).motion
    assert len(motion.skeleton) == joints_in(path) > 30
    assert len(motion.skeleton.roots) == 1 and len(motion) > 100 and not motion.skeleton.sliding
