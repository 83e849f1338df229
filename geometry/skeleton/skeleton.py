"""A skeleton and its motion.

Rest pose: T-pose, Z up, facing -Y, so that the subject's left is +X. Every joint's own axes are the world's
in the rest pose; a joint's rotation is relative to its parent, and turns everything below it.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_swing_twist, swing_twist_from_matrix


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints with a parent each, constant offsets and ranges of motion.

    A joint's rotation is written in three angles about x, y and z of the rest pose: a twist about
    `twist_axis` (along the bone) first, then a swing, the rotation vector of the two other components. A
    joint whose lower and upper limit agree about an axis does not move about it: a hinge has one open range.

    Attributes:
        names: the `J` joints.
        parents: (J,) index of the parent, -1 for the root, which is first; parents before children.
        offsets: (J, 3) metres from the parent, in the parent's axes; the root's is zero.
        tips: (J, 3) metres from a joint to the end of its bone where it has no child (NaN where it has).
        twist_axis: (J,) 0, 1 or 2.
        lower: (J, 3) radians; the root's limits are infinite.
        upper: (J, 3) radians.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    tips: FloatArray
    twist_axis: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        j = len(self.names)
        if len(set(self.names)) != j:
            raise ValueError("joint names must differ")
        if len(self.parents) != j or j == 0 or self.parents[0] != -1:
            raise ValueError("there must be one parent per joint, and the first joint must be the root (-1)")
        if any(not 0 <= p < i for i, p in enumerate(self.parents[1:], start=1)):
            raise ValueError("a joint's parent must stand before it; only the first joint is a root")
        for name in ("offsets", "tips", "lower", "upper"):
            if getattr(self, name).shape != (j, 3):
                raise ValueError(f"{name} must have the shape ({j}, 3), not {getattr(self, name).shape}")

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Position of joint `name`; ValueError if there is none."""
        return self.names.index(name)

    @property
    def bone_lengths(self) -> FloatArray:
        """(J,) metres from the parent to each joint; zero for the root."""
        return np.asarray(np.linalg.norm(self.offsets, axis=1))

    @property
    def is_ancestor(self) -> BoolArray:
        """(J, J): `[a, j]` is whether joint `a` is `j` or above it."""
        above = np.eye(len(self), dtype=np.bool_)
        for j, parent in enumerate(self.parents):
            if parent >= 0:
                above[:, j] |= above[:, parent]
        return above

    def forward(self, root_positions_world: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Joint orientations and positions in the world.

        Args:
            root_positions_world: (T, 3) metres.
            rotations: (T, J, 3, 3) parent from joint.

        Returns:
            (T, J, 3, 3) world from joint, (T, J, 3) metres.
        """
        turns, places = np.empty_like(rotations), np.empty(rotations.shape[:-1])
        for j, parent in enumerate(self.parents):
            if parent < 0:
                turns[:, j], places[:, j] = rotations[:, j], root_positions_world
            else:
                turns[:, j] = turns[:, parent] @ rotations[:, j]
                places[:, j] = places[:, parent] + turns[:, parent] @ self.offsets[j]
        return turns, places

    def rotations_from_angles(self, angles: FloatArray) -> FloatArray:
        """(T, J, 3) swing and twist angles -> (T, J, 3, 3) parent from joint."""
        out = np.empty((*angles.shape, 3))
        for axis in range(3):
            chosen = [j for j in range(len(self)) if self.twist_axis[j] == axis]
            out[:, chosen] = matrix_from_swing_twist(angles[:, chosen], axis)
        return out

    def angles_from_rotations(self, rotations: FloatArray) -> FloatArray:
        """(T, J, 3, 3) parent from joint -> (T, J, 3) swing and twist angles."""
        out = np.empty(rotations.shape[:-1])
        for axis in range(3):
            chosen = [j for j in range(len(self)) if self.twist_axis[j] == axis]
            out[:, chosen] = swing_twist_from_matrix(rotations[:, chosen], axis)
        return out
