"""A character: a skeleton with the meshes that follow it, as its file has them.

Everything is in the world: metres, Z up. The file itself stays the source: writing a clip changes nothing else in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.posing import pose_meshes, skin_of
from muybridge.motion.character.skinning.methods import Skinner


@dataclass(frozen=True, eq=False)
class Morph:
    """A shape that a mesh can be blended towards.

    Attributes:
        name: in the file, or made of its number.
        offsets: (V, 3) metres at full weight, in the world's axes at rest.
    """

    name: str
    offsets: FloatArray


@dataclass(frozen=True, eq=False)
class Material:
    """What of a material a simple renderer needs; the file keeps all of it.

    Attributes:
        name: in the file.
        colour: (4,) linear red, green, blue and alpha, which multiply the image.
        image: the colour texture's bytes as the file has them; None without texture, or where it lies outside.
        image_type: its media type, such as image/png.
        double_sided: whether the backs of triangles are seen.
    """

    name: str
    colour: FloatArray
    image: bytes | None = None
    image_type: str = ""
    double_sided: bool = False


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles that follow joints: a skin, or a rigid part that hangs on one joint.

    A vertex v in a pose is the sum over k of weights[v, k] * world_from_joints[j] @ bind[j] @ positions[v], where j is
    joints[v, k] and world_from_joints is `Motion.forward()`.

    Attributes:
        name: in the file; the parts of a mesh with several materials share it.
        positions: (V, 3) metres, in the pose that the mesh is bound in.
        triangles: (F, 3) vertices, counter-clockwise seen from outside.
        joints: (V, K) of the skeleton; a rigid part has one.
        weights: (V, K), their sum one.
        bind: (J, 4, 4) each joint's frame at rest, with the world's axes, from positions.
        normals: (V, 3) unit vectors; None where the file has none.
        uvs: (V, 2) of the texture, (0, 0) being its top left corner; None where the file has none.
        morphs: shapes to blend towards.
        morph_weights: (M,) of them, without animation.
        material: its number among the character's; None for none.
        rigid: whether it hangs on one joint without skin.
    """

    name: str
    positions: FloatArray
    triangles: IntArray
    joints: IntArray
    weights: FloatArray
    bind: FloatArray
    normals: FloatArray | None = None
    uvs: FloatArray | None = None
    morphs: tuple[Morph, ...] = ()
    morph_weights: FloatArray = field(default_factory=lambda: np.zeros(0))
    material: int | None = None
    rigid: bool = False


@dataclass(frozen=True, eq=False)
class Character:
    """A character as its file has it.

    Attributes:
        path: the file.
        skeleton: at rest in the pose that the meshes are bound in, with each bone's own axes; no limits.
        root_at_rest: (3,) metres, where the first root is in that pose.
        motion: the clip that was chosen, whose skeleton is this one except that joints slide which leave their place;
            without any clip, one frame as the file's nodes are.
        meshes: all that follow the skeleton, skins and rigid parts.
        materials: of the file.
        clips: names of its animations.
        humanoid: joints by the names of VRM 1.0's bones (those of VRM 0 are renamed); empty without such a table.
        notices: what was assumed or left out in reading, one sentence each.
        source: what the writer needs of the file.
    """

    path: Path
    skeleton: Skeleton
    root_at_rest: FloatArray
    motion: Motion
    meshes: tuple[Mesh, ...] = ()
    materials: tuple[Material, ...] = ()
    clips: tuple[str, ...] = ()
    humanoid: Mapping[str, int] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    source: Any = None

    def pose(
        self, motion: Motion, method: str = "linear", morph_weights: Mapping[str, float] | None = None
    ) -> list[Float32Array]:
        """(T, V, 3) metres in the world of each mesh.

        Args:
            motion: of the skeleton, whichever joints slide.
            method: of skinning, a name of `muybridge.motion.character.METHODS`.
            morph_weights: by the morphs' names; others are as in the file.

        Raises:
            ValueError: no such method; the message lists those there are.
        """
        return pose_meshes(self, motion, morph_weights, method)

    def skinner(self, method: str = "linear") -> Skinner:
        """The meshes prepared for a method, once for each."""
        if method not in self._skinners:
            self._skinners[method] = Skinner([skin_of(mesh) for mesh in self.meshes], method)
        return self._skinners[method]

    @cached_property
    def _skinners(self) -> dict[str, Skinner]:
        return {}

    @property
    def attachments(self) -> tuple[Mesh, ...]:
        """The rigid parts."""
        return tuple(mesh for mesh in self.meshes if mesh.rigid)

    def rest_motion(self) -> Motion:
        """One frame of the rest pose."""
        skeleton = self.skeleton
        quat = np.zeros((1, len(skeleton), 4))
        quat[..., 0] = 1.0
        slides = np.array([[skeleton.offsets[j] + (self.root_at_rest if skeleton.parents[j] < 0 else 0.0)
                            for j in skeleton.sliding]])  # fmt: skip
        return Motion(skeleton, self.motion.fps, self.root_at_rest[None], quat, slides if skeleton.sliding else None)
