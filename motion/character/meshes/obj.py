"""Meshes of Wavefront OBJ files with the materials and textures of their MTL files.

Corners with the same place, texture coordinate and normal become one vertex; polygons become fans; lines, curves and
smoothing groups are left out.
"""

import codecs
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import FormatError
from muybridge.motion.character.meshes.static_mesh import Look, Picture, StaticMesh, Surface

_KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg"}  # by the first bytes
_OPAQUE = 0.999


def read_obj_mesh(path: Path) -> StaticMesh:
    """The surfaces of an OBJ, one a material; called within `parsing`.

    Raises:
        FormatError: it holds no faces, or they refer to what is not there.
    """
    data = path.read_bytes()
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):  # as Windows' Notepad and PowerShell save text
        data = data.decode("utf-16").encode()
    data = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").replace(b"\t", b" ")
    lines = [line.strip() for line in data.split(b"\n")]
    points = _numbers(path, lines, b"v ")
    if points.shape[1] < 3:
        raise FormatError(f"{path}: a vertex has fewer than three numbers", remedy="export_gltf")
    uvs, normals = _numbers(path, lines, b"vt "), _numbers(path, lines, b"vn ")
    look, numbers, notices = _read_mtl(path, lines)
    surfaces = []
    for material, faces in _faces_of_materials(lines).items():
        corners = _corners(path, faces, (len(points), len(uvs), len(normals)))
        surfaces.append(_surface(material or path.stem, corners, points, uvs, normals, numbers.get(material)))
    if not surfaces:
        raise FormatError(f"{path}: holds no faces, so there is nothing to rig", remedy="mesh_faces")
    return StaticMesh(path, tuple(surfaces), look, False, tuple(notices))


def _numbers(path: Path, lines: list[bytes], word: bytes) -> FloatArray:
    """(N, K) the numbers behind a word."""
    own = [line[len(word) :] for line in lines if line.startswith(word)]
    if not own:
        return np.zeros((0, 3))
    width = len(own[0].split())
    values = np.fromstring(b" ".join(own), sep=" ")
    if len(values) != width * len(own):
        values = np.array([[float(v) for v in line.split()[: min(width, 3)]] for line in own]).reshape(-1)
        width = len(values) // len(own)
    return np.asarray(values.reshape(len(own), width))


def _faces_of_materials(lines: list[bytes]) -> dict[str, list[bytes]]:
    """Material -> the lines of its faces."""
    out: dict[str, list[bytes]] = {}
    own = out.setdefault("", [])
    for line in lines:
        if line.startswith(b"f "):
            own.append(line[2:])
        elif line.startswith(b"usemtl"):
            own = out.setdefault(line[6:].strip().decode("utf-8", "replace"), [])
    return {material: faces for material, faces in out.items() if faces}


def _corners(path: Path, faces: list[bytes], counts: tuple[int, int, int]) -> IntArray:
    """(F, 3, 3) place, texture coordinate and normal of each corner of each triangle, -1 where there is none."""
    by_size: dict[tuple[int, int], list[bytes]] = {}
    for line in faces:
        by_size.setdefault((len(line.split()), line.split(None, 1)[0].count(b"/")), []).append(line)
    out = []
    for (size, slashes), own in by_size.items():
        if size < 3:
            continue
        text = b" ".join(own).replace(b"//", b"/0/").replace(b"/", b" ")
        values = np.fromstring(text, dtype=np.int64, sep=" ")
        width = min(slashes, 2) + 1
        if len(values) != len(own) * size * width:
            raise FormatError(f"{path}: a face has corners of different kinds", remedy="export_gltf")
        corners = np.zeros((len(own), size, 3), np.int64)
        corners[..., :width] = values.reshape(len(own), size, width)
        for k, count in enumerate(counts):
            column = corners[..., k]
            corners[..., k] = np.where(column > 0, column - 1, np.where(column < 0, column + count, -1))
            if corners[..., k].max(initial=-1) >= count or corners[..., k].min(initial=0) < -1:
                raise FormatError(f"{path}: a face refers to what is not in the file", remedy="export_gltf")
        if (corners[..., 0] < 0).any():
            raise FormatError(f"{path}: a face has a corner without a vertex", remedy="export_gltf")
        out += [corners[:, [0, k, k + 1]] for k in range(1, size - 1)]
    return np.concatenate(out) if out else np.zeros((0, 3, 3), np.int64)


def _surface(
    name: str, corners: IntArray, points: FloatArray, uvs: FloatArray, normals: FloatArray, material: int | None
) -> Surface:
    flat = corners.reshape(-1, 3) + 1
    key = (flat[:, 0] * (len(uvs) + 1) + flat[:, 1]) * (len(normals) + 1) + flat[:, 2]
    _, first, vertex = np.unique(key, return_index=True, return_inverse=True)
    place, uv, normal = flat[first].T - 1
    attributes: dict[str, FloatArray] = {}
    if len(uvs) and (uv >= 0).all():
        attributes["TEXCOORD_0"] = uvs[uv, :2] * [1, -1] + [0, 1]
    if points.shape[1] >= 6:
        attributes["COLOR_0"] = np.clip(points[place, 3:6], 0.0, 1.0)
    return Surface(name, points[place, :3], vertex.reshape(-1, 3).astype(np.int64),
                   _unit(normals[normal, :3]) if len(normals) and (normal >= 0).all() else None, attributes,
                   material)  # fmt: skip


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12))


def _read_mtl(path: Path, lines: Iterable[bytes]) -> tuple[Look, dict[str, int], list[str]]:
    """The materials of an OBJ, their numbers by name, and notices."""
    names = [line[7:].strip().decode("utf-8", "replace") for line in lines if line.startswith(b"mtllib ")]
    materials: list[dict[str, Any]] = []
    numbers: dict[str, int] = {}
    pictures: list[Picture] = []
    notices: list[str] = []
    for file in (path.parent / name for name in dict.fromkeys(names)):
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
                try:
                    _set(materials[-1], key.lower(), value.strip(), file, pictures, notices)
                except ValueError:  # such as a spectral curve in place of a colour
                    notices.append(f"{file.name}: its line {line.strip()!r} was not understood and is left out")
    textures = tuple({"source": k} for k in range(len(pictures)))
    return Look(tuple(materials), textures, (), tuple(pictures)), numbers, notices


def _set(material: dict[str, Any], key: str, value: str, file: Path, pictures: list[Picture],
         notices: list[str]) -> None:  # fmt: skip
    """One line of an MTL; ValueError where its numbers are none."""
    words = value.split()
    look = material["pbrMetallicRoughness"]
    if key == "kd" and len(words) >= 3:
        look["baseColorFactor"][:3] = [_linear(float(w)) for w in words[:3]]
    elif key in ("d", "tr") and words:
        alpha = float(words[-1]) if key == "d" else 1.0 - float(words[-1])
        look["baseColorFactor"][3] = alpha
        if alpha < _OPAQUE:
            material["alphaMode"] = "BLEND"
    elif key in ("map_kd", "norm") and words:
        # A name may have spaces, and options may stand before it.
        names = dict.fromkeys((value, words[-1]) if not value.startswith("-") else (words[-1],))
        found = (_read_picture(file.parent / name.replace("\\", "/")) for name in names)
        picture = next((one for one in found if one is not None), None)
        if picture is None:
            notices.append(f"{file.name}: its texture {next(iter(names))} was not found or is no image")
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
    """A colour value of sRGB as linear light."""
    return value / 12.92 if value <= 0.04045 else float(((value + 0.055) / 1.055) ** 2.4)


def _read_picture(path: Path) -> Picture | None:
    """An image as PNG or JPEG, which are those that glTF holds; others are converted. None where it is no image."""
    if not path.is_file():
        return None
    data = path.read_bytes()
    for start, kind in _KINDS.items():
        if data.startswith(start):
            return Picture(path.name, data, kind)
    from PIL import Image, UnidentifiedImageError

    out = io.BytesIO()
    try:
        Image.open(path).save(out, "PNG")
    except (UnidentifiedImageError, OSError):
        return None
    return Picture(path.stem + ".png", out.getvalue(), "image/png")
