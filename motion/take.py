"""The contents of a file: points or a motion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.points.c3d import C3DTake


@dataclass(frozen=True, eq=False)
class Keys:
    """Frames of a motion between which it moves evenly, for formats that hold keys.

    Attributes:
        rotations: (T, J) which frames are keys of each joint's rotation.
        positions: (T, 1 + S) likewise of the first root's position, and of the translations of sliding joints.
    """

    rotations: BoolArray
    positions: BoolArray

    @property
    def count(self) -> int:
        """All keys."""
        return int(self.rotations.sum() + self.positions.sum())


@dataclass(frozen=True, eq=False)
class Take:
    """The contents of a file: points or a motion.

    Attributes:
        points: None in a file of motion.
        motion: None in a file of points.
        c3d: the contents of a C3D besides points.
        start: seconds of the recording at which the first frame is, where the file states it.
        notices: assumptions made in reading, one sentence each.
        keys: which frames of the motion are keys; None: all.
        humanoid: bone of the VRM humanoid -> index of the joint, of a file that states them.
    """

    points: Points3D | None = None
    motion: Motion | None = None
    c3d: C3DTake | None = None
    start: float = 0.0
    notices: tuple[str, ...] = field(default_factory=tuple)
    keys: Keys | None = None
    humanoid: Mapping[str, int] = field(default_factory=dict)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.positions.fps if self.motion is None else self.motion.fps

    @property
    def positions(self) -> Points3D:
        """The points, or the joint positions of the motion."""
        if self.points is not None:
            return self.points
        assert self.motion is not None
        return points_of_motion(self.motion)


def points_of_motion(motion: Motion) -> Points3D:
    """The joint positions over time, by forward kinematics; edges are the bones."""
    skeleton = motion.skeleton
    xyz = motion.joint_positions_world()
    edges = tuple((skeleton.names[p], n) for n, p in zip(skeleton.names, skeleton.parents, strict=True) if p >= 0)
    t, j = xyz.shape[:2]
    return Points3D(
        landmarks=LandmarkSet("joints", skeleton.names, edges),
        points_world=xyz,
        covariance_world=np.full((t, j, 3, 3), np.nan),
        residual_px=np.empty((0, t, j)),
        inlier=np.empty((0, t, j), dtype=np.bool_),
        fps=motion.fps,
    )
