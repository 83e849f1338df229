"""Materials of glTF as FBX has them: Phong's, whose shininess and reflection stand for roughness and metal.

Blender translates so from and to FBX: roughness is 1 - sqrt(shininess) / 10, and the factor of reflection is the
metalness.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from muybridge.motion.character.meshes.static_mesh import Look, Picture
from muybridge.motion.formats.fbx.container import Node, Table
from muybridge.motion.formats.fbx.curves import object_name

_SUFFIXES = {"image/png": ".png", "image/jpeg": ".jpg", "image/webp": ".webp", "image/ktx2": ".ktx2"}
_REPEATED, _CLAMPED = 10497, 33071  # numbers of glTF
_SLOTS = {"baseColorTexture": "DiffuseColor", "normalTexture": "NormalMap", "emissiveTexture": "EmissiveColor"}


def add_materials(
    objects: Node, links: Node, look: Look, stem: str, numbers: Iterator[int]
) -> tuple[dict[int | None, int], list[str]]:
    """Materials with their textures, whose images are within the file.

    Args:
        objects, links: nodes to add to.
        look: of the mesh.
        stem: of the file; programs that unpack the images do so into the folder `STEM.fbm`.
        numbers: that no object has.

    Returns:
        The number of each material's object, None being that of surfaces without a material; and what was left out.
    """
    videos = _add_pictures(objects, look.pictures, stem, numbers)
    out: dict[int | None, int] = {}
    left: dict[str, None] = {}
    for k, raw in enumerate(look.materials):
        out[k] = next(numbers)
        objects.append(_material(out[k], str(raw.get("name") or f"material_{k}"), raw))
        for slot, texture in _textures(raw):
            source = _source(look, texture)
            if slot not in _SLOTS or source is None:
                left[slot] = None
                continue
            number, (video, file) = next(numbers), videos[source]
            sampler = look.textures[texture["index"]].get("sampler")
            wraps = look.samplers[sampler] if sampler is not None else {}
            objects.append(_texture(number, look.pictures[source].name, file, wraps, int(texture.get("texCoord", 0))))
            links.add("C", "OO", video, number)
            links.add("C", "OP", number, out[k], _SLOTS[slot])
            if slot == "baseColorTexture" and _colour(raw)[:3] != [1.0, 1.0, 1.0]:
                left["a colour that multiplies a texture"] = None
    out[None] = next(numbers)
    objects.append(_material(out[None], "none", {"pbrMetallicRoughness": {"metallicFactor": 0.0}}))
    return out, [f"FBX has no place for what its materials have as {', '.join(left)}; it is left out"] if left else []


def _textures(raw: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    look = {**(raw.get("pbrMetallicRoughness") or {}), **raw}
    return [(key, value) for key, value in look.items() if key.endswith("Texture") and "index" in value]


def _source(look: Look, texture: dict[str, Any]) -> int | None:
    """The number of a texture's picture; None where it has none."""
    raw = look.textures[texture["index"]]
    for named in (raw, *(raw.get("extensions") or {}).values()):
        if isinstance(named, dict) and "source" in named:
            return int(named["source"])
    return None


def _colour(raw: dict[str, Any]) -> list[float]:
    return [float(v) for v in (raw.get("pbrMetallicRoughness") or {}).get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))]


def _material(number: int, name: str, raw: dict[str, Any]) -> Node:
    look = raw.get("pbrMetallicRoughness") or {}
    colour = _colour(raw)
    rough, metal = float(look.get("roughnessFactor", 1.0)), float(look.get("metallicFactor", 1.0))
    shine = (10.0 * (1.0 - rough)) ** 2
    alpha = colour[3] if raw.get("alphaMode", "OPAQUE") != "OPAQUE" else 1.0
    table = Table().line("ShadingModel", "KString", "", "", "Phong")
    table.line("DiffuseColor", "Color", "", "A", *colour[:3]).line("DiffuseFactor", "Number", "", "A", 1.0)
    glow = [float(v) for v in raw.get("emissiveFactor", (0.0, 0.0, 0.0))]
    table.line("EmissiveColor", "Color", "", "A", *glow).line("EmissiveFactor", "Number", "", "A", 1.0)
    table.line("SpecularColor", "Color", "", "A", 1.0, 1.0, 1.0).line("SpecularFactor", "Number", "", "A", 0.25)
    table.line("Shininess", "Number", "", "A", shine).line("ShininessExponent", "Number", "", "A", shine)
    table.line("ReflectionFactor", "Number", "", "A", metal)
    table.line("TransparencyFactor", "Number", "", "A", 1.0 - alpha).line("Opacity", "Number", "", "A", alpha)
    head = [Node("Version", (np.int32(102),)), Node("ShadingModel", ("phong",)), Node("MultiLayer", (np.int32(0),))]
    return Node("Material", (number, object_name(name, "Material"), ""), [*head, table.node])


def _texture(number: int, name: str, file: str, wraps: dict[str, Any], uv_set: int) -> Node:
    table = Table().line("UVSet", "KString", "", "", f"UVMap{f'_{uv_set}' if uv_set else ''}")
    table.line("UseMaterial", "bool", "", "", np.int32(1))
    for axis, key in (("U", "wrapS"), ("V", "wrapT")):
        table.integer(f"WrapMode{axis}", int(wraps.get(key, _REPEATED) == _CLAMPED), "enum")
    out = Node("Texture", (number, object_name(name, "Texture"), ""), [])
    out.add("Type", "TextureVideoClip")
    out.add("Version", np.int32(202))
    out.add("TextureName", object_name(name, "Texture"))
    out.append(table.node)
    out.add("Media", object_name(name, "Video"))
    out.add("FileName", file)
    out.add("RelativeFilename", file)
    out.add("ModelUVTranslation", 0.0, 0.0)
    out.add("ModelUVScaling", 1.0, 1.0)
    out.add("Texture_Alpha_Source", "None")
    return out


def _add_pictures(
    objects: Node, pictures: tuple[Picture, ...], stem: str, numbers: Iterator[int]
) -> list[tuple[int, str]]:
    """The number and the file name of each picture, no two of one name."""
    out: list[tuple[int, str]] = []
    for k, picture in enumerate(pictures):
        suffix = _SUFFIXES.get(picture.kind, "")
        base = picture.name.removesuffix(suffix).replace("/", "_").replace("\\", "_") or f"image_{k}"
        file = f"{stem}.fbm/{base}{suffix}"
        if file in [used for _, used in out]:
            file = f"{stem}.fbm/{base}_{k}{suffix}"
        number = next(numbers)
        node = Node("Video", (number, object_name(picture.name, "Video"), "Clip"), [])
        node.add("Type", "Clip")
        node.append(Table().line("Path", "KString", "XRefUrl", "", file).node)
        node.add("UseMipMap", np.int32(0))
        node.add("Filename", file)
        node.add("RelativeFilename", file)
        node.add("Content", picture.data)
        objects.append(node)
        out.append((number, file))
    return out
