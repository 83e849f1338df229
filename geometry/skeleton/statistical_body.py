"""The body that skin markers are fitted to: joints, and every marker of SURFACE on the bone that carries it.

Its numbers are the mean and principal components of a statistical body over people of all ages and builds
(`scripts/assets/marker_body.py`). Joints are `body.BODY`'s and a roll in each forearm: pronation turns the wrist's
markers and not the elbow's.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.body import BODY, Body
from muybridge.geometry.skeleton.skeleton import Skeleton

_TABLE = Path(__file__).parent / "marker_body.npz"


@dataclass(frozen=True, eq=False)
class MarkerBody:
    """A body whose shape is still open.

    Attributes:
        names, parents, twist_axis: of the J joints; lower, upper: (J, 3) radians.
        rest, spread: (J, 3) radians: mean and standard deviation of the weak prior on each angle.
        mean: (D,) metres: joints' offsets, markers on their joints, landmarks of BODY23 on theirs, one after another.
        basis: (K, D) the same, one standard deviation of each component.
        carrier: (M,) joint that carries each marker of SURFACE.
        soft: (M,) metres, standard deviation of a coordinate, how far skin takes a marker from its place on the bone.
        tolerance: (M,) metres, how differently a marker is placed.
        landmark_names, landmark_joint: of the landmarks.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    twist_axis: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray
    rest: FloatArray
    spread: FloatArray
    mean: FloatArray
    basis: FloatArray
    carrier: IndexArray
    soft: FloatArray
    tolerance: FloatArray
    landmark_names: tuple[str, ...]
    landmark_joint: IndexArray

    def parts(self, vector: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(..., D) -> joints' offsets (..., J, 3), markers (..., M, 3), landmarks (..., 23, 3)."""
        j, m = 3 * len(self.names), 3 * len(SURFACE)
        shape = vector.shape[:-1]
        return (vector[..., :j].reshape(*shape, -1, 3), vector[..., j : j + m].reshape(*shape, -1, 3),
                vector[..., j + m :].reshape(*shape, -1, 3))  # fmt: skip

    def skeleton(self, offsets: FloatArray) -> Skeleton:
        """The skeleton with joints' offsets (J, 3) metres."""
        ends = [j for j in range(len(self.names)) if j not in self.parents]
        tips = np.full(offsets.shape, np.nan)
        for j in ends:
            at = offsets[j]
            part = self.names[j].rsplit("_", 1)[-1]
            # A hand is 0.74 of a forearm long, toes half of the foot before them; the crown is over the head's joint.
            tips[j] = {"hand": 0.74 * at, "toe": np.array([0.0, -0.35, 0.0]) * np.linalg.norm(at)}.get(
                part, np.array([0.0, 0.0, 0.16])
            )
        return Skeleton(self.names, self.parents, offsets, tips, self.twist_axis, self.lower, self.upper)


@functools.cache
def marker_body() -> MarkerBody:
    """The table that the package has."""
    with np.load(_TABLE) as table:
        if tuple(table["surface"].tolist()) != SURFACE.names:
            raise ValueError(f"{_TABLE.name} is of other markers than SURFACE: make it again")
        return MarkerBody(
            names=tuple(str(n) for n in table["names"]),
            parents=tuple(int(p) for p in table["parents"]),
            twist_axis=tuple(int(a) for a in table["twist_axis"]),
            lower=table["lower"],
            upper=table["upper"],
            rest=table["rest"],
            spread=table["spread"],
            mean=table["mean"],
            basis=table["basis"],
            carrier=table["carrier"],
            soft=table["soft"],
            tolerance=table["tolerance"],
            landmark_names=tuple(str(n) for n in table["landmark_names"]),
            landmark_joint=table["landmark_joint"],
        )


def without_rolls(skeleton: Skeleton, rotations: FloatArray) -> tuple[Skeleton, FloatArray]:
    """The same motion with BODY's joints alone: a forearm's roll goes to the hand, which it turns about its own line.

    Args:
        skeleton: of a MarkerBody.
        rotations: (T, J, 3, 3) parent from joint.
    """
    keep = [skeleton.index(n) for n in BODY.joint_names]
    out = rotations[:, keep].copy()
    for k, name in enumerate(BODY.joint_names):
        if name.endswith("hand"):
            roll = skeleton.index(name.replace("hand", "forearm_roll"))
            out[:, k] = rotations[:, roll] @ out[:, k]
    lower, upper = BODY.lower.copy(), BODY.upper.copy()
    lower, upper = np.minimum(lower, skeleton.lower[keep]), np.maximum(upper, skeleton.upper[keep])
    for k, name in enumerate(BODY.joint_names):
        if name.endswith("hand"):
            roll = skeleton.index(name.replace("hand", "forearm_roll"))
            lower[k, 0], upper[k, 0] = skeleton.lower[roll, 0], skeleton.upper[roll, 0]
    return Skeleton(BODY.joint_names, BODY.parents, skeleton.offsets[keep], skeleton.tips[keep], BODY.twist_axis,
                    lower, upper), out  # fmt: skip


def body_of(skeleton: Skeleton, landmarks: FloatArray, stature_m: float) -> Body:
    """BODY's skeleton with landmarks (23, 3) metres on the joints of `MarkerBody.landmark_joint`."""
    table = marker_body()
    joints = np.array([skeleton.index(table.names[j]) for j in table.landmark_joint], dtype=np.intp)
    return Body(skeleton, table.landmark_names, joints, landmarks, stature_m)
