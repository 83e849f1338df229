"""The mesh of an FBX file without a skin."""

from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.character.character import Material
from muybridge.motion.character.fbx_meshes import (
    Binding,
    geometric,
    mesh_parts,
    points_of,
    read_material,
    standing_models,
)
from muybridge.motion.character.meshes.static_mesh import Look, Picture, StaticMesh, Surface
from muybridge.motion.formats.fbx.scene import Scene, read_scene
from muybridge.motion.formats.fbx.text import read_fbx_document


def read_fbx_mesh(path: Path) -> StaticMesh:
    """The surfaces of all models of a file, none of one with a skin; called within `parsing`."""

    def error(problem: str, remedy: str = "export_fbx") -> FormatError:
        return FormatError(f"{path}: {problem}", remedy=remedy)

    scene = read_scene(read_fbx_document(path), error, None)
    if any(_is_skin(scene, n) for n in scene.objects):
        return StaticMesh(path, (), skinned=True)
    surfaces, materials = _surfaces(scene)
    look = _look([read_material(scene, number, path.parent) for number in materials])
    return StaticMesh(path, tuple(surfaces), look, False)


def _is_skin(scene: Scene, number: int) -> bool:
    node = scene.objects[number]
    return node.name == "Deformer" and len(node.properties) > 2 and str(node.properties[2]) == "Cluster"


def _surfaces(scene: Scene) -> tuple[list[Surface], list[int]]:
    out: list[Surface] = []
    materials: list[int] = []
    placed = standing_models(scene)
    for model in scene.models:
        for geometry in scene.below(model, "Geometry"):
            points = points_of(scene, geometry)
            if points is None:
                continue
            mine = scene.below(model, "Material")
            materials += [m for m in mine if m not in materials]
            one = np.zeros((len(points), 1), np.int64)
            matrix = placed[model] @ geometric(scene, model)
            for part in mesh_parts(scene, geometry, scene.models[model].name, points,
                                   Binding(matrix, np.eye(4)[None], one, np.ones((len(points), 1)), True),
                                   [materials.index(m) for m in mine]):  # fmt: skip
                uv: dict[str, FloatArray] = {} if part.uvs is None else {"TEXCOORD_0": part.uvs}
                out.append(Surface(part.name, part.positions, part.triangles, part.normals, uv, part.material,
                                   part.morphs))  # fmt: skip
    return out, materials


def _look(materials: list[Material]) -> Look:
    pictures: list[Picture] = []
    out = []
    for material in materials:
        look = {"baseColorFactor": [float(v) for v in material.colour], "metallicFactor": 0.0, "roughnessFactor": 0.8}
        if material.image is not None and material.image_type:
            pictures.append(Picture(f"{material.name}{material.image_type[5:].join('..')[:-1]}", material.image,
                                    material.image_type))  # fmt: skip
            look |= {"baseColorTexture": {"index": len(pictures) - 1}}
        opaque = "OPAQUE" if material.colour[3] > 0.999 else "BLEND"
        out.append({"name": material.name, "pbrMetallicRoughness": look, "doubleSided": True, "alphaMode": opaque})
    return Look(tuple(out), tuple({"source": k} for k in range(len(pictures))), (), tuple(pictures))
