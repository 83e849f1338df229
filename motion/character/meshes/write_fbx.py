"""A mesh with a new skeleton, its weights and its takes as one binary FBX file.

Vertices that a file splits at seams of texture coordinates and normals are one point again, as programs that write FBX
have it; normals, texture coordinates and colours are those of the corners.
"""

from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.meshes.bound_mesh import BoundMesh, NamedMotion
from muybridge.motion.character.meshes.fbx_materials import add_materials
from muybridge.motion.character.meshes.static_mesh import Surface
from muybridge.motion.character.surface import vertex_normals
from muybridge.motion.formats.fbx.container import Node
from muybridge.motion.formats.fbx.document import DEFAULT_FPS, write_document
from muybridge.motion.formats.fbx.limbs import FIRST_FREE, add_animation, add_joints, bind_matrices, model
from muybridge.motion.formats.fbx.meshes import Geometry, add_shapes, add_skin, geometry_node


def write_skinned_fbx(path: Path, bound: BoundMesh, clips: Sequence[NamedMotion] = ()) -> tuple[str, ...]:
    """Write a mesh with its skeleton, and an animation stack for each take.

    Args:
        path: the file to write; replaced only once it is complete.
        bound: the mesh and its skeleton.
        clips: takes; the first one is shown. Without any, the file shows the pose at rest.

    Returns:
        What FBX cannot hold and was left out, one sentence each.

    Raises:
        OutputError: the file cannot be written.
    """
    objects, links, numbers = Node("Objects", (), []), Node("Connections", (), []), count(FIRST_FREE)
    materials, notices = add_materials(objects, links, bound.mesh.look, path.stem, numbers)
    models: list[int] = []
    for name, parts in bound.objects():
        models.append(_add_mesh(objects, links, bound, name, parts, materials, numbers))
    add_joints(objects, links, bound.skeleton, models, bound.root)
    stacks = [(clip.name, add_animation(objects, links, clip.motion, clip.name, numbers)) for clip in clips]
    write_document(path, objects, links, stacks, clips[0].motion.fps if clips else DEFAULT_FPS)
    return tuple(f"{path.name}: {notice}" for notice in notices)


def _add_mesh(
    objects: Node, links: Node, bound: BoundMesh, name: str, parts: list[tuple[Surface, slice]],
    materials: dict[int | None, int], numbers: Iterator[int],
) -> int:  # fmt: skip
    """An object of the scene with its skin; the number of its model."""
    model_number, geometry = next(numbers), next(numbers)
    weights = np.concatenate([bound.dense_weights(at) for _, at in parts])
    points = np.concatenate([surface.positions for surface, _ in parts])
    shapes = _shapes(parts)
    _, first, point = np.unique(np.concatenate([points, weights, *shapes.values()], axis=1), axis=0,
                                return_index=True, return_inverse=True)  # fmt: skip
    own = list(dict.fromkeys(surface.material for surface, _ in parts))
    objects.append(model(model_number, name, "Mesh", np.zeros(3)))
    objects.append(geometry_node(geometry, _geometry(name, parts, points[first], point.ravel(), own)))
    links.add("C", "OO", model_number, 0)
    links.add("C", "OO", geometry, model_number)
    for material in own:
        links.add("C", "OO", materials[material], model_number)
    add_skin(objects, links, geometry, bound.skeleton.names, bind_matrices(bound.skeleton, bound.root), weights[first],
             numbers)  # fmt: skip
    add_shapes(objects, links, geometry, [(shape, offsets[first]) for shape, offsets in shapes.items()], numbers)
    return model_number


def _shapes(parts: list[tuple[Surface, slice]]) -> dict[str, FloatArray]:
    """Name -> (V, 3) offsets of the shapes of an object; a surface without a shape stays in it as it is."""
    own = [{morph.name: morph.offsets for morph in surface.morphs} for surface, _ in parts]
    return {
        name: np.concatenate([
            shapes.get(name, np.zeros_like(s.positions)) for shapes, (s, _) in zip(own, parts, strict=True)
        ])
        for name in dict.fromkeys(name for shapes in own for name in shapes)
    }  # fmt: skip


def _geometry(
    name: str, parts: list[tuple[Surface, slice]], points: FloatArray, point: np.ndarray[Any, Any],
    materials: list[int | None],
) -> Geometry:  # fmt: skip
    """The triangles of all surfaces, `point` (V,) being the point of each vertex."""
    triangles, normals, of_material, start = [], [], [], 0
    for surface, _ in parts:
        triangles.append(point[surface.triangles + start])
        own = surface.normals
        if own is None:
            own = vertex_normals(surface.positions, surface.triangles)
        normals.append(own[surface.triangles])
        of_material.append(np.full(len(surface.triangles), materials.index(surface.material)))
        start += len(surface.positions)
    surfaces = [surface for surface, _ in parts]
    sets = sorted({key for s in surfaces for key in s.attributes if key.startswith("TEXCOORD_")})
    uvs = [_corners(surfaces, key, np.zeros(2)) * [1, -1] + [0, 1] for key in sets]
    coloured = any("COLOR_0" in s.attributes for s in surfaces)
    return Geometry(
        name, points, np.concatenate(triangles),
        np.concatenate(normals) if any(s.normals is not None for s in surfaces) else None, uvs,
        _corners(surfaces, "COLOR_0", np.ones(4)) if coloured else None,
        np.concatenate(of_material) if len(materials) > 1 else None,
    )  # fmt: skip


def _corners(surfaces: Sequence[Surface], key: str, usual: FloatArray) -> FloatArray:
    """(F, 3, K) the values of an attribute at the corners of all triangles; `usual` (K,) where there are none."""
    out = []
    for surface in surfaces:
        values = np.tile(usual, (len(surface.positions), 1))
        if key in surface.attributes:
            given = surface.attributes[key]
            values[:, : given.shape[1]] = given
        out.append(values[surface.triangles])
    return np.concatenate(out)
