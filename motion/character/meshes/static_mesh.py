"""A mesh without a skeleton, as its file has it: surfaces, and the materials that any glTF file can hold."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.character import Morph


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material.

    Attributes:
        name: in the file, or made of its number.
        positions: (V, 3) metres, Z up.
        triangles: (F, 3) vertices, counter-clockwise seen from outside.
        normals: (V, 3) unit vectors; None where the file has none.
        attributes: further values of vertices by their names in glTF, such as TEXCOORD_0 (V, 2), (0, 0) being the
            top left corner of the texture, COLOR_0 (V, 3 or 4) and TANGENT (V, 4).
        material: its number in `Look.materials`; None for none.
        morphs: shapes to blend towards.
    """

    name: str
    positions: FloatArray
    triangles: IntArray
    normals: FloatArray | None = None
    attributes: Mapping[str, FloatArray] = field(default_factory=dict)
    material: int | None = None
    morphs: tuple[Morph, ...] = ()


@dataclass(frozen=True)
class Picture:
    """An image of a texture, with the bytes that its file has.

    Attributes:
        name: without folder.
        data: the file's bytes.
        kind: its media type, such as image/png.
    """

    name: str
    data: bytes
    kind: str


@dataclass(frozen=True)
class Look:
    """Materials as glTF states them.

    Attributes:
        materials: glTF's objects, whose textures are numbers among `textures`.
        textures: glTF's objects, whose sources are numbers among `pictures`.
        samplers: glTF's objects.
        pictures: all images.
        extensions: of glTF that materials and textures use; `required` those that a reader must know.
        required: see there.
    """

    materials: tuple[dict[str, Any], ...] = ()
    textures: tuple[dict[str, Any], ...] = ()
    samplers: tuple[dict[str, Any], ...] = ()
    pictures: tuple[Picture, ...] = ()
    extensions: tuple[str, ...] = ()
    required: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class StaticMesh:
    """The mesh of a file.

    Attributes:
        path: the file.
        surfaces: at least one, each with at least one triangle.
        look: materials.
        faces_front: whether the format states that models face its front, as glTF does.
        notices: what was assumed or left out in reading, one sentence each.
        skinned: whether the file has a skin, and its surfaces were not read.
    """

    path: Path
    surfaces: tuple[Surface, ...]
    look: Look = field(default_factory=Look)
    faces_front: bool = False
    notices: tuple[str, ...] = ()
    skinned: bool = False

    @property
    def vertices(self) -> FloatArray:
        """(V, 3) metres, of all surfaces."""
        return np.concatenate([surface.positions for surface in self.surfaces])

    @property
    def triangles(self) -> IntArray:
        """(F, 3) of `vertices`."""
        starts = np.cumsum([0, *(len(surface.positions) for surface in self.surfaces[:-1])])
        return np.concatenate([s.triangles + start for s, start in zip(self.surfaces, starts, strict=True)])

    @property
    def extent(self) -> FloatArray:
        """(3,) metres of the box about all faces; vertices that no face has do not count."""
        return np.asarray(np.ptp(self.vertices[np.unique(self.triangles)], axis=0))

    def moved(self, matrix: FloatArray, turned: bool = False) -> "StaticMesh":
        """The mesh under a similarity.

        Args:
            matrix: (4, 4) new world from old.
            turned: whether all faces and normals are turned the other way, too.
        """
        return StaticMesh(self.path, tuple(_moved(s, matrix, turned) for s in self.surfaces), self.look,
                          self.faces_front, self.notices)  # fmt: skip


def _moved(surface: Surface, matrix: FloatArray, turned: bool) -> Surface:
    linear = matrix[:3, :3]
    size = float(np.cbrt(abs(np.linalg.det(linear))))
    mirrored = np.linalg.det(linear) < 0
    turn = linear / size
    out = {**surface.attributes}
    if "TANGENT" in out:
        out["TANGENT"] = np.concatenate(
            [out["TANGENT"][:, :3] @ turn.T, out["TANGENT"][:, 3:] * (-1.0 if mirrored else 1.0)], axis=1
        )
    normals = None if surface.normals is None else surface.normals @ turn.T * (-1.0 if turned else 1.0)
    return Surface(
        surface.name, surface.positions @ linear.T + matrix[:3, 3],
        surface.triangles[:, ::-1] if mirrored != turned else surface.triangles, normals, out, surface.material,
        tuple(Morph(m.name, m.offsets @ linear.T) for m in surface.morphs),
    )  # fmt: skip
