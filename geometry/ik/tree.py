"""Trees of hinges: forward kinematics, goals of their end effectors, and the Jacobian.

Every joint turns about one axis; a ball joint is three joints at one place. The base is fixed. Angles are in
radians, lengths in metres; goals are in the base's axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from muybridge.arrays import FloatArray, IndexArray, IntArray
from muybridge.geometry.fitting._chain_kernel import exp_one
from muybridge.geometry.numerics._numba import compiled
from muybridge.geometry.skeleton.skeleton import Skeleton, require_one_rigid_tree


class Links(NamedTuple):
    """A tree, for the kernels."""

    parents: IntArray  # (N,)
    offsets: FloatArray  # (N, 3) from the parent's place, in the axes after the parent's turn
    axes: FloatArray  # (N, 3) unit, in the same axes
    lower: FloatArray  # (N,)
    upper: FloatArray  # (N,)


class GoalArrays(NamedTuple):
    """Goals, for the kernels: places, and pairs of a local axis and the direction it should have."""

    joint: IntArray  # (E,)
    offset: FloatArray  # (E, 3)
    place: FloatArray  # (E, 3)
    place_weight: FloatArray  # (E,) 0: no place is asked for
    local: FloatArray  # (E, 3, 3) rows are axes in the effector's own axes
    world: FloatArray  # (E, 3, 3) rows are the directions they should have
    pairs: IntArray  # (E,) how many rows count: 0, 1 (a direction) or 3 (an orientation)
    turn_weight: FloatArray  # (E,) metres per radian


# The former name: kernels that were compiled before and lie in numba's cache refer to it, and numba looks it up before
# it sees that they are out of date.
Wishes = GoalArrays


@dataclass(frozen=True, eq=False)
class KinematicTree:
    """Hinges, parents before children, on a base that does not move.

    Attributes:
        names: (N,) one per joint; the hinges of a ball joint have a name each.
        parents: (N,) -1 where the joint is on the base.
        offsets: (N, 3) metres from the parent's place, in the parent's axes.
        axes: (N, 3) unit vectors that the joints turn about, in the parent's axes.
        lower, upper: (N,) radians; infinite where free.
        preferred: (N,) radians, for secondary goals.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    axes: FloatArray
    lower: FloatArray
    upper: FloatArray
    preferred: FloatArray

    def __post_init__(self) -> None:
        n = len(self.names)
        if n == 0 or len(self.parents) != n or any(not -1 <= p < j for j, p in enumerate(self.parents)):
            raise ValueError("there must be one parent a joint, -1 or a joint before it")
        for name, shape in (("offsets", (n, 3)), ("axes", (n, 3)), ("lower", (n,)), ("upper", (n,))):
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{name} must have the shape {shape}, not {np.shape(getattr(self, name))}")
        if not np.allclose(np.linalg.norm(self.axes, axis=1), 1.0, atol=1e-9):
            raise ValueError("axes must be unit vectors")
        if not (self.lower <= self.upper).all():
            raise ValueError("a lower limit is above its upper limit")

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def links(self) -> Links:
        """The same for the kernels."""
        return Links(
            np.array(self.parents, dtype=np.int64),
            np.ascontiguousarray(self.offsets, dtype=np.float64),
            np.ascontiguousarray(self.axes, dtype=np.float64),
            np.array(self.lower, dtype=np.float64),
            np.array(self.upper, dtype=np.float64),
        )

    def clipped(self, theta: FloatArray) -> FloatArray:
        """(N,) within the limits."""
        return np.clip(np.asarray(theta, dtype=np.float64), self.lower, self.upper)

    def forward(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(N, 3, 3) base from joint, after its turn, and (N, 3) places."""
        n = len(self)
        turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
        forward(self.links, np.asarray(theta, dtype=np.float64), turns, places, axes)
        return turns, places

    def reach(self, joint: int, offset: FloatArray) -> float:
        """Longest distance from the base to a point on a joint: the sum of the links."""
        total = float(np.linalg.norm(offset))
        while joint >= 0:
            if self.parents[joint] >= 0:
                total += float(np.linalg.norm(self.offsets[joint]))
            joint = self.parents[joint]
        return total

    def jacobian(self, theta: FloatArray, goals: Sequence[Goal]) -> FloatArray:
        """(6 E, N) unweighted: place and turn of each effector by each angle."""
        targets = goal_arrays(self, goals)
        n = len(self)
        turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
        forward(self.links, np.asarray(theta, dtype=np.float64), turns, places, axes)
        out = np.zeros((6 * len(goals), n))
        for e, goal in enumerate(goals):
            point = places[goal.joint] + turns[goal.joint] @ targets.offset[e]
            j = goal.joint
            while j >= 0:
                out[6 * e : 6 * e + 3, j] = np.cross(axes[j], point - places[j])
                out[6 * e + 3 : 6 * e + 6, j] = axes[j]
                j = self.parents[j]
        return out


@dataclass(frozen=True, eq=False)
class Goal:
    """What one end effector should do.

    Attributes:
        joint: the joint that carries it.
        offset: (3,) metres in that joint's axes.
        position: (3,) metres in the base's axes, or None.
        orientation: (3, 3) base from effector, or None.
        direction: (local axis (3,), base direction (3,)), unit vectors: this axis should point there; or None.
        position_weight: of metres.
        orientation_weight: metres per radian: what an orientation or direction counts beside a position.
    """

    joint: int
    offset: FloatArray
    position: FloatArray | None = None
    orientation: FloatArray | None = None
    direction: tuple[FloatArray, FloatArray] | None = None
    position_weight: float = 1.0
    orientation_weight: float = 0.2


def goal_arrays(tree: KinematicTree, goals: Sequence[Goal]) -> GoalArrays:
    """Goals for the kernels.

    Raises:
        ValueError: no goal, a joint that does not exist, or an orientation and a direction at once.
    """
    if not goals:
        raise ValueError("at least one goal is needed")
    e = len(goals)
    out = GoalArrays(
        np.array([g.joint for g in goals], dtype=np.int64),
        np.array([g.offset for g in goals], dtype=np.float64).reshape(e, 3),
        np.zeros((e, 3)), np.zeros(e), np.zeros((e, 3, 3)), np.zeros((e, 3, 3)),
        np.zeros(e, dtype=np.int64), np.zeros(e),
    )  # fmt: skip
    for k, goal in enumerate(goals):
        if not 0 <= goal.joint < len(tree):
            raise ValueError(f"goal {k} is of joint {goal.joint}: there are {len(tree)}")
        if goal.orientation is not None and goal.direction is not None:
            raise ValueError(f"goal {k} has both an orientation and a direction: give one")
        if goal.position is not None:
            out.place[k], out.place_weight[k] = goal.position, goal.position_weight
        if goal.orientation is not None:
            out.local[k], out.world[k], out.pairs[k] = np.eye(3), np.transpose(goal.orientation), 3
            out.turn_weight[k] = goal.orientation_weight
        if goal.direction is not None:
            out.local[k, 0], out.world[k, 0] = goal.direction
            out.pairs[k], out.turn_weight[k] = 1, goal.orientation_weight
    return out


def chain_of_balls(
    lengths: Sequence[float], limit: float = np.inf, direction: FloatArray | None = None
) -> KinematicTree:
    """A chain of ball joints; at rest it lies along `direction` (z). The last joint carries the last link."""
    along = np.array([0.0, 0, 1]) if direction is None else np.asarray(direction, dtype=np.float64)
    n = 3 * len(lengths)
    offsets = np.zeros((n, 3))
    for k in range(1, len(lengths)):
        offsets[3 * k] = along * lengths[k - 1]
    return KinematicTree(
        tuple(f"{k}{axis}" for k in range(len(lengths)) for axis in "xyz"), tuple(range(-1, n - 1)), offsets,
        np.tile(np.eye(3), (len(lengths), 1)), np.full(n, -limit), np.full(n, limit), np.zeros(n),
    )  # fmt: skip


def tree_of_skeleton(skeleton: Skeleton, preferred: FloatArray | None = None) -> tuple[KinematicTree, IndexArray]:
    """A skeleton's open angles as hinges, its root fixed: swing axes first, then the twist.

    Args:
        skeleton: with limits.
        preferred: (J, 3) radians about x, y, z; zero within the limits if None.

    Returns:
        The tree, and (J,) the last hinge of each joint (of its nearest ancestor that has one; -1 on the base): what
        a goal for that joint names. A joint without hinges shifts what follows by its offset.

    Raises:
        ValueError: the skeleton has several roots, or joints that slide.
    """
    require_one_rigid_tree(skeleton, "inverse kinematics")
    names: list[str] = []
    parents: list[int] = []
    rows: list[tuple[FloatArray, FloatArray, float, float, float]] = []
    last = np.full(len(skeleton), -1, dtype=np.intp)
    carried = np.zeros((len(skeleton), 3))  # of joints without hinges, in the axes of their last hinge
    for j in range(1, len(skeleton)):
        up = skeleton.parents[j]
        last[j], offset = last[up], carried[up] + skeleton.offsets[j]
        twist = skeleton.twist_axis[j]
        for axis in [a for a in range(3) if a != twist] + [twist]:
            low, high = float(skeleton.lower[j, axis]), float(skeleton.upper[j, axis])
            if high - low <= 1e-9:
                continue
            target = float(np.clip(0.0 if preferred is None else preferred[j, axis], low, high))
            rows.append((offset, np.eye(3)[axis], low, high, target))
            names.append(f"{skeleton.names[j]}.{'xyz'[axis]}")
            parents.append(int(last[j]))
            last[j], offset = len(names) - 1, np.zeros(3)
        carried[j] = offset
    offsets, axes, lower, upper, wished = (np.array(v, dtype=np.float64) for v in zip(*rows, strict=True))
    return KinematicTree(tuple(names), tuple(parents), offsets, axes, lower, upper, wished), last


def theta_of_rotations(tree: KinematicTree, skeleton: Skeleton, rotations: FloatArray) -> FloatArray:
    """(T, J, 3, 3) parent from joint of the skeleton -> (T, N) angles of its tree, within the limits."""
    out = np.zeros((len(rotations), len(tree)))
    for j in range(1, len(skeleton)):
        twist = skeleton.twist_axis[j]
        order = "".join("XYZ"[a] for a in range(3) if a != twist) + "XYZ"[twist]
        angles = scipy.spatial.transform.Rotation.from_matrix(rotations[:, j]).as_euler(order, suppress_warnings=True)
        for k, axis in enumerate(order.lower()):
            if (name := f"{skeleton.names[j]}.{axis}") in tree.names:
                out[:, tree.names.index(name)] = angles[:, k]
    return np.clip(out, tree.lower, tree.upper)


@compiled
def forward_joint(
    links: Links, theta: FloatArray, j: int, little: FloatArray, turns: FloatArray, places: FloatArray, axes: FloatArray
) -> None:
    """Joint `j` from its parent; `little` (3, 3) is scratch."""
    up, a, o = links.parents[j], links.axes[j], links.offsets[j]
    exp_one(a[0] * theta[j], a[1] * theta[j], a[2] * theta[j], little)
    if up < 0:
        for i in range(3):
            places[j, i], axes[j, i] = o[i], a[i]
            for k in range(3):
                turns[j, i, k] = little[i, k]
        return
    r = turns[up]
    for i in range(3):
        places[j, i] = places[up, i] + r[i, 0] * o[0] + r[i, 1] * o[1] + r[i, 2] * o[2]
        axes[j, i] = r[i, 0] * a[0] + r[i, 1] * a[1] + r[i, 2] * a[2]
        for k in range(3):
            turns[j, i, k] = r[i, 0] * little[0, k] + r[i, 1] * little[1, k] + r[i, 2] * little[2, k]


@compiled
def forward(links: Links, theta: FloatArray, turns: FloatArray, places: FloatArray, axes: FloatArray) -> None:
    """Base from joint (N, 3, 3), places (N, 3) and the joints' axes (N, 3), all in the base's axes."""
    forward_from(links, theta, 0, turns, places, axes)


@compiled
def forward_from(
    links: Links, theta: FloatArray, start: int, turns: FloatArray, places: FloatArray, axes: FloatArray
) -> None:
    """`forward` where only angles from joint `start` on have changed."""
    little = np.empty((3, 3))
    for j in range(start, len(links.parents)):
        forward_joint(links, theta, j, little, turns, places, axes)


@compiled
def rotate(r: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """`r v`."""
    for i in range(3):
        out[i] = r[i, 0] * v[0] + r[i, 1] * v[1] + r[i, 2] * v[2]


@compiled
def rotation_error(r: FloatArray, local: FloatArray, world: FloatArray, pairs: int, out: FloatArray) -> float:
    """(3,) rotation vector that brings the effector's axes where they should be, in the base's axes; its length."""
    v = np.empty(3)
    out[:] = 0.0
    if pairs == 0:
        return 0.0
    cosine = 0.0
    for k in range(pairs):
        rotate(r, local[k], v)
        w = world[k]
        out[0] += v[1] * w[2] - v[2] * w[1]
        out[1] += v[2] * w[0] - v[0] * w[2]
        out[2] += v[0] * w[1] - v[1] * w[0]
        cosine += v[0] * w[0] + v[1] * w[1] + v[2] * w[2]
    sine = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    if pairs == 3:
        # The sum of the three cross products is 2 sin(angle) axis, of the dot products 1 + 2 cos(angle).
        sine, cosine = 0.5 * sine, 0.5 * (cosine - 1)
        out[:] *= 0.5
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        out[:] *= angle / sine
    elif cosine < 0:
        # Half a turn off: any axis at right angles to the first pair will do to get away.
        rotate(r, local[0], v)
        i = 0 if abs(v[0]) < 0.6 else 1
        unit = np.zeros(3)
        unit[i] = 1.0
        out[0], out[1], out[2] = (
            v[1] * unit[2] - v[2] * unit[1],
            v[2] * unit[0] - v[0] * unit[2],
            (v[0] * unit[1] - v[1] * unit[0]),
        )
        out[:] *= math.pi / math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    return angle


@compiled
def errors(links: Links, targets: GoalArrays, theta: FloatArray, place: FloatArray, turn: FloatArray) -> float:
    """Fills (E,) metres and (E,) radians of how far the goals are off (0 where not asked for); the weighted sum of
    squares."""
    n = len(links.parents)
    turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    forward(links, theta, turns, places, axes)
    point, v = np.empty(3), np.empty(3)
    total = 0.0
    for e in range(len(targets.joint)):
        j = targets.joint[e]
        place[e] = turn[e] = 0.0
        if targets.place_weight[e] > 0:
            rotate(turns[j], targets.offset[e], point)
            square = 0.0
            for i in range(3):
                square += (targets.place[e, i] - point[i] - places[j, i]) ** 2
            place[e] = math.sqrt(square)
            total += targets.place_weight[e] ** 2 * square
        if targets.pairs[e] > 0:
            turn[e] = rotation_error(turns[j], targets.local[e], targets.world[e], targets.pairs[e], v)
            total += (targets.turn_weight[e] * turn[e]) ** 2
    return total
