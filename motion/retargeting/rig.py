"""A skeleton brought into one common form: the part that moves, at rest with Z up and facing -Y.

Whatever a file's axes, root bones and control bones are, retargeting works between two skeletons of this form.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.roles.standing import body_axes_at_rest, standing_pose
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton

SIDES = ("left", "right")


@dataclass(frozen=True, eq=False)
class Rig:
    """The moving part of a skeleton.

    Attributes:
        names: of its joints, the mover first: the lowest joint that legs and arms hang from.
        parents: (K,) of them, -1 for the mover.
        joints: (K,) their indices in the file's skeleton.
        roles: role -> index here.
        places: (K, 3) metres at rest, the mover at the origin; X is the body's left, -Y ahead, Z up.
        tips: (K, 3) metres at rest, NaN where not known.
        unposed: (K, 3, 3) this rest from the file's rest: an orientation of the file, times this transposed, is one
            of the rig.
        detached: joints (of here) that hang elsewhere in the file.
        mover_at_rest: (3,) metres in the file's world, Z up.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    joints: tuple[int, ...]
    roles: dict[str, int]
    places: FloatArray
    tips: FloatArray
    unposed: FloatArray
    detached: tuple[int, ...]
    mover_at_rest: FloatArray

    @property
    def turn(self) -> FloatArray:
        """(3, 3) the rig's axes from the file's, at the mover."""
        return np.asarray(self.unposed[0])

    def skeleton(self) -> Skeleton:
        """Of bones with one length."""
        offsets = self.places - self.places[list(self.parents)]
        offsets[0] = 0.0
        wide = np.full((len(self.names), 3), np.pi)
        return Skeleton(self.names, self.parents, offsets, self.tips, (0,) * len(self.names), -wide, wide)

    def path(self, low: int, high: int) -> list[int]:
        """Joints from `high` down to `low`, without `high`; empty where it is not above."""
        out = []
        while low != high and low >= 0:
            out.append(low)
            low = self.parents[low]
        return out[::-1] if low == high else []

    def above(self, j: int) -> list[int]:
        """A joint and those above it, itself first."""
        out = []
        while j >= 0:
            out.append(j)
            j = self.parents[j]
        return out

    def joint_places(self, turns: FloatArray, mover: FloatArray) -> FloatArray:
        """(T, K, 3) metres of the joints in the world, of orientations (T, K, 3, 3) and the mover's places (T, 3)."""
        out = np.empty((*turns.shape[:2], 3))
        out[:, 0] = mover
        for j, parent in enumerate(self.parents):
            if parent >= 0:
                out[:, j] = out[:, parent] + turns[:, parent] @ (self.places[j] - self.places[parent])
        return out

    def leg_length(self) -> float:
        """Metres of thigh and shin, the mean of both legs."""
        return float(np.mean([self.length(f"{s}_thigh", f"{s}_shin", f"{s}_foot") for s in SIDES]))

    def length(self, *roles: str) -> float:
        """Metres between the joints of these roles, one after the other."""
        return float(np.linalg.norm(np.diff(self.places[[self.roles[r] for r in roles]], axis=0), axis=1).sum())


def make_rig(skeleton: Skeleton, roles: Mapping[str, int], root_at_rest: FloatArray | None = None,
             motion: Motion | None = None) -> Rig:  # fmt: skip
    """The moving part of a skeleton.

    Args:
        skeleton: of a file.
        roles: its core roles at least.
        root_at_rest: (3,) metres of the first root at rest; None for the origin.
        motion: of it; where the rest pose does not stand (legs that point up, as in files without one), the frame that
            stands straightest serves as rest.
    """
    places, turns = standing_pose(skeleton, roles, motion)
    parents, detached = _joined(skeleton, roles)
    mover = _mover(parents, roles)
    joints = [mover]
    for j, parent in _by_depth(parents):
        if parent in joints and j not in joints:
            joints.append(j)
    index = {j: k for k, j in enumerate(joints)}
    axes = body_axes_at_rest(places, roles)
    unposed = axes.T @ turns[joints]
    start = np.zeros(3) if root_at_rest is None else root_at_rest
    return Rig(
        tuple(skeleton.names[j] for j in joints), (-1, *(index[parents[j]] for j in joints[1:])), tuple(joints),
        {role: index[j] for role, j in roles.items() if j in index},
        (places[joints] - places[mover]) @ axes, (skeleton.tips[joints][:, None] @ np.swapaxes(unposed, -1, -2))[:, 0],
        unposed, tuple(index[j] for j in detached), places[mover] + start,
    )  # fmt: skip


def _joined(skeleton: Skeleton, roles: Mapping[str, int]) -> tuple[list[int], list[int]]:
    """Parents with the feet below their shins, and the feet that are elsewhere in the file."""
    parents, detached = list(skeleton.parents), []
    for side in SIDES:
        foot, shin = roles.get(f"{side}_foot", -1), roles.get(f"{side}_shin", -1)
        if foot >= 0 and shin >= 0 and not skeleton.is_ancestor[shin, foot]:
            parents[foot] = shin
            detached.append(foot)
    return parents, detached


def _mover(parents: list[int], roles: Mapping[str, int]) -> int:
    """The lowest joint that hips, thighs and upper arms hang from, or are."""
    lines = []
    for role in ("hips", "left_thigh", "right_thigh", "left_upper_arm", "right_upper_arm"):
        line, j = [], roles[role]
        while j >= 0:
            line.append(j)
            j = parents[j]
        lines.append(line)
    shared = [j for j in lines[0] if all(j in line for line in lines[1:])]
    if not shared:
        raise ValueError("legs and arms hang from different roots")
    return shared[0]


def _by_depth(parents: list[int]) -> list[tuple[int, int]]:
    """(joint, parent), parents first."""
    depth = []
    for j in range(len(parents)):
        k, steps = j, 0
        while parents[k] >= 0:
            k, steps = parents[k], steps + 1
        depth.append(steps)
    return [(j, parents[j]) for j in sorted(range(len(parents)), key=lambda j: (depth[j], j))]


@dataclass(frozen=True, eq=False)
class Posed:
    """A rig over time.

    Attributes:
        turns: (T, K, 3, 3) world from joint.
        places: (T, K, 3) metres in the world, Z up.
    """

    turns: FloatArray
    places: FloatArray


def pose_rig(rig: Rig, motion: Motion) -> Posed:
    """A motion of a file's skeleton, as its rig moves."""
    needed = {0}
    for j in rig.joints:
        while j >= 0 and j not in needed:
            needed.add(j)
            j = motion.skeleton.parents[j]
    chosen = sorted(needed)
    index = {j: k for k, j in enumerate(chosen)}
    some = _part(motion, chosen, index)
    turns, places = some.skeleton.forward(
        some.root_positions_world, matrix_from_quat(some.quat_wxyz), some.translations
    )
    joints = [index[j] for j in rig.joints]
    return Posed(turns[:, joints] @ np.swapaxes(rig.unposed, -1, -2), places[:, joints])


def _part(motion: Motion, chosen: list[int], index: Mapping[int, int]) -> Motion:
    """The motion of some joints and all above them; the first one is among them."""
    whole = motion.skeleton
    slides = [k for k, j in enumerate(whole.sliding) if j in index]
    skeleton = Skeleton(
        tuple(whole.names[j] for j in chosen), tuple(index.get(whole.parents[j], -1) for j in chosen),
        whole.offsets[chosen], whole.tips[chosen], tuple(whole.twist_axis[j] for j in chosen), whole.lower[chosen],
        whole.upper[chosen], None, tuple(index[whole.sliding[k]] for k in slides),
    )  # fmt: skip
    shifts = motion.translations[:, slides] if motion.translations is not None and slides else None
    return Motion(skeleton, motion.fps, motion.root_positions_world, motion.quat_wxyz[:, chosen], shifts)


def part_of(rig: Rig, chosen: list[int]) -> Rig:
    """Some joints of a rig, ascending: the mover, and with each joint those above it."""
    index = {j: k for k, j in enumerate(chosen)}
    return Rig(
        tuple(rig.names[j] for j in chosen), tuple(index.get(rig.parents[j], -1) for j in chosen),
        tuple(rig.joints[j] for j in chosen), {role: index[j] for role, j in rig.roles.items() if j in index},
        rig.places[chosen], rig.tips[chosen], rig.unposed[chosen], tuple(index[j] for j in rig.detached if j in index),
        rig.mover_at_rest,
    )  # fmt: skip


def named_part(rig: Rig) -> Rig:
    """The joints of a rig that have a role, and those above them."""
    return part_of(rig, sorted({k for j in rig.roles.values() for k in rig.above(j)}))


def legs_of(rig: Rig) -> list[int]:
    """The joints of a rig that carry the feet, or hang from them."""
    feet = [rig.roles[f"{side}_foot"] for side in SIDES]
    lines = {j for foot in feet for j in rig.above(foot)}
    return [j for j in range(len(rig.parents)) if j in lines or any(foot in rig.above(j) for foot in feet)]
