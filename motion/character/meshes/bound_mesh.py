"""A mesh that was bound to a skeleton, before it is written; and the takes that go with it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.meshes.static_mesh import StaticMesh, Surface


@dataclass(frozen=True, eq=False)
class BoundMesh:
    """A mesh and the skeleton that moves it.

    Attributes:
        mesh: metres, Z up, facing -Y.
        skeleton: at rest in the mesh.
        root: (3,) metres, where its first joint is.
        joints: (V, K) of the vertices of all surfaces.
        weights: (V, K) each row's sum one.
        humanoid: joints by the names of VRM 1.0's bones; None for none.
    """

    mesh: StaticMesh
    skeleton: Skeleton
    root: FloatArray
    joints: IntArray
    weights: FloatArray
    humanoid: Mapping[str, int] | None = None

    def objects(self) -> Iterator[tuple[str, list[tuple[Surface, slice]]]]:
        """Each object of the scene: its name, and its surfaces with where their vertices are among all."""
        surfaces = self.mesh.surfaces
        ends = np.cumsum([0, *(len(s.positions) for s in surfaces)])
        own = [(s, slice(int(a), int(b))) for s, a, b in zip(surfaces, ends, ends[1:], strict=False)]
        for name in dict.fromkeys(s.name for s in surfaces):
            yield name, [one for one in own if one[0].name == name]

    def on(self, skeleton: Skeleton, root: FloatArray) -> "BoundMesh":
        """The same on a skeleton whose joints have the same names in another order, its first root at `root`."""
        number = np.array([skeleton.index(name) for name in self.skeleton.names], np.int64)
        bones = None if self.humanoid is None else {bone: int(number[j]) for bone, j in self.humanoid.items()}
        return BoundMesh(self.mesh, skeleton, root, number[self.joints], self.weights, bones)

    def dense_weights(self, at: slice) -> FloatArray:
        """(N, J) weights of some vertices for every joint."""
        joints, weights = self.joints[at], self.weights[at]
        out = np.zeros((len(joints), len(self.skeleton)))
        np.add.at(out, (np.arange(len(joints))[:, None], joints), weights)
        return out


@dataclass(frozen=True, eq=False)
class NamedMotion:
    """A take on a character.

    Attributes:
        name: of the clip.
        motion: of the character's skeleton, of which any joint may slide; at least one frame.
    """

    name: str
    motion: Motion
