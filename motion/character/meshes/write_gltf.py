"""A mesh with a new skeleton and its weights as one GLB or VRM file.

Vertices are written where they are at rest, so inverse bind matrices are those of the joints alone; materials,
textures and images are those of the mesh's own file.

Sources: Khronos Group, glTF 2.0 Specification, sections 3.7.3 (skins) and 3.9 (materials); VRM Consortium,
VRMC_vrm-1.0, humanoid and meta.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from muybridge import __version__
from muybridge.arrays import FloatArray, IntArray
from muybridge.files import replacing
from muybridge.motion.character.meshes.bound_mesh import BoundMesh
from muybridge.motion.character.meshes.static_mesh import Look, Surface
from muybridge.motion.formats.gltf.container import ARRAY_BUFFER, UNSIGNED_BYTE, UNSIGNED_SHORT, Buffer, pack_glb
from muybridge.motion.formats.gltf.write import GLTF_FROM_WORLD, inverse_bind, joint_nodes

_INDEX_BUFFER, _UNSIGNED_INT = 34963, 5125
_MOST = 4  # influences of a set of attributes
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


def write_skinned_glb(path: Path, bound: BoundMesh) -> None:
    """Write a mesh with its skeleton at rest, without animation; as a VRM where it has a humanoid.

    Args:
        path: the file to write; replaced only once it is complete.
        bound: the mesh and its skeleton.

    Raises:
        OutputError: the file cannot be written.
    """
    buffer, skeleton = Buffer(), bound.skeleton
    rest = skeleton.rest_positions + bound.root
    nodes = joint_nodes(skeleton, rest)
    tops = list(skeleton.roots)
    meshes: list[dict[str, Any]] = []
    drawn: list[dict[str, Any]] = []
    for name, surfaces in bound.objects():
        parts = [_part(buffer, s, bound.joints[at], bound.weights[at], len(skeleton)) for s, at in surfaces]
        entry: dict[str, Any] = {"name": name, "primitives": parts}
        morphs = surfaces[0][0].morphs
        if morphs and all("targets" in part for part in parts):
            entry |= {"weights": [0.0] * len(morphs), "extras": {"targetNames": [m.name for m in morphs]}}
        drawn.append({"name": name, "mesh": len(meshes), "skin": 0})
        meshes.append(entry)
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": f"muybridge {__version__}"},
        "scene": 0,
        "scenes": [{"nodes": [*tops, *range(len(nodes), len(nodes) + len(drawn))]}],
        "nodes": [*nodes, *drawn],
        "meshes": meshes,
        "skins": [{"name": "skeleton", "skeleton": tops[0], "joints": list(range(len(skeleton))),
                   "inverseBindMatrices": buffer.add(inverse_bind(skeleton, rest), "MAT4")}],
    }  # fmt: skip
    document |= _look(bound.mesh.look, buffer)
    if bound.humanoid is not None:
        _add_vrm(document, bound.humanoid, path.stem)
    document |= {"accessors": buffer.accessors, "bufferViews": buffer.views}
    document["buffers"] = [{"byteLength": len(buffer.data)}]
    data = pack_glb(document, bytes(buffer.data))
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def _part(buffer: Buffer, surface: Surface, joints: IntArray, weights: FloatArray, count: int) -> dict[str, Any]:
    """A primitive with its skin."""
    attributes = {"POSITION": buffer.add(surface.positions @ GLTF_FROM_WORLD.T, "VEC3", target=ARRAY_BUFFER,
                                         bounds=True)}  # fmt: skip
    if surface.normals is not None:
        normals = _unit(surface.normals) @ GLTF_FROM_WORLD.T
        attributes["NORMAL"] = buffer.add(normals, "VEC3", target=ARRAY_BUFFER)
    for name, values in surface.attributes.items():
        if name == "TANGENT":
            if surface.normals is None:
                continue
            values = np.concatenate([_unit(values[:, :3]) @ GLTF_FROM_WORLD.T, np.sign(values[:, 3:]) + 0.0], axis=1)
        attributes[name] = buffer.add(values, _KINDS[values.shape[1]], target=ARRAY_BUFFER)
    component = UNSIGNED_BYTE if count <= 256 else UNSIGNED_SHORT
    for k in range(0, joints.shape[1], _MOST):
        share = np.zeros((len(joints), _MOST), np.float32)
        share[:, : weights[:, k : k + _MOST].shape[1]] = weights[:, k : k + _MOST]
        own = np.zeros((len(joints), _MOST), np.int64)
        own[:, : joints[:, k : k + _MOST].shape[1]] = joints[:, k : k + _MOST]
        own[share == 0] = 0
        attributes[f"JOINTS_{k // _MOST}"] = buffer.add(own, "VEC4", component, target=ARRAY_BUFFER)
        attributes[f"WEIGHTS_{k // _MOST}"] = buffer.add(share, "VEC4", target=ARRAY_BUFFER)
    out: dict[str, Any] = {
        "attributes": attributes,
        "indices": buffer.add(surface.triangles.reshape(-1), "SCALAR", _UNSIGNED_INT, target=_INDEX_BUFFER),
    }
    if surface.material is not None:
        out["material"] = surface.material
    if surface.morphs:
        out["targets"] = [
            {"POSITION": buffer.add(m.offsets @ GLTF_FROM_WORLD.T, "VEC3", target=ARRAY_BUFFER, bounds=True)}
            for m in surface.morphs
        ]
    return out


def _unit(vectors: FloatArray) -> FloatArray:
    """(N, 3) of unit length; zero vectors become upright ones, as the format allows none."""
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(np.where(size > 1e-6, vectors / np.maximum(size, 1e-12), [0.0, 0.0, 1.0]))


def _look(look: Look, buffer: Buffer) -> dict[str, Any]:
    images = []
    for picture in look.pictures:
        buffer.data += b"\0" * (-len(buffer.data) % 4)
        buffer.views.append({"buffer": 0, "byteOffset": len(buffer.data), "byteLength": len(picture.data)})
        buffer.data += picture.data
        images.append({"name": picture.name, "mimeType": picture.kind, "bufferView": len(buffer.views) - 1})
    named = {"materials": look.materials, "textures": look.textures, "samplers": look.samplers, "images": images,
             "extensionsUsed": look.extensions, "extensionsRequired": look.required}  # fmt: skip
    return {key: list(values) for key, values in named.items() if values}


def _add_vrm(document: dict[str, Any], humanoid: Mapping[str, int], name: str) -> None:
    """What makes a glTF a VRM 1.0: who is who among the nodes, and the licence, which its author has to set."""
    document["extensionsUsed"] = [*document.get("extensionsUsed", []), "VRMC_vrm"]
    document["extensions"] = {
        "VRMC_vrm": {
            "specVersion": "1.0",
            "meta": {"name": name, "authors": ["unknown"], "licenseUrl": "https://vrm.dev/licenses/1.0/"},
            "humanoid": {"humanBones": {bone: {"node": node} for bone, node in humanoid.items()}},
        }
    }
