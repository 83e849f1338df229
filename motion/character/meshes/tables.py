"""Meshes of PLY and STL files, read by trimesh."""

from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.motion.character.meshes.static_mesh import StaticMesh, Surface


def read_table_mesh(path: Path) -> StaticMesh:
    """The surface of a PLY or STL file; called within `parsing`.

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
    part = trimesh.load_mesh(path, process=False)
    if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
        raise FormatError(f"{path}: holds no faces, so there is nothing to rig", remedy="mesh_faces")
    attributes: dict[str, FloatArray] = {}
    visual: Any = part.visual
    uv = getattr(visual, "uv", None)
    if uv is not None and len(uv) == len(part.vertices):
        attributes["TEXCOORD_0"] = np.asarray(uv, float) * [1, -1] + [0, 1]
    if visual.kind == "vertex":
        attributes["COLOR_0"] = np.asarray(visual.vertex_colors, float) / 255
    normals = np.asarray(part.vertex_normals, float) if "vertex_normals" in part._cache else None
    surface = Surface(
        path.stem, np.asarray(part.vertices, float), np.asarray(part.faces, np.int64), normals, attributes
    )
    return StaticMesh(path, (surface,))
