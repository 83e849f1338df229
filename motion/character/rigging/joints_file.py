"""Joints in a file that a user corrects: written from what was found, and applied again."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.motion.character.rigging.rig import MeshRig

_HEAD = """# Joints of {mesh}, in metres: x to the left of the body, y to its back, z up, which are
# the axes that Blender shows the written file in. Move what is wrong, and leave out what
# shall be found anew; a joint that is named here is where this file says. `placed` is how the
# mesh was moved, row after row: leave it as it is.
"""
_ROOM = 0.25  # of the mesh's extent beyond its box within which a joint may be


def write_joints(path: Path, mesh: Path, rig: MeshRig) -> None:
    """Write the places of a rig's joints.

    Raises:
        OutputError: the file cannot be written.
    """
    rows = ", ".join(f"[{', '.join(f'{v + 0.0:.9g}' for v in row)}]" for row in rig.new_from_old[:3])
    head = [_HEAD.format(mesh=mesh.name), f'template = "{rig.template.name}"', f"placed = [{rows}]\n"]
    lines = [*head, "[joints]"]
    for role in rig.template.roles:
        lines.append(f"{role} = [{', '.join(f'{v + 0.0:.4f}' for v in rig.places[role])}]")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


@dataclass(frozen=True, eq=False)
class KnownJoints:
    """What a file of joints says.

    Attributes:
        template: its name; None if the file names none.
        places: role -> (3,) metres.
        new_from_old: (4, 4) how the mesh is moved; None if the file does not say.
    """

    template: str | None
    places: dict[str, FloatArray]
    new_from_old: FloatArray | None = None


def read_joints(path: Path) -> KnownJoints:
    """Read a file of joints.

    Raises:
        FormatError: it is no such file, or a place is not three finite numbers.
    """
    with parsing(path, FormatError, "a file of joints"):
        values: dict[str, Any] = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    joints = values.get("joints")
    if not isinstance(joints, dict) or not joints:
        raise FormatError(f"{path}: a file of joints has a table [joints] with lines joint = [x, y, z]")
    out = {}
    for role, place in joints.items():
        good = isinstance(place, list) and len(place) == 3 and all(isinstance(v, int | float) for v in place)
        if not good or not np.isfinite(np.array(place, float)).all():
            raise FormatError(f"{path}: the joint {role} must be three finite numbers, [x, y, z] in metres")
        out[role] = np.array(place, float)
    return KnownJoints(values.get("template"), out, _matrix(path, values.get("placed")))


def _matrix(path: Path, rows: Any) -> FloatArray | None:
    if rows is None:
        return None
    try:
        matrix = np.array([*rows, [0, 0, 0, 1]], float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-12:
        raise FormatError(f"{path}: `placed` must be three rows of four numbers; leave it as it was written")
    return matrix


def apply_joints(rig: MeshRig, places: dict[str, FloatArray], vertices: FloatArray, path: Path) -> MeshRig:
    """A rig with joints moved to where a file says.

    Args:
        rig: as found.
        places: role -> (3,) metres in the new world.
        vertices: (V, 3) metres of the mesh in the new world.
        path: of the file, for messages.

    Raises:
        FormatError: the template has no such joint, or a place is far from the mesh.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    room = _ROOM * float((high - low).max())
    for role, place in places.items():
        if role not in rig.places:
            raise FormatError(f"{path}: the template {rig.template.name} has no joint {role!r}; valid are "
                              f"{', '.join(rig.template.roles)}")  # fmt: skip
        if (place < low - room).any() or (place > high + room).any():
            raise FormatError(f"{path}: the joint {role} at {place.round(3).tolist()} is far from the mesh, which "
                              f"reaches from {low.round(3).tolist()} to {high.round(3).tolist()} metres")  # fmt: skip
    return replace(rig, places=rig.places | places)
