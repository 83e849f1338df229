"""Where the joints of a person or humanoid are, from the landmarks of its volume.

An arm's way is divided at shares that hardly differ between people; what differs, the place of the shoulder, is found
from where the arm meets the trunk, which lies deeper the more the arm hangs. Hips and trunk follow the crotch and the
shoulders; where clothes hide the crotch, usual proportions stand in.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import Arm, Landmarks, Leg

SIDES = ("left", "right")
# Shares of the arm from the tip of the hand to the shoulder (anny's bodies).
_WRIST, _ELBOW = 0.278, 0.632
_USUAL_ARM, _USUAL_HIP = 0.385, 0.527  # of the height
_KNEE = 0.525  # of the way from the ankle up to the hip
_ANKLE = 0.055


def place_human(marks: Landmarks) -> dict[str, FloatArray]:
    """Role -> (3,) metres in the body's own frame, of every joint but the fingers."""
    out: dict[str, FloatArray] = {}
    length = float(np.mean([_to_shoulder(arm, marks.height) for arm in marks.arms]))
    for side, arm in zip(SIDES, marks.arms, strict=True):
        out |= {f"{side}_{part}": place for part, place in _arm(arm, length, marks.height).items()}
    shoulder = (out["left_upper_arm"] + out["right_upper_arm"]) / 2
    hip = _hip_height(marks, float(shoulder[2]))
    for side, leg in zip(SIDES, marks.legs, strict=True):
        out |= {f"{side}_{part}": place for part, place in _leg(leg, hip, marks.height).items()}
    return out | _trunk(marks, out)


def _to_shoulder(arm: Arm, height: float) -> float:
    """Metres from the tip of the hand to the shoulder."""
    share = 0.91 + 0.26 * float(np.clip(arm.direction[2], 0.0, 1.0))
    return arm.armpit * share


def _arm(arm: Arm, length: float, height: float) -> dict[str, FloatArray]:
    base = arm.armpit - 0.02 * height
    shoulder = arm.way.at(base) + arm.direction * (length - base)
    return {"upper_arm": shoulder, "forearm": arm.way.at(_ELBOW * length), "hand": arm.way.at(_WRIST * length)}


def _hip_height(marks: Landmarks, shoulder: float) -> float:
    usual = 0.64 * shoulder
    if (marks.height - shoulder) / marks.height < 0.27:
        return 0.5 * usual + 0.5 * _USUAL_HIP * marks.height
    return marks.crotch + 0.1 * (shoulder - marks.crotch) if np.isfinite(marks.crotch) else usual


def _leg(leg: Leg, hip: float, height: float) -> dict[str, FloatArray]:
    sign = float(np.sign(leg.middle))
    ankle = _ANKLE * height
    foot = leg.at_height(0.08 * height)
    foot[2] = ankle
    thigh = leg.at_height(hip) - [0.0, 0.0, 0.0]
    thigh[0] += 0.015 * height * sign
    knee = leg.at_height(ankle + _KNEE * (hip - ankle))
    toe = np.array([leg.middle, leg.toes + 0.215 * (leg.heel - leg.toes), 0.023 * height])
    return {"thigh": thigh, "shin": knee, "foot": foot, "toe": toe}


def _trunk(marks: Landmarks, limbs: dict[str, FloatArray]) -> dict[str, FloatArray]:
    hips = (limbs["left_thigh"] + limbs["right_thigh"]) / 2
    shoulders = (limbs["left_upper_arm"] + limbs["right_upper_arm"]) / 2
    top = marks.height
    neck = shoulders[2] + 0.22 * (top - shoulders[2])
    head = shoulders[2] + 0.52 * (top - shoulders[2])
    heights = {"hips": hips[2], "spine": 0.75 * hips[2] + 0.25 * neck, "chest": 0.5 * (hips[2] + neck),
               "upper_chest": 0.25 * hips[2] + 0.75 * neck, "neck": neck, "head": head}  # fmt: skip
    out = {role: np.array([0.0, np.interp(z, marks.trunk[:, 0], marks.trunk[:, 2]), z]) for role, z in heights.items()}
    out["hips"] = hips
    for side in SIDES:
        upper = limbs[f"{side}_upper_arm"]
        out[f"{side}_clavicle"] = np.array([0.13 * upper[0], out["upper_chest"][1], 0.8 * upper[2] + 0.2 * neck])
    return out
