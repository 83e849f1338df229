"""What is measured on a body in shares of its height, by which the joints of people are estimated.

Every value is for one side, mirrored to the left; the same functions serve the table's maker and its use.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import Landmarks

MIRROR = (np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0]))  # left, right


def depth(marks: Landmarks, z: float) -> float:
    """Metres, y of the middle of the trunk at a height."""
    return float(np.interp(z, marks.trunk[:, 0], marks.trunk[:, 2]))


def chest_depth(marks: Landmarks) -> float:
    """Metres, y of the middle of the chest, from which shoulders are measured."""
    return depth(marks, marks.shoulders - 0.05 * marks.height)


def of_arm(marks: Landmarks, side: int) -> FloatArray:
    """(11,) of an arm."""
    h, arm = marks.height, marks.arms[side]
    mean = float(np.mean([a.armpit for a in marks.arms]))
    pit, way = arm.way.at(arm.armpit) * MIRROR[side] / h, arm.direction * MIRROR[side]
    return np.array([mean / h, arm.armpit / h, *way, way[2] ** 2, pit[0], pit[1] - chest_depth(marks) / h, pit[2],
                     marks.shoulders / h, marks.neck / h])  # fmt: skip


def of_hip(marks: Landmarks, side: int) -> FloatArray:
    """(5,) of the height of a hip."""
    h = marks.height
    seen = not marks.hidden and marks.crotch > 0.42 * h
    thigh = abs(float(marks.legs[side].at_height(0.3 * h)[0]))
    return np.array([marks.crotch / h if seen else 0.46, float(seen), marks.shoulders / h, marks.neck / h, thigh / h])


def of_thigh(marks: Landmarks, side: int, hip: float) -> FloatArray:
    """(4,) of the place of a hip that is `hip` of the height above the floor."""
    h, leg = marks.height, marks.legs[side]
    high, low = (leg.at_height(z * h) * MIRROR[side] / h for z in (hip, 0.4))
    return np.array([high[0], low[0], low[1], high[1]])


def of_shin(marks: Landmarks, side: int, hip: float) -> FloatArray:
    """(3,) of a knee."""
    middle = marks.legs[side].at_height(0.3 * marks.height) * MIRROR[side] / marks.height
    return np.array([middle[0], middle[1], hip])


def of_foot(marks: Landmarks, side: int) -> FloatArray:
    """(5,) of an ankle and of toes."""
    h, leg = marks.height, marks.legs[side]
    shin = leg.at_height(0.08 * h) * MIRROR[side] / h
    return np.array([shin[0], shin[1], (leg.heel - leg.toes) / h, leg.toes / h, leg.middle * MIRROR[side][0] / h])


def of_trunk(marks: Landmarks) -> FloatArray:
    """(7,) of the spine, the neck and the head."""
    h = marks.height
    depths = [depth(marks, z) / h for z in (marks.neck, marks.shoulders - 0.05 * h, 0.93 * h, 0.62 * h, 0.7 * h)]
    return np.array([marks.shoulders / h, marks.neck / h, *depths])
