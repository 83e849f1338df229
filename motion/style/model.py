"""A style: hinges about the mean pose of the examples, and the prior of their angles.

A joint's rotation is written relative to its mean, in three angles about the principal axes of its movement. So the
angles are small, far from where they would become ambiguous, whatever skeleton and rest pose a file has; and a joint
that bends about one axis has one angle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.ik.pose_prior import PosePrior
from muybridge.geometry.ik.tree import KinematicTree
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat
from muybridge.geometry.skeleton.skeleton import Skeleton

_SHORT_M = 0.01  # bones shorter than this have no direction to compare
_ASIDE = np.radians(15)  # by which a bone of a skeleton at rest may point elsewhere


@dataclass(frozen=True, eq=False)
class Style:
    """What was learned from takes, for one skeleton of `J` joints; its proportions may differ.

    Attributes:
        joints: (J,) names.
        parents: (J,) index of the parent, -1 for the root.
        offsets: (J, 3) metres from the parent at rest.
        roles: role -> joint.
        mean_wxyz: (J, 4) mean rotation of each joint relative to its parent; the root's is not used.
        hinge_joints: (N,) joint that each angle turns; angles of a joint stand together, in their order.
        hinge_axes: (N, 3) unit vector that it turns about, in the joint's own axes at the mean.
        lower, upper: (N,) radians within which poses are looked for.
        prior: of the angles.
        takes: names of the takes it was learned from.
        examples: how many poses of them.
    """

    joints: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    roles: Mapping[str, int]
    mean_wxyz: FloatArray
    hinge_joints: IndexArray
    hinge_axes: FloatArray
    lower: FloatArray
    upper: FloatArray
    prior: PosePrior
    takes: tuple[str, ...] = field(default=())
    examples: int = 0

    def check_skeleton(self, skeleton: Skeleton) -> None:
        """Refuse a skeleton whose rotations do not mean the same as the style's.

        Raises:
            MuybridgeError: it has other joints, or bones that point elsewhere at rest; the message names one.
        """
        why = self._difference(skeleton)
        if why is not None:
            raise MuybridgeError(f"the style is of another skeleton: {why}", remedy="other_style")

    def _difference(self, skeleton: Skeleton) -> str | None:
        if skeleton.names != self.joints:
            lacks = [n for n in self.joints if n not in skeleton.names]
            more = [n for n in skeleton.names if n not in self.joints]
            if lacks:
                return f"the motion has no joint {lacks[0]!r}"
            return f"the motion has a joint {more[0]!r} more" if more else "the motion's joints are in another order"
        if skeleton.parents != self.parents:
            j = next(j for j, (a, b) in enumerate(zip(skeleton.parents, self.parents, strict=True)) if a != b)
            return f"the joint {self.joints[j]!r} hangs from another joint"
        lengths = [np.linalg.norm(o, axis=1) for o in (self.offsets, skeleton.offsets)]
        long = (np.minimum(*lengths) > _SHORT_M) & (np.arange(len(skeleton)) > 0)
        cosine = (self.offsets * skeleton.offsets).sum(axis=1)[long] / (lengths[0] * lengths[1])[long]
        if len(cosine) and cosine.min() < np.cos(_ASIDE):
            j = int(np.flatnonzero(long)[np.argmin(cosine)])
            return (f"the bone to {self.joints[j]!r} points {np.degrees(np.arccos(cosine.min())):.0f} degrees "
                    "elsewhere at rest")  # fmt: skip
        return None

    def tree(self, skeleton: Skeleton) -> tuple[KinematicTree, IndexArray, FloatArray]:
        """The style's hinges on a skeleton, in the root's axes, all angles zero at the mean pose.

        Returns:
            The tree; (J,) the last hinge at or above each joint, -1 on the base; and (J, 3) metres from the place of
            that hinge to the joint, in its axes.
        """
        turns = matrix_from_quat(self.mean_wxyz)
        turns[0] = np.eye(3)
        mean, _ = skeleton.forward(np.zeros((1, 3)), turns[None])
        last = np.full(len(skeleton), -1, dtype=np.intp)
        away = np.zeros((len(skeleton), 3))
        parents: list[int] = []
        offsets: list[FloatArray] = []
        for j in range(1, len(skeleton)):
            up = skeleton.parents[j]
            last[j], away[j] = last[up], away[up] + mean[0, up] @ skeleton.offsets[j]
            for _ in np.flatnonzero(self.hinge_joints == j):
                parents.append(int(last[j]))
                offsets.append(away[j].copy())
                last[j], away[j] = len(parents) - 1, np.zeros(3)
        axes = (mean[0, self.hinge_joints] @ self.hinge_axes[..., None])[..., 0]
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        tree = KinematicTree(self.prior.names, tuple(parents), np.array(offsets), axes, self.lower, self.upper,
                             np.zeros(len(parents)))  # fmt: skip
        return tree, last, away

    def rotations(self, theta: FloatArray) -> FloatArray:
        """(T, N) radians -> (T, J, 3, 3) parent from joint; the root's is the identity."""
        out = np.tile(matrix_from_quat(self.mean_wxyz), (len(theta), 1, 1, 1))
        out[:, 0] = np.eye(3)
        for k, j in enumerate(self.hinge_joints):
            out[:, j] = out[:, j] @ exp_so3(theta[:, k, None] * self.hinge_axes[k])
        return out


def angles_about(mean: FloatArray, axes: FloatArray, rotations: FloatArray) -> FloatArray:
    """Angles of one joint: about the first axis, then the second, then the third.

    Args:
        mean: (3, 3) parent from joint, where all angles are zero.
        axes: (3, 3) columns are the axes, right-handed.
        rotations: (T, 3, 3) parent from joint.

    Returns:
        (T, 3) radians.
    """
    turned = axes.T @ mean.T @ rotations @ axes
    return np.asarray(Rotation.from_matrix(turned).as_euler("XYZ", suppress_warnings=True))
