"""The soles of a robot's feet: from the shapes of its file, else of usual size."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.robots.link_roles import Limb
from muybridge.motion.robots.robot import Robot, Shape

_LONG, _BEHIND, _WIDE, _HIGH = 0.28, 0.3, 0.1, 0.08  # of a leg: a foot without shapes, what is behind the ankle, ankle
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RobotSole:
    """The sole of a foot that is level at rest; in the world at rest.

    Attributes:
        heel: (3,) metres, the middle of its back edge.
        ball: (3,) metres, the middle of its front edge, over which the foot rolls.
        corners: (4, 3) metres.
        ankle_height: metres of the ankle over the sole.
        estimated: whether the file has no shapes for it.
    """

    heel: FloatArray
    ball: FloatArray
    corners: FloatArray
    ankle_height: float
    estimated: bool


def find_sole(robot: Robot, limb: Limb, axes: FloatArray) -> RobotSole:
    """The sole of a leg's foot.

    Args:
        robot: at rest with level feet.
        limb: the leg.
        axes: (3, 3) columns: left, back and up in the world at rest.
    """
    turns, places = robot.at_rest()
    links = [k for k in range(len(robot)) if _carried_by(robot, k, limb.end)]
    ahead, across = -axes[:, 1], axes[:, 0]
    shapes = [s for s in robot.shapes if s.link in links]
    shapes = [s for s in shapes if s.solid] or shapes

    def reach(direction: FloatArray) -> float:
        return max(_support(s, turns[s.link], places[s.link], direction) for s in shapes)

    ankle = limb.points[2]
    leg = float(np.linalg.norm(np.diff(limb.points[:3], axis=0), axis=1).sum())
    if shapes:
        low, front, back = -reach(-_UP), reach(ahead), -reach(-ahead)
        left, right = reach(across), -reach(-across)
    else:
        ends = np.array([places[k] for k in links])
        low = min(float(ends[:, 2].min()), float(ankle[2]) - 0.01 * leg) if len(links) > 1 else float(ankle[2]) - _HIGH * leg
        back = float(ankle @ ahead) - _BEHIND * _LONG * leg
        front = max(back + _LONG * leg, float((ends @ ahead).max()))
        middle = float(places[limb.end] @ across)
        left, right = middle + _WIDE * leg / 2, middle - _WIDE * leg / 2
    middle = across * (left + right) / 2 + _UP * low

    def corner(x: float, y: float) -> FloatArray:
        return np.asarray(ahead * x + across * y + _UP * low)

    corners = np.stack([corner(x, y) for x in (back, front) for y in (left, right)])
    return RobotSole(middle + ahead * back, middle + ahead * front, corners, float(ankle[2]) - low, not shapes)


def _support(shape: Shape, turn: FloatArray, place: FloatArray, direction: FloatArray) -> float:
    return shape.support(direction @ turn) + float(place @ direction)


def _carried_by(robot: Robot, link: int, foot: int) -> bool:
    """Whether a link is the foot, or fixed to it."""
    moved = {joint.link for joint in robot.joints}
    while link != foot:
        if link in moved or link < 0:
            return False
        link = robot.parents[link]
    return True
