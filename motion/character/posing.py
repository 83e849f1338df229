"""Meshes posed by linear blending.

Source: Magnenat-Thalmann, Laperrière and Thalmann, Joint-dependent local deformations, Graphics Interface 1988.
"""

from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character, Mesh


def pose_meshes(
    character: Character, motion: Motion, morph_weights: Mapping[str, float] | None = None
) -> list[FloatArray]:
    """(T, V, 3) metres in the world of each of a character's meshes.

    Args:
        character: any.
        motion: of its skeleton, whichever joints slide.
        morph_weights: by the morphs' names; others are as in the file.
    """
    frames = motion.forward()
    return [pose_mesh(mesh, frames, morph_weights) for mesh in character.meshes]


def pose_mesh(mesh: Mesh, frames: FloatArray, morph_weights: Mapping[str, float] | None = None) -> FloatArray:
    """(T, V, 3) metres in the world of one mesh; `frames` (T, J, 4, 4) as `Motion.forward` gives them."""
    shape = mesh.positions.copy()
    for morph, usual in zip(mesh.morphs, mesh.morph_weights, strict=True):
        weight = (morph_weights or {}).get(morph.name, usual)
        if weight:
            shape += weight * morph.offsets
    out = np.zeros((len(frames), *shape.shape))
    for t, frame in enumerate(frames):
        maps = frame @ mesh.bind
        for k in range(mesh.joints.shape[1]):
            of_vertex = maps[mesh.joints[:, k]]
            moved = (of_vertex[:, :3, :3] @ shape[..., None])[..., 0] + of_vertex[:, :3, 3]
            out[t] += mesh.weights[:, k, None] * moved
    return out
