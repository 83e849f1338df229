"""Reading meshes of all formats, with a check of what is in them."""

import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.motion.character.meshes.fbx import read_fbx_mesh
from muybridge.motion.character.meshes.gltf import read_gltf_mesh
from muybridge.motion.character.meshes.obj import read_obj_mesh
from muybridge.motion.character.meshes.static_mesh import StaticMesh
from muybridge.motion.character.meshes.tables import read_table_mesh

_READERS: dict[str, tuple[Callable[[Path], StaticMesh], str, str]] = {
    ".glb": (read_gltf_mesh, "a glTF 2.0 file", "export_gltf"),
    ".gltf": (read_gltf_mesh, "a glTF 2.0 file", "export_gltf"),
    ".vrm": (read_gltf_mesh, "a glTF 2.0 file", "export_gltf"),
    ".fbx": (read_fbx_mesh, "an FBX", "resave_fbx"),
    ".obj": (read_obj_mesh, "a Wavefront OBJ", "export_gltf"),
    ".ply": (read_table_mesh, "a PLY", "export_gltf"),
    ".stl": (read_table_mesh, "an STL", "export_gltf"),
}
MESH_SUFFIXES = tuple(_READERS)
_LEAST_FACES = 50
_ALONE, _NEAR = 300.0, 0.99  # of the box about that share of all vertices: what is farther off was moved by mistake
_LARGEST = 1e30  # of a coordinate; glTF stores single precision, and volumes must not overflow


def read_mesh(path: Path) -> StaticMesh:
    """Read the mesh of a file that has no skeleton yet.

    Args:
        path: `.glb`, `.gltf`, `.vrm`, `.fbx`, `.obj`, `.ply` or `.stl`.

    Raises:
        FormatError: malformed, of another format, without faces, with numbers that are not finite, or with a skin.
        MuybridgeError: a library is missing that the format needs.
    """
    path = Path(path)
    if path.suffix.lower() not in _READERS:
        raise FormatError(f"{path}: is no mesh that can be read; valid are {', '.join(MESH_SUFFIXES)}")
    if not path.is_file():
        raise FormatError(f"{path}: {'is a folder, not a mesh' if path.is_dir() else 'no such file'}")
    if not path.stat().st_size:
        raise FormatError(f"{path}: is empty", remedy="mesh_faces")
    reader, kind, remedy = _READERS[path.suffix.lower()]
    with parsing(path, FormatError, kind, remedy):
        mesh = reader(path)
    _check(mesh)
    return mesh


def _check(mesh: StaticMesh) -> None:
    if mesh.skinned:
        raise FormatError(f"{mesh.path}: its mesh has a skin already, so it needs no new rig", remedy="has_skin",
                          takes="TAKE", mesh=shlex.quote(str(mesh.path)))  # fmt: skip
    faces = sum(len(surface.triangles) for surface in mesh.surfaces)
    if not faces:
        raise FormatError(f"{mesh.path}: holds no faces, so there is nothing to rig", remedy="mesh_faces")
    for surface in mesh.surfaces:
        bad = ~(np.abs(surface.positions) < _LARGEST).all(axis=1)
        if bad.any():
            raise FormatError(f"{mesh.path}: vertex {int(np.argmax(bad))} of the mesh {surface.name!r} is not finite",
                              remedy="mesh_repair")  # fmt: skip
        wrong = surface.triangles[(surface.triangles < 0) | (surface.triangles >= len(surface.positions))]
        if len(wrong):
            raise FormatError(f"{mesh.path}: the mesh {surface.name!r} refers to vertex {wrong[0]} of "
                              f"{len(surface.positions)}", remedy="mesh_repair")  # fmt: skip
    if faces < _LEAST_FACES:
        raise FormatError(f"{mesh.path}: has {faces} triangles, which show no body; at least {_LEAST_FACES} are needed",
                          remedy="mesh_faces")  # fmt: skip
    if mesh.extent.max() < 1 / _LARGEST:
        raise FormatError(f"{mesh.path}: all its faces are in one place", remedy="mesh_repair")
    _check_alone(mesh)


def _check_alone(mesh: StaticMesh) -> None:
    """FormatError where a few vertices are so far from all others that these are one point beside them."""
    points = mesh.vertices[np.unique(mesh.triangles)]
    middle = np.median(points, axis=0)
    usual = float(np.quantile(np.abs(points - middle).max(axis=1), _NEAR))
    for surface in mesh.surfaces:
        used = np.unique(surface.triangles)
        away = np.abs(surface.positions[used] - middle).max(axis=1)
        if usual > 0 and away.max(initial=0.0) > _ALONE * usual:
            times = f"{away.max() / usual:.0f} times as far off as the others"
            raise FormatError(f"{mesh.path}: vertex {used[np.argmax(away)]} of the mesh {surface.name!r} is {times}",
                              remedy="mesh_repair")  # fmt: skip
