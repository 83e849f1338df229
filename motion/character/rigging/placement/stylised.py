"""Where the joints of cartoon figures and toys are, whose proportions are no person's: from landmarks alone.

Joints are where limbs leave the trunk and at shares of the limbs' own lengths; nothing is measured in shares of the
height but small steps.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import Arm, Landmarks, Leg
from muybridge.motion.character.rigging.placement.people import SIDES

_LOW_ARMPIT, _HIGH_ARMPIT = 0.56, 0.68  # of the height: people's are above the second, of hanging arms above the first
_LOW_CROTCH = 0.2  # of the height: below that, legs are no person's
_SHOULDER = 1.05  # of the way from the tip of the hand to the armpit
_WRIST, _ELBOW = 0.31, 0.66  # of the way from the tip of the hand to the shoulder
_STRAIGHT = (0.4, 0.8)  # of the way to the armpit: the part whose line leads to the shoulder, where sleeves do not sag
_HIP = 0.07  # of the height, from the crotch up
_ANKLE, _LOW_ANKLE = 0.055, 0.35  # of the height, and at most so much of the crotch's
_NECK_ROOM, _HEAD = 0.12, 0.06  # of the height, from the armpits up to the neck at most, and from there to the head


def is_person(marks: Landmarks) -> bool:
    """Whether a body has the proportions of a person, whom the table of people fits."""
    armpit = float(np.mean([arm.way.at(arm.armpit)[2] for arm in marks.arms])) / marks.height
    if armpit > _HIGH_ARMPIT:  # whatever a skirt makes of the crotch
        return True
    return armpit > _LOW_ARMPIT and (marks.hidden or marks.crotch > _LOW_CROTCH * marks.height)


def place_stylised(marks: Landmarks) -> dict[str, FloatArray]:
    """Role -> (3,) metres in the body's own frame, of every joint but the fingers."""
    out: dict[str, FloatArray] = {}
    length = _SHOULDER * float(np.mean([arm.armpit for arm in marks.arms]))
    hip = marks.crotch + _HIP * marks.height
    for side, arm, leg in zip(SIDES, marks.arms, marks.legs, strict=True):
        out |= {f"{side}_{part}": place for part, place in _arm(arm, length).items()}
        out |= {f"{side}_{part}": place for part, place in _leg(leg, hip, marks).items()}
    return out | _trunk(marks, out)


def _arm(arm: Arm, length: float) -> dict[str, FloatArray]:
    near, far = arm.way.at(_STRAIGHT[1] * arm.armpit), arm.way.at(_STRAIGHT[0] * arm.armpit)
    direction = (near - far) / max(float(np.linalg.norm(near - far)), 1e-9)
    shoulder = near + direction * (length - _STRAIGHT[1] * arm.armpit)
    return {"upper_arm": shoulder, "forearm": arm.way.at(_ELBOW * length), "hand": arm.way.at(_WRIST * length)}


def _leg(leg: Leg, hip: float, marks: Landmarks) -> dict[str, FloatArray]:
    ankle = min(_ANKLE * marks.height, _LOW_ANKLE * marks.crotch)
    top, bottom = leg.at_height(0.8 * marks.crotch), leg.at_height(0.6 * marks.crotch)
    foot, thigh = np.array([*bottom[:2], ankle]), np.array([*top[:2], hip])
    toe = np.array([leg.middle, leg.toes + 0.3 * (leg.heel - leg.toes), 0.3 * ankle])
    return {"thigh": thigh, "shin": (thigh + foot) / 2, "foot": foot, "toe": toe}


def _trunk(marks: Landmarks, limbs: dict[str, FloatArray]) -> dict[str, FloatArray]:
    hips = (limbs["left_thigh"] + limbs["right_thigh"]) / 2
    z, area = marks.trunk[:, 0], marks.trunk[:, 3]
    armpit = float(np.mean([arm.way.at(arm.armpit)[2] for arm in marks.arms]))
    near = np.flatnonzero((z > armpit - 0.02 * marks.height) & (z < armpit + _NECK_ROOM * marks.height))
    cost = area[near] * (1 + 4 * (z[near] - armpit) / marks.height)
    neck = float(z[near[np.argmin(cost)]]) if len(near) else armpit
    neck = max(neck, float(hips[2]) + 0.1 * marks.height)
    heights = {"spine": 0.22, "chest": 0.45, "upper_chest": 0.7, "neck": 1.0}
    levels = {role: hips[2] + share * (neck - hips[2]) for role, share in heights.items()}
    levels["head"] = neck + _HEAD * marks.height
    out = {role: np.array([0.0, np.interp(level, z, marks.trunk[:, 2]), level]) for role, level in levels.items()}
    out["hips"] = np.array([0.0, hips[1], hips[2]])
    for side in SIDES:
        upper = limbs[f"{side}_upper_arm"]
        out[f"{side}_clavicle"] = np.array([0.2 * upper[0], upper[1], 0.85 * upper[2] + 0.15 * levels["upper_chest"]])
    return out
