"""Meshes of OBJ, PLY and STL files, read by trimesh; materials and textures of an OBJ's MTL file."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.motion.character.meshes.static_mesh import Look, Picture, StaticMesh, Surface

_KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
_OPAQUE = 0.999


def read_table_mesh(path: Path) -> StaticMesh:
    """The surfaces of an OBJ, PLY or STL file; called within `parsing`.

    Values of vertices other than places, normals, colours and texture coordinates are left out.

    Raises:
        MuybridgeError: trimesh is not installed.
        FormatError: it holds no faces.
    """
    try:
        import trimesh
    except ImportError:
        raise MuybridgeError(f"{path}: reading {path.suffix.lower()} files needs trimesh", remedy="character_extra") \
            from None  # fmt: skip
    scene = trimesh.load_scene(path, process=False, maintain_order=True)
    look, numbers, notices = _read_mtl(path) if path.suffix.lower() == ".obj" else (Look(), {}, [])
    surfaces = []
    for name, part in scene.geometry.items():
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            continue
        matrix, _ = scene.graph.get(next(n for n in scene.graph.nodes_geometry if scene.graph[n][1] == name))
        surfaces.append(_surface(str(name), part, matrix, numbers))
    if not surfaces:
        raise FormatError(f"{path}: holds no faces, so there is nothing to rig", remedy="mesh_faces")
    return StaticMesh(path, tuple(surfaces), look, False, tuple(notices))


def _surface(name: str, part: Any, matrix: FloatArray, numbers: dict[str, int]) -> Surface:
    attributes: dict[str, FloatArray] = {}
    uv = getattr(part.visual, "uv", None)
    if uv is not None and len(uv) == len(part.vertices):
        attributes["TEXCOORD_0"] = np.asarray(uv, float) * [1, -1] + [0, 1]
    if part.visual.kind == "vertex":
        attributes["COLOR_0"] = np.asarray(part.visual.vertex_colors, float) / 255
    normals = np.asarray(part.vertex_normals, float) if "vertex_normals" in part._cache else None
    material = getattr(getattr(part.visual, "material", None), "name", None)
    points = np.asarray(part.vertices, float) @ matrix[:3, :3].T + matrix[:3, 3]
    return Surface(name, points, np.asarray(part.faces, np.int64), normals, attributes,
                   numbers.get(str(material)) if material is not None else None)  # fmt: skip


def _read_mtl(path: Path) -> tuple[Look, dict[str, int], list[str]]:
    """The materials of an OBJ, their numbers by name, and notices."""
    names = [line.split(None, 1)[1].strip() for line in _lines(path, b"mtllib")]
    materials: list[dict[str, Any]] = []
    numbers: dict[str, int] = {}
    pictures: list[Picture] = []
    notices: list[str] = []
    for file in (path.parent / name for name in names):
        if not file.is_file():
            notices.append(f"{path.name}: its materials {file.name} were not found")
            continue
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.strip().partition(" ")
            if key == "newmtl":
                numbers[value.strip()] = len(materials)
                look = {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8}
                materials.append({"name": value.strip(), "pbrMetallicRoughness": look, "doubleSided": True})
            elif materials:
                _set(materials[-1], key.lower(), value.split(), file, pictures, notices)
    textures = tuple({"source": k} for k in range(len(pictures)))
    return Look(tuple(materials), textures, (), tuple(pictures)), numbers, notices


def _lines(path: Path, word: bytes) -> list[str]:
    with path.open("rb") as file:
        return [line.decode("utf-8", "replace") for line in file if line.startswith(word + b" ")]


def _set(material: dict[str, Any], key: str, words: list[str], file: Path, pictures: list[Picture],
         notices: list[str]) -> None:  # fmt: skip
    """One line of an MTL."""
    look = material["pbrMetallicRoughness"]
    if key == "kd" and len(words) >= 3:
        look["baseColorFactor"][:3] = [_linear(float(w)) for w in words[:3]]
    elif key == "d" and words or key == "tr" and words:
        alpha = float(words[-1]) if key == "d" else 1.0 - float(words[-1])
        look["baseColorFactor"][3] = alpha
        if alpha < _OPAQUE:
            material["alphaMode"] = "BLEND"
    elif key in ("map_kd", "norm") and words:
        picture = read_picture(file.parent / words[-1].replace("\\", "/"))
        if picture is None:
            notices.append(f"{file.name}: its texture {words[-1]} was not found or is no image")
            return
        if picture not in pictures:
            pictures.append(picture)
        texture = {"index": pictures.index(picture)}
        if key == "norm":
            material["normalTexture"] = texture
        else:
            look["baseColorTexture"] = texture
            look["baseColorFactor"][:3] = [1.0, 1.0, 1.0]


def _linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else float(((value + 0.055) / 1.055) ** 2.4)


def read_picture(path: Path) -> Picture | None:
    """An image as PNG or JPEG, which are those that glTF holds; others are converted. None where it is no image."""
    if not path.is_file():
        return None
    if kind := _KINDS.get(path.suffix.lower()):
        return Picture(path.name, path.read_bytes(), kind)
    from PIL import Image, UnidentifiedImageError

    out = io.BytesIO()
    try:
        Image.open(path).save(out, "PNG")
    except (UnidentifiedImageError, OSError):
        return None
    return Picture(path.stem + ".png", out.getvalue(), "image/png")
