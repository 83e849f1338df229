"""Motion: joint rotations, root positions and, where joints slide, translations of a skeleton over time."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Motion:
    """A skeleton over time.

    Attributes:
        skeleton: the joints; its bones have one length for the whole take, except above sliding joints.
        fps: frames per second.
        root_positions_world: (T, 3) metres, Z up; of the first root.
        quat_wxyz: (T, J, 4) rotation of each joint relative to its parent (a root's: to the world), unit
            length, without sign flips from frame to frame.
        translations: (T, S, 3) metres from the parent to each of `skeleton.sliding`, in the parent's axes (in the
            world for a root); None where no joint slides.
    """

    skeleton: Skeleton
    fps: float
    root_positions_world: FloatArray
    quat_wxyz: FloatArray
    translations: FloatArray | None = None

    def __post_init__(self) -> None:
        t = len(self.root_positions_world)
        if self.root_positions_world.shape != (t, 3):
            raise ValueError(f"root_positions_world must be (T, 3), not {self.root_positions_world.shape}")
        if self.quat_wxyz.shape != (t, len(self.skeleton), 4):
            raise ValueError(
                f"quat_wxyz must be {(t, len(self.skeleton), 4)}, as root_positions_world and the skeleton "
                f"require, not {self.quat_wxyz.shape}"
            )
        count = len(self.skeleton.sliding)
        shape = None if self.translations is None else self.translations.shape
        if shape != ((t, count, 3) if count else None):
            raise ValueError(
                f"translations must be {(t, count, 3) if count else None}, as {count} joints of the skeleton slide, "
                f"not {shape}"
            )

    def __len__(self) -> int:
        return len(self.root_positions_world)

    def forward(self) -> FloatArray:
        """world_from_joints: (T, J, 4, 4). At rest every joint has the world's axes."""
        turns, places = self.skeleton.forward(
            self.root_positions_world, matrix_from_quat(self.quat_wxyz), self.translations
        )
        out = np.zeros((*places.shape[:2], 4, 4))
        out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = turns, places, 1.0
        return out

    def joint_frames(self) -> FloatArray:
        """world_from_joints: (T, J, 4, 4), each joint in its own axes (`Skeleton.axes`)."""
        out = self.forward()
        if self.skeleton.axes is not None:
            out[..., :3, :3] = out[..., :3, :3] @ self.skeleton.axes
        return out

    def joint_positions_world(self) -> FloatArray:
        """(T, J, 3) metres."""
        return np.asarray(self.forward()[..., :3, 3])

    def select(self, frames: Any) -> "Motion":
        """The motion at some frames: whatever indexes an array's first axis and keeps it (a slice, a mask, indices)."""
        return replace(
            self,
            root_positions_world=self.root_positions_world[frames],
            quat_wxyz=self.quat_wxyz[frames],
            translations=None if self.translations is None else self.translations[frames],
        )

    def with_rigid_bones(self, tolerance: float = 1e-3) -> "Motion":
        """The same motion with every sliding joint held at its mean translation.

        Args:
            tolerance: metres that a joint may slide and still be held.

        Raises:
            ValueError: a joint slides farther, or there are several roots; the message names it.
        """
        skeleton = self.skeleton
        if self.translations is None:
            return self
        if len(skeleton.roots) > 1:
            names = ", ".join(skeleton.names[r] for r in skeleton.roots)
            raise ValueError(f"there are {len(skeleton.roots)} roots ({names})")
        reach = np.ptp(self.translations, axis=0).max(axis=1) if len(self) else np.zeros(len(skeleton.sliding))
        if len(reach) and reach.max() > tolerance:
            name = skeleton.names[skeleton.sliding[int(np.argmax(reach))]]
            raise ValueError(f"the joint {name!r} slides by {reach.max() * 1e3:.1f} mm against its parent")
        offsets = skeleton.offsets.copy()
        if len(self):
            offsets[list(skeleton.sliding)] = self.translations.mean(axis=0)
        return replace(self, skeleton=replace(skeleton, offsets=offsets, sliding=()), translations=None)
