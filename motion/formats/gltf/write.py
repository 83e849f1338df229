"""glTF 2.0: a skinned skeleton with its animation, as one `.glb` file; read from `.glb` and `.gltf`.

Metres, Y up, facing +Z at rest, as the specification has it: (x, y, z)_gltf = (x_world, z_world, -y_world). The file
has one node per joint, in the joint's own axes, with its rotation animated and, of a root and of joints that slide,
its translation; a skin with inverse bind matrices of the rest pose; and a mesh of one octahedron per bone, so that
any viewer shows something. Several roots are children of one node, since a skin needs a common root.

Source: Khronos Group, glTF 2.0 Specification, sections 3.7.3 (skins) and 3.11 (animations).
"""

from pathlib import Path
from typing import Any

import numpy as np

from muybridge import __version__
from muybridge.arrays import BoolArray, FloatArray
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.local_frames import motion_frames, own_axes, rest_frames
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.gltf.container import ARRAY_BUFFER, UNSIGNED_BYTE, UNSIGNED_SHORT, Buffer, pack_glb
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.take import Keys

GLTF_FROM_WORLD = BVH_FROM_WORLD
_BONE_COLOUR = [0.80, 0.62, 0.36, 1.0]


def write_glb(path: Path, motion: Motion, keys: Keys | None = None) -> None:
    """Write a motion with its skeleton and a mesh of its bones.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up; at least one frame.
        keys: frames that are written, where the motion between them is what interpolation gives; None: all.

    Raises:
        OutputError: the file cannot be written.
    """
    if not len(motion):
        raise ValueError("a motion without frames cannot be written: glTF's animations need a key")
    skeleton = motion.skeleton
    buffer = Buffer()
    rest = skeleton.rest_positions
    reach = np.concatenate([rest, (rest + skeleton.tips)[np.isfinite(skeleton.tips).all(axis=1)]])
    rest -= (0.0, 0.0, reach[:, 2].min())  # on the ground at rest
    nodes = joint_nodes(skeleton, rest)
    tops = list(skeleton.roots)
    if len(tops) > 1:
        nodes.append({"name": "skeleton", "children": tops})
        tops = [len(nodes) - 1]
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"muybridge {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [*tops, len(nodes)]}],
        "nodes": [*nodes, {"name": "bones", "mesh": 0, "skin": 0}],
        "meshes": [_mesh(skeleton, rest, buffer)],
        "materials": [
            {
                "name": "bone",
                "pbrMetallicRoughness": {
                    "baseColorFactor": _BONE_COLOUR,
                    "metallicFactor": 0.0,
                    "roughnessFactor": 0.7,
                },
            }
        ],
        "skins": [
            {
                "name": "skeleton",
                "skeleton": tops[0],
                "joints": list(range(len(skeleton))),
                "inverseBindMatrices": buffer.add(inverse_bind(skeleton, rest), "MAT4"),
            }
        ],
        "animations": [_animation(motion, buffer, keys)],
    }
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    data = pack_glb(document, bytes(buffer.data))
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def joint_nodes(skeleton: Skeleton, rest: FloatArray) -> list[dict[str, Any]]:
    """A node per joint at rest; `rest` (J, 3) has the positions in the world."""
    axes = own_axes(skeleton, GLTF_FROM_WORLD.T)
    turns, places = rest_frames(skeleton, GLTF_FROM_WORLD.T)
    nodes = []
    for j, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        place = GLTF_FROM_WORLD @ rest[j] if parent < 0 else places[j]
        node: dict[str, Any] = {"name": name, "translation": (place + 0.0).tolist()}
        if skeleton.axes is not None:
            node["rotation"] = np.roll(quat_from_matrix(turns[j]), -1).tolist()
        children = [k for k, p in enumerate(skeleton.parents) if p == j]
        if children:
            node["children"] = children
        elif np.isfinite(skeleton.tips[j]).all():
            node["extras"] = {"tip": (axes[j].T @ skeleton.tips[j] + 0.0).tolist()}
        nodes.append(node)
    return nodes


def inverse_bind(skeleton: Skeleton, rest: FloatArray) -> FloatArray:
    """(J, 16), column after column: joint from mesh where the joints are at rest."""
    out = np.tile(np.eye(4), (len(rest), 1, 1))
    out[:, :3, 3] = -rest @ GLTF_FROM_WORLD.T
    if skeleton.axes is not None:
        out[:, :3] = np.swapaxes(GLTF_FROM_WORLD @ skeleton.axes, 1, 2) @ out[:, :3]
    return np.asarray(np.swapaxes(out, 1, 2).reshape(-1, 16) + 0.0)


def _mesh(skeleton: Skeleton, rest: FloatArray, buffer: Buffer) -> dict[str, Any]:
    mesh = bone_mesh(skeleton)
    count = len(mesh.positions)
    joints = np.zeros((count, 4), dtype=np.int64)
    joints[:, 0] = mesh.joints
    weights = np.zeros((count, 4))
    weights[:, 0] = 1.0
    component = UNSIGNED_BYTE if len(skeleton) <= 256 else UNSIGNED_SHORT
    positions = (mesh.positions + rest[0]) @ GLTF_FROM_WORLD.T
    attributes = {
        "POSITION": buffer.add(positions, "VEC3", target=ARRAY_BUFFER, bounds=True),
        "NORMAL": buffer.add(mesh.normals @ GLTF_FROM_WORLD.T, "VEC3", target=ARRAY_BUFFER),
        "JOINTS_0": buffer.add(joints, "VEC4", component, target=ARRAY_BUFFER),
        "WEIGHTS_0": buffer.add(weights, "VEC4", target=ARRAY_BUFFER),
    }
    return {"name": "bones", "primitives": [{"attributes": attributes, "material": 0}]}


def _animation(motion: Motion, buffer: Buffer, keys: Keys | None) -> dict[str, Any]:
    skeleton = motion.skeleton
    turns, places = motion_frames(motion, GLTF_FROM_WORLD.T)
    if skeleton.axes is None:  # without a detour over matrices, which rounds
        xyzw = np.roll(continuous_quat(motion.quat_wxyz), -1, axis=-1)
        xyzw = xyzw / np.linalg.norm(xyzw, axis=-1, keepdims=True)
        xyzw[..., :3] = xyzw[..., :3] @ GLTF_FROM_WORLD.T
    else:
        xyzw = np.roll(continuous_quat(quat_from_matrix(turns)), -1, axis=-1)
    every = np.ones((len(motion), len(skeleton)), dtype=np.bool_)
    keys = keys or Keys(every, every[:, : 1 + len(skeleton.sliding)])
    times: dict[bytes, int] = {}
    channels: list[tuple[int, str, int, int]] = []

    def add(node: int, what: str, values: FloatArray, kept: BoolArray) -> None:
        mark = kept.tobytes()
        if mark not in times:
            times[mark] = buffer.add(np.flatnonzero(kept) / motion.fps, "SCALAR", bounds=True)
        kind = "VEC3" if what == "translation" else "VEC4"
        channels.append((node, what, times[mark], buffer.add(values[kept], kind)))

    add(0, "translation", motion.root_positions_world @ GLTF_FROM_WORLD.T, keys.positions[:, 0])
    for k, j in enumerate(skeleton.sliding, start=1):
        add(j, "translation", places[:, j], keys.positions[:, k])
    for j in range(len(skeleton)):
        add(j, "rotation", xyzw[:, j], keys.rotations[:, j])
    return {
        "name": "motion",
        "extras": {"fps": float(motion.fps)},
        "samplers": [{"input": time, "interpolation": "LINEAR", "output": output} for _, _, time, output in channels],
        "channels": [
            {"sampler": k, "target": {"node": node, "path": what}} for k, (node, what, _, _) in enumerate(channels)
        ],
    }
