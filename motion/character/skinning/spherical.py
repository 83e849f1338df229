"""Spherical blending: rotations are blended, about a centre that the joints of a vertex nearly agree on.

Source: Kavan and Zara, Spherical blend skinning: a real-time deformation of articulated models, 2005. The centre of a
set of joints is the place that all of them move to nearly the same place, in the least squares; it changes with the
pose. Kept as a historical remedy: where the joints agree on no place, vertices of different sets are torn apart.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray, IntArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.character.skinning.skin import Influences

_PULL = 1e-4  # towards the middle of the set's vertices, where any place of an axis does, or any place at all


@dataclass(frozen=True, eq=False)
class JointSets:
    """The sets of joints that vertices have.

    Attributes:
        starts: (G + 1,) where the joints of a set begin.
        joints: (N,) of the sets, one after another.
        middles: (G, 3) metres, of the vertices of each set.
        group: (V,) the set of each vertex.
    """

    starts: IntArray
    joints: IntArray
    middles: FloatArray
    group: IndexArray

    def centres(self, maps: Float32Array) -> Float32Array:
        """(T, G, 3) the centre of each set while the joints are at maps (T, J, 3, 4)."""
        out = np.empty((len(maps), len(self.middles), 3), np.float32)
        _centres(maps.astype(np.float64), self.starts, self.joints, self.middles, out)
        return out


def joint_sets(influences: Influences, shape: FloatArray) -> JointSets:
    """The sets of joints of a skin's vertices, at shape (V, 3)."""
    numbers: dict[tuple[int, ...], int] = {}
    group = np.empty(len(shape), np.intp)
    for v, (a, b) in enumerate(zip(influences.starts[:-1], influences.starts[1:], strict=True)):
        key = tuple(sorted(set(influences.joints[a:b].tolist())))
        group[v] = numbers.setdefault(key, len(numbers))
    count = np.maximum(np.bincount(group, minlength=len(numbers)), 1)
    middles = np.stack([np.bincount(group, shape[:, k], len(numbers)) / count for k in range(3)], axis=1)
    starts = np.concatenate([[0], np.cumsum([len(key) for key in numbers])]).astype(np.int64)
    return JointSets(starts, np.array([j for key in numbers for j in key], np.int64), middles, group)


@compiled
def _centres(maps, starts, joints, middles, out):  # type: ignore[no-untyped-def]
    """Least squares over all pairs of a set's joints of where both move one place to."""
    for t in range(len(maps)):
        for g in range(len(middles)):
            normal, right = np.eye(3) * _PULL, middles[g] * _PULL
            for i in range(starts[g], starts[g + 1]):
                for k in range(i + 1, starts[g + 1]):
                    gap = maps[t, joints[i]] - maps[t, joints[k]]
                    for a in range(3):
                        for b in range(3):
                            for c in range(3):
                                normal[b, c] += gap[a, b] * gap[a, c]
                            right[b] -= gap[a, b] * gap[a, 3]
            out[t, g] = np.linalg.solve(normal, right)
