"""A robot's kinematic tree: links, the joints that move them, and the simple shapes that they are made of."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.robots._tree_kernel import Tree, pose_all

ShapeKind = Literal["sphere", "capsule", "cylinder", "box", "ellipsoid"]


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: its value is `gain` times the other's plus `offset`."""

    joint: str
    gain: float
    offset: float


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of one degree of freedom.

    Attributes:
        name: in the file.
        link: index of the link that it moves.
        kind: hinge (radians) or slide (metres).
        axis: (3,) unit vector in the link's frame.
        anchor: (3,) metres in the link's frame, a point of a hinge's axis.
        lower: smallest value; -inf where there is none.
        upper: largest value.
        velocity: largest speed, radians or metres per second; inf where the file states none.
        rest: value at which the link is where the file puts it.
        mimic: what it follows; None for a joint of its own.
    """

    name: str
    link: int
    kind: Literal["hinge", "slide"]
    axis: FloatArray
    anchor: FloatArray
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    rest: float = 0.0
    mimic: Mimic | None = None


@dataclass(frozen=True, eq=False)
class Shape:
    """A simple solid on a link.

    Attributes:
        link: index.
        kind: of solid.
        size: (3,) metres: radius; radius and half of the length along z; or half edges.
        place: (3,) metres of its centre in the link's frame.
        turn: (3, 3) link from shape.
        solid: whether it is meant to collide.
    """

    link: int
    kind: ShapeKind
    size: FloatArray
    place: FloatArray
    turn: FloatArray
    solid: bool = True

    def support(self, direction: FloatArray) -> float:
        """Metres that the shape reaches in a direction (3,), a unit vector of the link's frame, from its origin."""
        own = direction @ self.turn
        if self.kind == "sphere":
            reach = float(self.size[0])
        elif self.kind == "capsule":
            reach = float(self.size[0] + self.size[1] * abs(own[2]))
        elif self.kind == "cylinder":
            reach = float(self.size[0] * np.hypot(own[0], own[1]) + self.size[1] * abs(own[2]))
        elif self.kind == "box":
            reach = float(np.abs(own) @ self.size)
        else:
            reach = float(np.linalg.norm(own * self.size))
        return reach + float(direction @ self.place)


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of links with a free root.

    Attributes:
        name: of the model.
        path: of its file.
        links: names, the root first, parents before children.
        parents: (L,) index of each link's parent, -1 for the root.
        places: (L, 3) metres in the parent's frame while joints are at rest; the root's: in the world.
        turns: (L, 3, 3) parent from link, likewise.
        joints: in the file's own order, without the root's free joint.
        shapes: solids; meshes are not read.
        masses: (L,) kilograms, 0 where not stated.
        centres: (L, 3) metres, centre of mass in the link's frame; NaN where not stated.
        notices: what was left out or assumed, one sentence each.
    """

    name: str
    path: Path
    links: tuple[str, ...]
    parents: tuple[int, ...]
    places: FloatArray
    turns: FloatArray
    joints: tuple[Joint, ...]
    shapes: tuple[Shape, ...]
    masses: FloatArray
    centres: FloatArray
    notices: tuple[str, ...] = field(default_factory=tuple)

    def __len__(self) -> int:
        return len(self.links)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Joints that follow no other: the unknowns, in the file's order."""
        return tuple(k for k, joint in enumerate(self.joints) if joint.mimic is None)

    @cached_property
    def followed(self) -> FloatArray:
        """(J, D + 1): each joint's value is this times the free joints' values and a one."""
        names = {joint.name: k for k, joint in enumerate(self.joints)}
        column = {k: d for d, k in enumerate(self.free)}
        out = np.zeros((len(self.joints), len(self.free) + 1))
        for k in range(len(self.joints)):
            gain, offset, here, seen = 1.0, 0.0, k, {k}
            while (mimic := self.joints[here].mimic) is not None:
                offset += gain * mimic.offset
                gain *= mimic.gain
                here = names[mimic.joint]
                if here in seen:
                    raise ValueError(f"the joint {self.joints[k].name!r} follows itself")
                seen.add(here)
            out[k, column[here]], out[k, -1] = gain, offset
        return out

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(D,) lower, upper and largest speed of the free joints, those of joints that follow them included."""
        size = len(self.free)
        lower, upper, speed = np.full(size, -np.inf), np.full(size, np.inf), np.full(size, np.inf)
        for joint, row in zip(self.joints, self.followed, strict=True):
            d = int(np.argmax(np.abs(row[:-1])))
            gain = row[d]
            if gain == 0:
                continue
            ends = sorted(((joint.lower - row[-1]) / gain, (joint.upper - row[-1]) / gain))
            lower[d], upper[d] = max(lower[d], ends[0]), min(upper[d], ends[1])
            speed[d] = min(speed[d], joint.velocity / abs(gain))
        return lower, upper, speed

    @cached_property
    def rest(self) -> FloatArray:
        """(D,) values of the free joints in the file's own pose, within their limits."""
        lower, upper, _ = self.limits
        return np.asarray(np.clip(np.array([self.joints[k].rest for k in self.free]), lower, upper))

    def all_joints(self, free: FloatArray) -> FloatArray:
        """(..., J) values of all joints from those of the free ones (..., D)."""
        return np.asarray(free @ self.followed[:, :-1].T + self.followed[:, -1])

    @cached_property
    def tree(self) -> Tree:
        """The same for the compiled kernels: one node a joint, and one for a link that does not move on its own."""
        return _make_tree(self)

    def forward(self, root: FloatArray, turn: FloatArray, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forward kinematics.

        Args:
            root: (T, 3) metres, the root link in the world.
            turn: (T, 3, 3) world from root link.
            joints: (T, J) values of all joints, in the file's order.

        Returns:
            (T, L, 3, 3) world from link, (T, L, 3) metres.
        """
        free = np.ascontiguousarray(joints[:, list(self.free)], dtype=np.float64)
        turns, places = pose_all(self.tree, np.ascontiguousarray(root), np.ascontiguousarray(turn), free)
        nodes = self.tree.node_of_link
        return turns[:, nodes], places[:, nodes]

    def at_rest(self, free: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """(L, 3, 3) and (L, 3): the links with the root where the file has it, at `rest` or at given values."""
        values = self.rest if free is None else free
        turns, places = self.forward(self.places[:1], self.turns[:1], self.all_joints(values[None]))
        return turns[0], places[0]


def _make_tree(robot: Robot) -> Tree:
    of_link: dict[int, list[int]] = {}
    for k, joint in enumerate(robot.joints):
        of_link.setdefault(joint.link, []).append(k)
    rows: list[tuple[int, FloatArray, FloatArray, int, FloatArray, FloatArray, int, float, float]] = []
    node_of_link = np.zeros(len(robot), np.int64)
    none = np.zeros(3)
    for link, above in enumerate(robot.parents):
        parent = int(node_of_link[above]) if above >= 0 else -1
        place, turn = robot.places[link], robot.turns[link]
        mine = of_link.get(link, [])
        if not mine:
            rows.append((parent, place, turn, 0, none, none, 0, 0.0, 0.0))
        for k in mine:
            joint, row = robot.joints[k], robot.followed[k]
            d = int(np.argmax(np.abs(row[:-1])))
            kind = 1 if joint.kind == "hinge" else 2
            rows.append((parent, place, turn, kind, joint.axis, joint.anchor, d, row[d], row[-1] - joint.rest))
            parent, place, turn = len(rows) - 1, none, np.eye(3)
        node_of_link[link] = len(rows) - 1
    columns = list(zip(*rows, strict=True))
    return Tree(
        np.array(columns[0], np.int64), np.array(columns[1]), np.array(columns[2]), np.array(columns[3], np.int64),
        np.array(columns[4]), np.array(columns[5]), np.array(columns[6], np.int64), np.array(columns[7]),
        np.array(columns[8]), node_of_link,
    )  # fmt: skip
