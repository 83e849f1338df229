"""Motion: joint rotations and root positions of a skeleton over time."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Motion:
    """A skeleton over time.

    Attributes:
        skeleton: its bones have one length for the whole take.
        fps: frames a second.
        root_positions_world: (T, 3) metres, Z up.
        quat_wxyz: (T, J, 4) rotation of each joint relative to its parent (the root's: to the world), unit
            length, without sign flips from frame to frame.
    """

    skeleton: Skeleton
    fps: float
    root_positions_world: FloatArray
    quat_wxyz: FloatArray

    def __post_init__(self) -> None:
        t = len(self.root_positions_world)
        if self.root_positions_world.shape != (t, 3):
            raise ValueError(f"root_positions_world must be (T, 3), not {self.root_positions_world.shape}")
        if self.quat_wxyz.shape != (t, len(self.skeleton), 4):
            raise ValueError(
                f"quat_wxyz must be {(t, len(self.skeleton), 4)}, as root_positions_world and the skeleton "
                f"say, not {self.quat_wxyz.shape}"
            )

    def __len__(self) -> int:
        return len(self.root_positions_world)

    def forward(self) -> FloatArray:
        """world_from_joints: (T, J, 4, 4)."""
        turns, places = self.skeleton.forward(self.root_positions_world, matrix_from_quat(self.quat_wxyz))
        out = np.zeros((*places.shape[:2], 4, 4))
        out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = turns, places, 1.0
        return out

    def joint_positions_world(self) -> FloatArray:
        """(T, J, 3) metres."""
        return np.asarray(self.forward()[..., :3, 3])
