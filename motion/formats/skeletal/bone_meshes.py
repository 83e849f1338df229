"""A mesh that shows a skeleton: one octahedron per bone, each vertex bound to the bone's joint alone.

It replaces a skin in formats that show nothing without one.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.skeleton.skeleton import Skeleton

_SHORTEST_M = 1e-3
_WAIST = 0.12  # where along a bone it is widest
_WIDTH = 0.09  # half its width there, as a share of its length
_WIDTH_RANGE_M = (0.004, 0.045)


@dataclass(frozen=True, eq=False)
class BoneMesh:
    """Triangles with flat normals; no vertex is shared between two of them.

    Attributes:
        positions: (V, 3) metres in the rest pose, the root at the origin.
        normals: (V, 3) unit length, outward.
        joints: (V,) the joint that a vertex moves with.
    """

    positions: FloatArray
    normals: FloatArray
    joints: IndexArray


def bone_mesh(skeleton: Skeleton) -> BoneMesh:
    """The bones from every joint to its children, and to the tips of those that have none."""
    rest = skeleton.rest_positions
    bones = [(p, rest[p], rest[j]) for j, p in enumerate(skeleton.parents) if p >= 0]
    has_child = set(skeleton.parents)
    bones += [
        (j, rest[j], rest[j] + tip)
        for j, tip in enumerate(skeleton.tips)
        if j not in has_child and np.isfinite(tip).all()
    ]
    bones = [b for b in bones if np.linalg.norm(b[2] - b[1]) > _SHORTEST_M]
    if not bones:  # something must be there to see
        bones = [(0, rest[0], rest[0] + (0.0, 0.0, 0.1))]
    triangles = np.stack([_octahedron(start, end) for _, start, end in bones])  # (B, 8, 3, 3)
    normals = np.cross(triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return BoneMesh(
        positions=triangles.reshape(-1, 3),
        normals=np.repeat(normals.reshape(-1, 3), 3, axis=0),
        joints=np.repeat(np.array([j for j, _, _ in bones], dtype=np.intp), 24),
    )


def _octahedron(start: FloatArray, end: FloatArray) -> FloatArray:
    """(8, 3, 3): eight triangles, counter-clockwise seen from outside."""
    along = end - start
    length = float(np.linalg.norm(along))
    axis = along / length
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    width = np.clip(_WIDTH * length, _WIDTH_RANGE_M[0], max(_WIDTH_RANGE_M[1], 0.05 * length))
    middle = start + _WAIST * along
    other = np.cross(axis, across)
    ring = [middle + width * v for v in (across, other, -across, -other)]
    near = [(start, ring[(k + 1) % 4], ring[k]) for k in range(4)]
    far = [(end, ring[k], ring[(k + 1) % 4]) for k in range(4)]
    return np.array(near + far)
