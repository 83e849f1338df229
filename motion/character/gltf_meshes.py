"""The meshes and materials of a glTF file, as parts of a character.

Source: Khronos Group, glTF 2.0 Specification, sections 3.7 (geometry), 3.7.3 (skins) and 3.9 (materials).
"""

import base64
from typing import Any
from urllib.parse import unquote

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.character import Material, Mesh, Morph
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.nodes import path_to
from muybridge.motion.formats.gltf.rig import Rig, inverse_binds
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
WORLD_FROM_GLTF = np.eye(4)
WORLD_FROM_GLTF[:3, :3] = BVH_FROM_WORLD.T


def read_meshes(rig: Rig, linear: FloatArray, places: FloatArray) -> tuple[list[Mesh], list[str]]:
    """The meshes that follow the rig's joints, and notices of those that do not or cannot be read.

    Args:
        rig: of the file.
        linear: (J, 3, 3) scene from joint at rest, with the scales of the nodes.
        places: (J, 3) the joints in the scene at rest.
    """
    document, order = rig.document, rig.choice.order
    place = {n: i for i, n in enumerate(order)}
    out: list[Mesh] = []
    still, packed = [], False
    for n, raw in enumerate(document.json["nodes"]):
        if "mesh" not in raw:
            continue
        skin = document.json["skins"][raw["skin"]] if "skin" in raw and document.json.get("skins") else None
        holder = next((m for m in path_to(rig.nodes, n)[::-1] if m in place), None)
        if skin is not None and not any(skin is s for s in rig.choice.skins) or skin is None and holder is None:
            still.append(rig.nodes[n].name)
            continue
        scene_from_mesh, bind, palette = (
            _skinned(rig, skin, linear) if skin is not None else _hung(rig, n, holder, linear, places)
        )
        mesh = document.json["meshes"][raw["mesh"]]
        weights = raw.get("weights", mesh.get("weights", []))
        for part in mesh["primitives"]:
            if "KHR_draco_mesh_compression" in (part.get("extensions") or {}):
                packed = True
            elif part.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN):
                name = str(mesh.get("name") or rig.nodes[n].name)
                out.append(_part(document, part, name, mesh, weights, scene_from_mesh, bind, palette, skin is None))
    notices = []
    if still:
        notices.append(f"{document.path.name}: {len(still)} meshes hang on no joint and stay as they are "
                       f"({', '.join(still[:3])})")  # fmt: skip
    if packed:
        notices.append(f"{document.path.name}: its meshes are compressed by Draco and were not read; its skeleton "
                       "was. To see them, and to plant feet on its own soles, export it without Draco")  # fmt: skip
    return out, notices


def _skinned(rig: Rig, skin: dict[str, Any], linear: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """World from mesh as bound, (J, 4, 4) joints from it, and the skin's joints among the skeleton's."""
    number = next(k for k, s in enumerate(rig.choice.skins) if s is skin)
    world_from_mesh = WORLD_FROM_GLTF @ rig.meshes_bound[number]
    back = np.linalg.inv(world_from_mesh)
    order = rig.choice.order
    bind = np.tile(np.eye(4), (len(order), 1, 1))
    for n, matrix in inverse_binds(rig.document, skin).items():
        if n in order:
            bind[order.index(n)] = _turned(linear[order.index(n)]) @ matrix @ back
    return world_from_mesh, bind, np.array([order.index(n) for n in skin["joints"]], np.int64)


def _hung(
    rig: Rig, n: int, holder: int | None, linear: FloatArray, places: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """The same of a mesh without skin, on the joint above it."""
    assert holder is not None
    order = rig.choice.order
    path = path_to(rig.nodes, n)
    joint_from_mesh = np.eye(4)
    for m in path[path.index(holder) + 1 :]:
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = rig.nodes[m].linear, rig.nodes[m].translation
        joint_from_mesh = joint_from_mesh @ step
    at = order.index(holder)
    at_rest = np.eye(4)
    at_rest[:3, :3], at_rest[:3, 3] = linear[at], places[at]
    world_from_mesh = WORLD_FROM_GLTF @ at_rest @ joint_from_mesh
    bind = np.tile(np.eye(4), (len(order), 1, 1))
    bind[at] = _turned(linear[at]) @ joint_from_mesh @ np.linalg.inv(world_from_mesh)
    return world_from_mesh, bind, np.array([at], np.int64)


def _turned(linear: FloatArray) -> FloatArray:
    """(4, 4) a joint's frame with the world's axes from the joint's own frame and size."""
    out = np.eye(4)
    out[:3, :3] = WORLD_FROM_GLTF[:3, :3] @ linear
    return out


def _part(
    document: Document, part: dict[str, Any], name: str, mesh: dict[str, Any], morph_weights: list[float],
    world_from_mesh: FloatArray, bind: FloatArray, palette: IntArray, rigid: bool,
) -> Mesh:  # fmt: skip
    attributes = part["attributes"]
    turn, shift = world_from_mesh[:3, :3], world_from_mesh[:3, 3]
    positions = document.accessor(attributes["POSITION"])
    joints, weights = np.full((len(positions), 1), palette[0]), np.ones((len(positions), 1))
    if not rigid and "JOINTS_0" in attributes:
        sets = range(sum(key.startswith("JOINTS_") for key in attributes))
        own = np.concatenate([document.accessor(attributes[f"JOINTS_{k}"]) for k in sets], axis=1).astype(np.int64)
        weights = np.concatenate([document.accessor(attributes[f"WEIGHTS_{k}"]) for k in sets], axis=1)
        if own.max(initial=0) >= len(palette) or own.shape != weights.shape or len(own) != len(positions):
            raise document.error(f"the joints and weights of the mesh {name!r} do not fit together")
        total = weights.sum(axis=1, keepdims=True)
        weights = np.where(total > 0, weights / np.where(total > 0, total, 1.0), np.eye(weights.shape[1])[0])
        joints = palette[own]
    normals = None
    if "NORMAL" in attributes:
        normals = document.accessor(attributes["NORMAL"]) @ np.linalg.inv(turn)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        normals *= np.sign(np.linalg.det(turn)) or 1.0
    names = mesh["extras"].get("targetNames", []) if isinstance(mesh.get("extras"), dict) else []
    morphs = [
        Morph(str(names[k]) if k < len(names) else f"morph_{k}", document.accessor(target["POSITION"]) @ turn.T)
        for k, target in enumerate(part.get("targets", [])) if "POSITION" in target
    ]  # fmt: skip
    return Mesh(
        name, positions @ turn.T + shift,
        read_triangles(document, part, len(positions), bool(np.linalg.det(turn) < 0)), joints, weights, bind, normals,
        document.accessor(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None, tuple(morphs),
        np.array([*morph_weights, *[0.0] * len(morphs)][: len(morphs)], float), part.get("material"), rigid,
    )  # fmt: skip


def read_triangles(document: Document, part: dict[str, Any], count: int, mirrored: bool) -> IntArray:
    """(F, 3) vertices of a primitive, `count` of which there are, turned round where its node mirrors it."""
    corners = document.accessor(part["indices"])[:, 0].astype(np.int64) if "indices" in part else np.arange(count)
    if corners.max(initial=-1) >= count:
        raise document.error(f"a mesh refers to vertex {corners.max()} of {count}")
    mode = part.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        out = corners[: len(corners) // 3 * 3].reshape(-1, 3)
    elif mode == _FAN:
        out = np.stack([np.full(max(len(corners) - 2, 0), corners[0]), corners[1:-1], corners[2:]], axis=1)
    else:
        k = np.arange(max(len(corners) - 2, 0))
        out = corners[np.stack([k, k + 1 + k % 2, k + 2 - k % 2], axis=1)]
    return np.asarray(out[:, ::-1] if mirrored else out)


def read_materials(document: Document) -> tuple[Material, ...]:
    """The materials of a file, with the images that it holds itself."""
    return tuple(_material(document, i, raw) for i, raw in enumerate(document.json.get("materials") or []))


def _material(document: Document, number: int, raw: dict[str, Any]) -> Material:
    look = raw.get("pbrMetallicRoughness") or {}
    image, kind = None, ""
    if "baseColorTexture" in look:
        texture = document.json["textures"][look["baseColorTexture"]["index"]]
        source = texture.get("source")
        for extension in (texture.get("extensions") or {}).values():
            source = extension.get("source", source) if isinstance(extension, dict) and source is None else source
        if source is not None:
            image, kind = read_image(document, document.json["images"][source])
    colour = np.array(look.get("baseColorFactor", [1, 1, 1, 1]), float)
    if colour.shape != (4,):
        raise document.error(f"the colour of material {number} is not four numbers")
    return Material(str(raw.get("name") or f"material_{number}"), colour, image, kind,
                    bool(raw.get("doubleSided")))  # fmt: skip


def read_image(document: Document, raw: dict[str, Any]) -> tuple[bytes | None, str]:
    """The bytes of an image and its media type; None where it cannot be found."""
    if "bufferView" in raw:
        return document.view(raw["bufferView"]), str(raw.get("mimeType", ""))
    uri = str(raw.get("uri", ""))
    if uri.startswith("data:"):
        head, _, text = uri.partition(",")
        return base64.b64decode(text), head[5:].partition(";")[0]
    beside = document.path.parent / unquote(uri)
    kind = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}.get(beside.suffix.lower(), "")
    return (beside.read_bytes(), kind) if kind and beside.is_file() else (None, "")
