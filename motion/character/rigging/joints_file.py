"""Joints in a file that a user corrects: written from what was found, and applied again."""

import json
import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.motion.character.rigging.rig import MeshRig
from muybridge.motion.character.rigging.templates import TEMPLATES

_HEAD = """# Joints of {mesh}, in metres: x to the left of the body, y to its back, z up, which are
# the axes that Blender shows the written file in. Move what is wrong, and leave out what
# shall be found anew; a joint that is named here is where this file says. `placed` is how the
# mesh was moved, row after row: leave it as it is.
"""
_LARGEST = 1e30  # of a coordinate
_APART = 1e-4  # of the mesh's extent that a joint is at least from its parent
_ROOM = 0.25  # of the mesh's extent beyond its box within which a joint may be


def write_joints(path: Path, mesh: Path, rig: MeshRig) -> None:
    """Write the places of a rig's joints.

    Raises:
        OutputError: the file cannot be written.
    """
    rows = ", ".join(f"[{', '.join(f'{v + 0.0:.9g}' for v in row)}]" for row in rig.new_from_old[:3])
    name = " ".join(mesh.name.encode("utf-8", "replace").decode("utf-8").split())
    head = [_HEAD.format(mesh=name), f"mesh = {json.dumps(name, ensure_ascii=False)}",
            f'template = "{rig.template.name}"', f"placed = [{rows}]\n"]  # fmt: skip
    lines = [*head, "[joints]"]
    extent = float(np.ptp(rig.joints, axis=0).max())
    digits = max(4, 4 - math.floor(math.log10(max(extent, 1e-12))))  # small figures need more
    for role in rig.template.roles:
        lines.append(f"{role} = [{', '.join(f'{v + 0.0:.{digits}f}' for v in rig.places[role])}]")
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


@dataclass(frozen=True, eq=False)
class KnownJoints:
    """What a file of joints says.

    Attributes:
        template: its name; None if the file names none.
        places: role -> (3,) metres.
        new_from_old: (4, 4) how the mesh is moved; None if the file does not say.
        mesh: name of the file that it was written for; None if the file does not say.
    """

    template: str | None
    places: dict[str, FloatArray]
    new_from_old: FloatArray | None = None
    mesh: str | None = None

    def notices(self, path: Path, mesh: Path) -> tuple[str, ...]:
        """What is said where the file at a path was written for another mesh."""
        if self.mesh is None or self.mesh == " ".join(mesh.name.split()):
            return ()
        return (f"{path.name}: was written for {self.mesh}, not for {mesh.name}; see whether its joints fit",)


def read_joints(path: Path) -> KnownJoints:
    """Read a file of joints.

    Raises:
        FormatError: it is no such file, a place is not three finite numbers, or the template is unknown.
    """
    with parsing(path, FormatError, "a file of joints"):
        values: dict[str, Any] = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    joints = values.get("joints")
    if not isinstance(joints, dict) or not joints:
        raise FormatError(f"{path}: a file of joints has a table [joints] with lines joint = [x, y, z]")
    out = {}
    for role, place in joints.items():
        good = isinstance(place, list) and len(place) == 3 and all(type(v) in (int, float) for v in place)
        if not good or not all(abs(v) < _LARGEST for v in place):
            raise FormatError(f"{path}: the joint {role} must be three finite numbers, [x, y, z] in metres")
        out[role] = np.array(place, float)
    template = values.get("template")
    if template is not None and template not in tuple(TEMPLATES):
        raise FormatError(f"{path}: unknown template {template!r}; valid are {', '.join(TEMPLATES)}")
    return KnownJoints(template, out, _matrix(path, values.get("placed")),
                       None if values.get("mesh") is None else str(values["mesh"]))  # fmt: skip


def _matrix(path: Path, rows: Any) -> FloatArray | None:
    if rows is None:
        return None
    try:
        matrix = np.array([*rows, [0, 0, 0, 1]], float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not _is_similarity(matrix):
        raise FormatError(
            f"{path}: `placed` must be three rows of four numbers that turn, scale and move; leave it as it was written"
        )
    return matrix


def _is_similarity(matrix: FloatArray) -> bool:
    """Whether (4, 4) turns, scales and moves, and neither mirrors nor shears."""
    size = float(np.linalg.norm(matrix[:3, 0]))
    if not np.isfinite(matrix).all() or not size > 0.0:
        return False
    turn = matrix[:3, :3] / size
    return bool(np.allclose(turn @ turn.T, np.eye(3), atol=1e-4) and np.linalg.det(turn) > 0.0)


def apply_joints(rig: MeshRig, places: dict[str, FloatArray], vertices: FloatArray, path: Path) -> MeshRig:
    """A rig with joints moved to where a file says.

    Args:
        rig: as found.
        places: role -> (3,) metres in the new world.
        vertices: (V, 3) metres of the mesh in the new world.
        path: of the file, for messages.

    Raises:
        FormatError: the template has no such joint, or a place is far from the mesh or that of the joint above.
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
    out = rig.places | places
    for role, above in rig.template.parents.items():
        if above in out and np.linalg.norm(out[role] - out[above]) < _APART * float((high - low).max()):
            raise FormatError(f"{path}: the joints {above} and {role} are in one place; move one of them, or leave it "
                              "out to be found")  # fmt: skip
    return replace(rig, places=out)
