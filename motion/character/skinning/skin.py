"""What every skinning method needs of a mesh, as arrays of single precision, and of joints that move."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.geometry.numerics.rotations import quat_from_rotation

_UNSTRETCHED = 1e-6  # how far a bind matrix may be from a rotation and count as one


class Influences(NamedTuple):
    """The joints that move each vertex, one vertex after another, the heaviest first.

    Attributes:
        starts: (V + 1,) where the influences of a vertex begin.
        joints: (N,) of the skeleton.
        weights: (N,) of each joint; those of a vertex sum to one.
    """

    starts: IntArray
    joints: IntArray
    weights: Float32Array


class Rigid(NamedTuple):
    """Joints over time as rotations and translations, after the stretch of the bind matrices was taken off.

    Attributes:
        maps: (T, J, 3, 4) world from the stretched mesh.
        quat_wxyz: (T, J, 4) the rotations of them.
    """

    maps: Float32Array
    quat_wxyz: Float32Array


@dataclass(frozen=True, eq=False)
class Skin:
    """A mesh and the joints that it follows; in the world, metres.

    Attributes:
        positions: (V, 3) metres, in the pose that the mesh is bound in.
        triangles: (F, 3) vertices.
        joints: (V, K) of the skeleton; any number for each vertex.
        weights: (V, K), their sum one.
        bind: (J, 4, 4) each joint's frame at rest from positions.
    """

    positions: FloatArray
    triangles: IntArray
    joints: IntArray
    weights: FloatArray
    bind: FloatArray

    @cached_property
    def influences(self) -> Influences:
        """The same without zeros; a joint that a vertex has twice stays twice, which is the same sum."""
        order = np.argsort(-self.weights, axis=1, kind="stable")
        joints, weights = (np.take_along_axis(a, order, 1) for a in (self.joints, self.weights))
        used = weights > 0
        starts = np.concatenate([[0], np.cumsum(used.sum(axis=1))]).astype(np.int64)
        return Influences(starts, np.ascontiguousarray(joints[used], np.int64), weights[used].astype(np.float32))

    @cached_property
    def _parts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(J, 3, 3) rotations and stretches of the bind matrices, and (J, 3) what they leave in its place."""
        linear = self.bind[:, :3, :3]
        u, sizes, vt = np.linalg.svd(linear)
        turns = u @ vt
        turns *= np.where(np.linalg.det(turns) < 0, -1.0, 1.0)[:, None, None]
        stretches = np.swapaxes(turns, 1, 2) @ linear
        sound = sizes[:, -1] > 1e-9 * np.maximum(sizes[:, 0], 1e-300)
        back = np.zeros_like(linear)
        back[sound] = np.linalg.inv(linear[sound])
        return turns, stretches, -(back @ self.bind[:, :3, 3, None])[..., 0]

    def stretched(self, shape: FloatArray) -> FloatArray:
        """(V, 3) a shape of the mesh, stretched as the bind matrices do it, each about its joint.

        What is left of the bind matrices is rigid. Source: Kavan, Collins, Zara and O'Sullivan, Geometric skinning with
        approximate dual quaternion blending, 2008, section 4.
        """
        turns, stretches, places = self._parts
        if np.abs(stretches - np.eye(3)).max(initial=0.0) < _UNSTRETCHED:
            return shape
        out = np.zeros_like(shape)
        for k in range(self.joints.shape[1]):
            j = self.joints[:, k]
            moved = (stretches[j] @ (shape - places[j])[..., None])[..., 0] + places[j]
            out += self.weights[:, k, None] * moved
        return out

    def rigid(self, frames: FloatArray) -> Rigid:
        """The joints' rotations and translations from the stretched mesh; frames (T, J, 4, 4) of `Motion.forward`."""
        turns, _, places = self._parts
        rotations = frames[..., :3, :3] @ turns
        maps = np.empty((*frames.shape[:2], 3, 4), np.float32)
        maps[..., :3] = rotations
        # The bind matrix puts `places` at the joint, that is, at its frame's origin.
        left = self.bind[:, :3, 3] + (self.bind[:, :3, :3] @ places[..., None])[..., 0]
        shift = (frames[..., :3, :3] @ left[..., None])[..., 0] + frames[..., :3, 3]
        maps[..., 3] = shift - (rotations @ places[..., None])[..., 0]
        return Rigid(maps, quat_from_rotation(rotations).astype(np.float32))

    def affine(self, frames: FloatArray) -> Float32Array:
        """(T, J, 3, 4) the joints' maps with all that the bind matrices have; frames (T, J, 4, 4)."""
        return np.ascontiguousarray((frames @ self.bind)[..., :3, :], np.float32)
