"""Joints in a file that a user corrects: written from what was found, and applied again."""

import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.motion.character.rigging.rig import MeshRig

_HEAD = """# Joints of {mesh}, in metres: x to the left of the body, y to its back, z up, which are
# the axes that Blender shows the written file in. Move what is wrong, and leave out what
# shall be found anew; a joint that is named here is where this file says.
"""
_ROOM = 0.25  # of the mesh's extent beyond its box within which a joint may be


def write_joints(path: Path, mesh: Path, rig: MeshRig) -> None:
    """Write the places of a rig's joints.

    Raises:
        OutputError: the file cannot be written.
    """
    lines = [_HEAD.format(mesh=mesh.name), f'template = "{rig.template.name}"\n', "[joints]"]
    for role in rig.template.roles:
        lines.append(f"{role} = [{', '.join(f'{v + 0.0:.4f}' for v in rig.places[role])}]")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def read_joints(path: Path) -> tuple[str | None, dict[str, FloatArray]]:
    """The template that a file of joints names, None if it names none; and role -> (3,) metres.

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
    return values.get("template"), out


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
