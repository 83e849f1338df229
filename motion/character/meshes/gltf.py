"""The mesh of a glTF file without a skin: its nodes' transforms applied, its materials kept to the letter.

Source: Khronos Group, glTF 2.0 Specification, sections 3.5 (nodes), 3.7 (geometry) and 3.9 (materials).
"""

import copy
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.character import Morph
from muybridge.motion.character.gltf_meshes import WORLD_FROM_GLTF, read_image, read_triangles
from muybridge.motion.character.meshes.static_mesh import Look, Picture, StaticMesh, Surface
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.gltf.nodes import Node, read_nodes

# Extensions that concern the container or the geometry, which is written anew.
_OF_GEOMETRY = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
                "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "KHR_materials_variants",
                "KHR_lights_punctual")  # fmt: skip
_KEPT = ("TEXCOORD_", "COLOR_")
_MODES = (4, 5, 6)


def read_gltf_mesh(path: Path) -> StaticMesh:
    """The surfaces of all nodes of a file's scene, none of one with a skin; called within `parsing`.

    Raises:
        FormatError: its geometry is compressed by Draco.
    """
    document = Document(path)
    raw_nodes = document.json.get("nodes") or []
    if any("skin" in node for node in raw_nodes) and document.json.get("skins"):
        return StaticMesh(path, (), skinned=True)
    nodes = read_nodes(document) if raw_nodes else []
    surfaces: list[Surface] = []
    for n, matrix in _placed(document, nodes).items():
        mesh = document.json["meshes"][raw_nodes[n]["mesh"]] if "mesh" in raw_nodes[n] else {"primitives": []}
        for part in mesh["primitives"]:
            if "KHR_draco_mesh_compression" in (part.get("extensions") or {}):
                raise document.error("its meshes are compressed by Draco, which is not read", "plain_gltf")
            if part.get("mode", 4) in _MODES and "POSITION" in part["attributes"]:
                surfaces.append(_surface(document, part, str(mesh.get("name") or nodes[n].name), matrix))
    notices = []
    if document.json.get("animations"):
        notices.append(f"{path.name}: its animations move no skeleton and were left out")
    return StaticMesh(path, tuple(surfaces), _look(document, notices), True, tuple(notices))


def _placed(document: Document, nodes: list[Node]) -> dict[int, FloatArray]:
    """(4, 4) world from each node of the scene."""
    scenes = document.json.get("scenes") or []
    tops = scenes[document.json.get("scene", 0)].get("nodes", []) if scenes else \
        [n for n, node in enumerate(nodes) if node.parent < 0]  # fmt: skip
    out: dict[int, FloatArray] = {}
    waiting = [(n, WORLD_FROM_GLTF) for n in tops]
    while waiting:
        n, above = waiting.pop()
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = nodes[n].linear, nodes[n].translation
        out[n] = above @ step
        waiting += [(c, out[n]) for c in document.json["nodes"][n].get("children", [])]
    return dict(sorted(out.items()))


def _surface(document: Document, part: dict[str, Any], name: str, matrix: FloatArray) -> Surface:
    attributes, turn = part["attributes"], matrix[:3, :3]
    positions = document.accessor(attributes["POSITION"])
    mirrored = bool(np.linalg.det(turn) < 0)
    kept = {k: document.accessor(i) for k, i in attributes.items() if k.startswith(_KEPT)}
    if "TANGENT" in attributes:
        values = document.accessor(attributes["TANGENT"])
        along = _unit(values[:, :3] @ turn.T)
        kept["TANGENT"] = np.concatenate([along, values[:, 3:] * (-1.0 if mirrored else 1.0)], axis=1)
    normals = None
    if "NORMAL" in attributes:
        normals = _unit(document.accessor(attributes["NORMAL"]) @ np.linalg.pinv(turn))
    morphs = [Morph(f"morph_{k}", document.accessor(target["POSITION"]) @ turn.T)
              for k, target in enumerate(part.get("targets", [])) if "POSITION" in target]  # fmt: skip
    triangles = read_triangles(document, part, len(positions), mirrored)
    return Surface(name, positions @ turn.T + matrix[:3, 3], triangles, normals, kept, part.get("material"),
                   tuple(morphs))  # fmt: skip


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _look(document: Document, notices: list[str]) -> Look:
    """Materials, textures and samplers as they are, images by their bytes."""
    own = document.json
    pictures = []
    for k, raw in enumerate(own.get("images") or []):
        data, kind = read_image(document, raw)
        if data is None:
            notices.append(f"{document.path.name}: its image {raw.get('uri', k)!r} was not found and is left out")
            data = b""
        pictures.append(Picture(str(raw.get("name") or Path(str(raw.get("uri", "")[:60])).name or f"image_{k}"),
                                data, kind))  # fmt: skip
    textures, pictures, lost = _found(copy.deepcopy(own.get("textures") or []), pictures)
    names = [tuple(e for e in own.get(key) or [] if e not in _OF_GEOMETRY)
             for key in ("extensionsUsed", "extensionsRequired")]  # fmt: skip
    materials = _without(copy.deepcopy(own.get("materials") or []), lost)
    samplers = copy.deepcopy(own.get("samplers") or [])
    return Look(tuple(materials), tuple(textures), tuple(samplers), tuple(pictures), names[0], names[1])


def _found(textures: list[Any], pictures: list[Picture]) -> tuple[list[Any], list[Picture], set[int]]:
    """Textures and pictures without the pictures that have no bytes, and the numbers of textures that are left bare.

    glTF allows no image without bytes. Textures keep their numbers; extensions may name further pictures of them.
    """
    number = {k: n for n, k in enumerate(k for k, picture in enumerate(pictures) if picture.data)}
    lost = set()
    for k, texture in enumerate(textures):
        extensions = texture.pop("extensions", None) or {}
        sources = [texture, *(e for e in extensions.values() if isinstance(e, dict))]
        for named in sources:
            source = named.pop("source", None)
            if source in number:
                named["source"] = number[source]
        if any(extensions.values()):
            texture["extensions"] = {name: e for name, e in extensions.items() if e}
        if not any("source" in named for named in sources):
            lost.add(k)
    return textures, [picture for picture in pictures if picture.data], lost


def _without(value: Any, lost: set[int]) -> Any:
    """Materials without what refers to textures that are lost."""
    if isinstance(value, list):
        return [_without(one, lost) for one in value]
    if not isinstance(value, dict):
        return value
    return {
        key: _without(one, lost) for key, one in value.items()
        if not (key.endswith("Texture") and isinstance(one, dict) and one.get("index") in lost)
    }  # fmt: skip
