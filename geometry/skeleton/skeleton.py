"""A skeleton: joints with a parent each, constant offsets, their own axes and ranges of motion.

Rest pose of the body model: T-pose, Z up, facing -Y, so that the subject's left is +X. Rotations are written in the
world's axes at rest: a joint's rotation is relative to its parent, is the identity in the rest pose, and turns
everything below it. What other programs call a bone's roll or orientation is kept in `Skeleton.axes`.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_swing_twist, swing_twist_from_matrix


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Joints in a tree, or in several trees.

    A joint's rotation is written in three angles about x, y and z of the rest pose: a twist about
    `twist_axis` (along the bone) first, then a swing, the rotation vector of the two other components. A
    joint whose lower and upper limit agree about an axis does not move about it: a hinge has one open range.

    Attributes:
        names: the `J` joints.
        parents: (J,) index of the parent, -1 for a root. The first joint is a root; parents come before children.
        offsets: (J, 3) metres from the parent at rest, in the world's axes; zero for the first root. Further roots:
            from the first root.
        tips: (J, 3) metres from a joint to the end of its bone where it has no child (NaN where it has).
        twist_axis: (J,) 0, 1 or 2.
        lower: (J, 3) radians; the root's limits are infinite.
        upper: (J, 3) radians.
        axes: (J, 3, 3) world from joint at rest: each joint's own axes as an animation program defines them. None:
            no joint has axes of its own.
        sliding: joints whose translation from the parent changes over time, ascending; `Motion.translations` has it.
            The first root is not among them; every further root is.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    tips: FloatArray
    twist_axis: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray
    axes: FloatArray | None = None
    sliding: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        j = len(self.names)
        if len(set(self.names)) != j:
            raise ValueError("joint names must differ")
        if len(self.parents) != j or j == 0 or self.parents[0] != -1:
            raise ValueError("there must be one parent per joint, and the first joint must be a root (-1)")
        if any(not -1 <= p < i for i, p in enumerate(self.parents)):
            raise ValueError("a joint's parent must come before it, or be -1 for a root")
        for name in ("offsets", "tips", "lower", "upper"):
            if getattr(self, name).shape != (j, 3):
                raise ValueError(f"{name} must have the shape ({j}, 3), not {getattr(self, name).shape}")
        if list(self.sliding) != sorted(set(self.sliding)) or any(not 0 < s < j for s in self.sliding):
            raise ValueError(f"sliding joints must be ascending indices from 1 to {j - 1}, not {self.sliding}")
        if fixed := [self.names[i] for i in self.roots[1:] if i not in self.sliding]:
            raise ValueError(f"the root {fixed[0]!r} is not the first joint, so it must be among the sliding joints")
        if self.axes is not None:
            if self.axes.shape != (j, 3, 3):
                raise ValueError(f"axes must have the shape ({j}, 3, 3), not {self.axes.shape}")
            if not np.allclose(np.swapaxes(self.axes, 1, 2) @ self.axes, np.eye(3), atol=1e-6):
                raise ValueError("axes must be rotation matrices")

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Position of joint `name`; ValueError if there is none."""
        return self.names.index(name)

    @property
    def roots(self) -> tuple[int, ...]:
        """Joints without a parent; joint 0 is the first."""
        return tuple(i for i, parent in enumerate(self.parents) if parent < 0)

    @property
    def bone_lengths(self) -> FloatArray:
        """(J,) metres from the parent to each joint at rest; zero for the first root."""
        return np.asarray(np.linalg.norm(self.offsets, axis=1))

    @property
    def rest_positions(self) -> FloatArray:
        """(J, 3) metres: the joints in the rest pose, the first root at the origin."""
        out = np.zeros((len(self), 3))
        for j, parent in enumerate(self.parents[1:], start=1):
            out[j] = out[parent] + self.offsets[j] if parent >= 0 else self.offsets[j]
        return out

    @property
    def is_ancestor(self) -> BoolArray:
        """(J, J): `[a, j]` is whether joint `a` is `j` or above it."""
        above = np.eye(len(self), dtype=np.bool_)
        for j, parent in enumerate(self.parents):
            if parent >= 0:
                above[:, j] |= above[:, parent]
        return above

    def forward(
        self, root_positions_world: FloatArray, rotations: FloatArray, translations: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Forward kinematics: joint orientations and positions in the world.

        Args:
            root_positions_world: (T, 3) metres, of the first root.
            rotations: (T, J, 3, 3) parent from joint.
            translations: (T, S, 3) metres, of the sliding joints from their parents (further roots: in the world);
                None where no joint slides.

        Returns:
            (T, J, 3, 3) world from joint, (T, J, 3) metres.

        Raises:
            ValueError: the translations are not of this skeleton's sliding joints.
        """
        slides = dict(zip(self.sliding, range(len(self.sliding)), strict=True))
        if slides and (translations is None or translations.shape[1:] != (len(slides), 3)):
            raise ValueError(f"{len(slides)} joints of this skeleton slide: their translations (T, {len(slides)}, 3) "
                             "are needed")  # fmt: skip
        turns, places = np.empty_like(rotations), np.empty(rotations.shape[:-1])
        for j, parent in enumerate(self.parents):
            if parent < 0:
                turns[:, j] = rotations[:, j]
                places[:, j] = translations[:, slides[j]] if translations is not None and j else root_positions_world
            else:
                turns[:, j] = turns[:, parent] @ rotations[:, j]
                if translations is not None and j in slides:
                    shift = (turns[:, parent] @ translations[:, slides[j], :, None])[..., 0]
                else:
                    shift = turns[:, parent] @ self.offsets[j]
                places[:, j] = places[:, parent] + shift
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


def require_one_rigid_tree(skeleton: Skeleton, what: str) -> None:
    """ValueError unless the skeleton has one root and no sliding joint, as `what` needs."""
    if len(skeleton.roots) > 1:
        names = ", ".join(skeleton.names[r] for r in skeleton.roots)
        raise ValueError(f"{what} needs a skeleton with one root, not {len(skeleton.roots)} ({names})")
    if skeleton.sliding:
        names = ", ".join(skeleton.names[s] for s in skeleton.sliding)
        raise ValueError(f"{what} needs bones of constant length, and these joints slide: {names}")
