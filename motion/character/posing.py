"""The meshes of a character in a pose: the methods of `muybridge.motion.character.skinning` on its meshes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from muybridge.arrays import Float32Array, FloatArray
from muybridge.motion.character.skinning.methods import Skinner
from muybridge.motion.character.skinning.skin import Skin

if TYPE_CHECKING:
    from muybridge.geometry.skeleton.motion import Motion
    from muybridge.motion.character.character import Character, Mesh


def pose_meshes(
    character: Character, motion: Motion, morph_weights: Mapping[str, float] | None = None, method: str = "linear"
) -> list[Float32Array]:
    """(T, V, 3) metres in the world of each of a character's meshes.

    Args:
        character: any; what a method prepares is kept with it.
        motion: of its skeleton, whichever joints slide.
        morph_weights: by the morphs' names; others are as in the file.
        method: of skinning, a name of `METHODS`.

    Raises:
        ValueError: no such method.
    """
    shapes = [shape_of(mesh, morph_weights) for mesh in character.meshes]
    return character.skinner(method).pose(motion.forward(), shapes)


def pose_mesh(
    mesh: Mesh, frames: FloatArray, morph_weights: Mapping[str, float] | None = None, method: str = "linear"
) -> Float32Array:
    """(T, V, 3) metres in the world of one mesh; `frames` (T, J, 4, 4) as `Motion.forward` gives them."""
    return Skinner([skin_of(mesh)], method).pose(frames, [shape_of(mesh, morph_weights)])[0]


def skin_of(mesh: Mesh) -> Skin:
    """A mesh as the skinning methods take it, without morphs."""
    return Skin(mesh.positions, mesh.triangles, mesh.joints, mesh.weights, mesh.bind)


def shape_of(mesh: Mesh, morph_weights: Mapping[str, float] | None = None) -> FloatArray:
    """(V, 3) metres, the mesh at rest with morphs; those without a weight here are as in the file."""
    shape = mesh.positions.copy()
    for morph, usual in zip(mesh.morphs, mesh.morph_weights, strict=True):
        weight = (morph_weights or {}).get(morph.name, usual)
        if weight:
            shape += weight * morph.offsets
    return shape
