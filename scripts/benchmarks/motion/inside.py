"""How much of a character's hands and forearms is inside of its body: vertices by their winding numbers.

Source: A. Jacobson, L. Kavan, O. Sorkine-Hornung, "Robust inside-outside segmentation using generalized winding
numbers", 2013; triangles by A. van Oosterom and J. Strackee, 1983.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character import Character
from muybridge.motion.character.posing import pose_mesh

_OF_ARM = 0.3  # of a vertex's weight, below which its triangles belong to the body
_INSIDE = 0.5  # winding number
_MOST_POINTS = 300  # that are looked at; the count is of all


def vertices_inside(character: Character, roles: dict[str, int], motion: Motion, frames: FloatArray) -> float:
    """The mean number of vertices of hands and forearms that are inside of the rest of the skin, over some frames."""
    above = character.skeleton.is_ancestor
    lower, arms = (np.nonzero(np.any([above[roles[f"{side}_{part}"]] for side in ("left", "right")], axis=0))[0]
                   for part in ("forearm", "upper_arm"))  # fmt: skip
    world = motion.select(frames).forward()
    counts = np.zeros(len(world))
    points, triangles = [], []
    for mesh in character.meshes:
        if mesh.rigid:
            continue
        shares = [(mesh.weights * np.isin(mesh.joints, joints)).sum(axis=1) for joints in (lower, arms)]
        posed = pose_mesh(mesh, world)
        points.append(posed[:, shares[0] > 0.5])
        triangles.append(posed[:, mesh.triangles[(shares[1][mesh.triangles] < _OF_ARM).all(axis=1)]])
    if not points:
        return 0.0
    of_arms, of_body = np.concatenate(points, axis=1), np.concatenate(triangles, axis=1)
    step = -(-of_arms.shape[1] // _MOST_POINTS) or 1
    for t in range(len(world)):
        counts[t] = step * (winding_numbers(of_arms[t, ::step], of_body[t]) > _INSIDE).sum()
    return float(counts.mean())


@njit(cache=True)  # type: ignore[untyped-decorator]
def winding_numbers(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """(N,) how often triangles (F, 3, 3) go around points (N, 3); one inside of a closed surface."""
    out = np.zeros(len(points))
    for n in range(len(points)):
        total = 0.0
        for f in range(len(triangles)):
            a, b, c = triangles[f, 0] - points[n], triangles[f, 1] - points[n], triangles[f, 2] - points[n]
            x, y, z = np.sqrt((a * a).sum()), np.sqrt((b * b).sum()), np.sqrt((c * c).sum())
            volume = (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2])
                      + a[2] * (b[0] * c[1] - b[1] * c[0]))  # fmt: skip
            below = x * y * z + (a * b).sum() * z + (b * c).sum() * x + (c * a).sum() * y
            total += 2 * np.arctan2(volume, below)
        out[n] = total / (4 * np.pi)
    return out
