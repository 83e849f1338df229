"""How the bones of two rigs at rest are turned against each other.

A limb's bone is brought to the T-pose's direction within the frontal plane first, then out of it, in both rigs: a
character whose arms hang at rest moves as one whose arms are stretched out does.
"""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.geometry.roles.facing import unit
from muybridge.geometry.skeleton.profiles import FINGERS
from muybridge.motion.retargeting.rig import SIDES, Rig

BONES = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}
_LEAST = 1e-9


def align(source: Rig, target: Rig) -> dict[str, FloatArray]:
    """Role -> (3, 3) the source's rest from the target's: what both have of limbs, hands, feet and fingers.

    The source's orientation times this is the target's. Roles that are missing here need no alignment.
    """
    out: dict[str, FloatArray] = {}
    for side in SIDES:
        for part, child in BONES.items():
            role, end = f"{side}_{part}", f"{side}_{child}"
            out[role] = to_usual(source, role, end).T @ to_usual(target, role, end)
        hands = [hand_frame(rig, side) for rig in (source, target)]
        out[f"{side}_hand"] = out[f"{side}_forearm"]
        if hands[0] is not None and hands[1] is not None:
            out[f"{side}_hand"] = hands[0] @ hands[1].T
        out[f"{side}_foot"] = out[f"{side}_toe"] = foot_frame(source, side) @ foot_frame(target, side).T
        out |= _fingers(source, target, side, out[f"{side}_hand"])
    return out


def to_usual(rig: Rig, role: str, end: str) -> FloatArray:
    """(3, 3) that turns a limb's bone at rest to where the T-pose has it: arms to the side, legs down."""
    bone = unit(rig.places[rig.roles[end]] - rig.places[rig.roles[role]])
    arm = "arm" in role
    sign = 1.0 if role.startswith("left") else -1.0
    flat = bone * [1, 0, 1]
    usual = np.array([sign, 0.0, 0.0]) if arm else np.array([0.0, 0.0, -1.0])
    if np.linalg.norm(flat) < 0.1:  # a bone that points ahead has no direction in the frontal plane
        return swing(bone, usual)
    within = swing(unit(flat), usual)
    return np.asarray(swing(within @ bone, usual) @ within)


def swing(start: FloatArray, stop: FloatArray) -> FloatArray:
    """(..., 3, 3) the smallest rotation of one unit vector (..., 3) to another."""
    axis = np.cross(start, stop)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.sum(start * stop, axis=-1, keepdims=True)
    least = np.argmin(np.abs(start), axis=-1)
    beside = np.cross(start, np.eye(3)[least])
    axis = np.where(sine > _LEAST, axis / np.maximum(sine, _LEAST),
                    beside / np.linalg.norm(beside, axis=-1, keepdims=True))  # fmt: skip
    return exp_so3(axis * np.arctan2(sine, cosine))


def hand_frame(rig: Rig, side: str) -> FloatArray | None:
    """(3, 3) axes of a hand at rest: along it, and across it from little finger to index; None without fingers."""
    bases = [rig.roles[f"{side}_{f}_1"] for f in FINGERS[1:] if f"{side}_{f}_1" in rig.roles]
    if len(bases) < 2:
        return None
    hand = rig.places[rig.roles[f"{side}_hand"]]
    along = unit(np.mean(rig.places[bases], axis=0) - hand)
    across = rig.places[bases[0]] - rig.places[bases[-1]]
    across = across - (across @ along) * along
    if np.linalg.norm(across) < _LEAST:
        return None
    across = unit(across)
    return np.stack([along, across, np.cross(along, across)], axis=1)


def foot_frame(rig: Rig, side: str) -> FloatArray:
    """(3, 3) axes of a foot that stands flat at rest: ahead over the ground, its left, and up."""
    foot = rig.roles[f"{side}_foot"]
    toe = rig.roles.get(f"{side}_toe", -1)
    ahead = rig.places[toe] - rig.places[foot] if toe >= 0 else np.nan_to_num(rig.tips[foot])
    ahead = ahead * [1, 1, 0]
    if np.linalg.norm(ahead) < 0.02 * rig.leg_length():
        ahead = np.array([0.0, -1.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return np.stack([unit(ahead), np.cross(up, unit(ahead)), up], axis=1)


def _fingers(source: Rig, target: Rig, side: str, of_hand: FloatArray) -> dict[str, FloatArray]:
    """Fingers go along the source's; the last bones, whose direction is not known, as the hand."""
    out = {}
    for finger in FINGERS:
        last = of_hand
        for k in (1, 2, 3):
            role, end = f"{side}_{finger}_{k}", f"{side}_{finger}_{k + 1}"
            if role not in source.roles or role not in target.roles:
                continue
            bones = [_bone(rig, role, end) for rig in (source, target)]
            if bones[0] is not None and bones[1] is not None:
                last = swing(of_hand @ bones[1], bones[0]) @ of_hand
            out[role] = last
    return out


def _bone(rig: Rig, role: str, end: str) -> FloatArray | None:
    if end not in rig.roles:
        return None
    bone = rig.places[rig.roles[end]] - rig.places[rig.roles[role]]
    return unit(bone) if np.linalg.norm(bone) > _LEAST else None
