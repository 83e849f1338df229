"""Orientations of a target's joints from those of a source: a take on another body, before the floor counts."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_rotation
from muybridge.geometry.roles.facing import unit
from muybridge.geometry.skeleton.profiles import FINGERS
from muybridge.motion.retargeting.alignment import BONES, align, swing
from muybridge.motion.retargeting.chains import carry_chain, chest_of, neck_of, spine_of
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig

_ALIGNED = 1e-7  # difference of unit vectors that is left as it is


def carry(source: Rig, posed: Posed, target: Rig) -> FloatArray:
    """(T, K, 3, 3) world from joint of the target's joints.

    Limbs have the source's directions, the trunk and neck its orientations along them, hands and feet its orientations;
    joints that it does not have follow what they hang from.
    """
    driven = _driven(source, posed, target)
    out = np.empty((len(posed.turns), len(target.parents), 3, 3))
    twists = _forearm_twists(target, driven)
    for j, parent in enumerate(target.parents):
        if j in driven:
            out[:, j] = driven[j]
        elif parent < 0:
            out[:, j] = driven[target.roles["hips"]]
        else:
            out[:, j] = out[:, parent]
        if j in twists:
            line, share, angle = twists[j]
            side_turn = driven[line[0]]
            out[:, j] = side_turn @ exp_so3(angle[:, None] * share * line[1])
    for side in SIDES:
        _straighten(out, target, target.roles[f"{side}_forearm"], target.roles[f"{side}_hand"])
    return out


def _straighten(turns: FloatArray, rig: Rig, elbow: int, hand: int) -> None:
    """Turn a forearm, in place, so that the hand is where it was before twist bones beside the bone's line turned."""
    chain = rig.path(hand, elbow)
    if len(chain) < 2:
        return
    wanted = turns[:, elbow] @ unit(rig.places[hand] - rig.places[elbow])
    now = np.sum([turns[:, rig.parents[j]] @ (rig.places[j] - rig.places[rig.parents[j]]) for j in chain], axis=0)
    back = swing(now / np.linalg.norm(now, axis=-1, keepdims=True), wanted)
    below = [j for j in range(len(rig.parents)) if elbow in rig.above(j) and hand not in rig.above(j)]
    turns[:, below] = back[:, None] @ turns[:, below]


def _driven(source: Rig, posed: Posed, target: Rig) -> dict[int, FloatArray]:
    """Joint of the target -> (T, 3, 3) its orientation in the world."""
    turns = posed.turns
    hips = turns[:, source.roles["hips"]]
    driven = dict.fromkeys(target.path(target.roles["hips"], 0), hips) | {0: hips, target.roles["hips"]: hips}
    driven |= carry_chain(hips, source, spine_of(source), turns, target, spine_of(target))
    chest = turns[:, chest_of(source)]
    driven |= carry_chain(chest, source, neck_of(source), turns, target, neck_of(target))
    for role, rest in (align(source, target) | _same(source, target)).items():
        if role not in target.roles or role not in source.roles:
            continue
        orientation = turns[:, source.roles[role]] @ rest
        part = role.split("_", 1)[-1]
        if part in BONES:
            end = role.split("_", 1)[0] + "_" + BONES[part]
            orientation = _along(orientation, source, posed, target, role, end)
        driven[target.roles[role]] = orientation
    return driven


def _same(source: Rig, target: Rig) -> dict[str, FloatArray]:
    """Clavicles turn as the source's do; where one of both has none, they follow the chest."""
    roles = [f"{side}_clavicle" for side in SIDES]
    return {role: np.eye(3) for role in roles if role in source.roles and role in target.roles}


def _along(orientation: FloatArray, source: Rig, posed: Posed, target: Rig, role: str, end: str) -> FloatArray:
    """Orientations, turned a little so that the bone has the source's direction exactly.

    They differ where a joint within the source's bone turns it, as twist bones do.
    """
    wanted = posed.places[:, source.roles[end]] - posed.places[:, source.roles[role]]
    wanted = wanted / np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1e-12)
    bone = unit(target.places[target.roles[end]] - target.places[target.roles[role]])
    now = orientation @ bone
    if np.abs(now - wanted).max(initial=0.0) < _ALIGNED:
        return orientation
    return np.asarray(swing(now, wanted) @ orientation)


def _forearm_twists(
    target: Rig, driven: dict[int, FloatArray]
) -> dict[int, tuple[tuple[int, FloatArray], float, FloatArray]]:
    """Twist bones of the forearms: joint -> ((forearm, axis), share of the hand's twist, (T,) radians of it)."""
    out = {}
    for side in SIDES:
        elbow, hand = target.roles[f"{side}_forearm"], target.roles[f"{side}_hand"]
        bone = target.places[hand] - target.places[elbow]
        axis, length = unit(bone), float(np.linalg.norm(bone))
        quat = quat_from_rotation(np.swapaxes(driven[elbow], -1, -2) @ driven[hand])
        angle = 2 * np.arctan2(quat[:, 1:] @ axis, quat[:, 0])
        angle = np.unwrap((angle + np.pi) % (2 * np.pi) - np.pi)
        angle = angle - 2 * np.pi * np.round(np.median(angle) / (2 * np.pi)) if len(angle) else angle
        within = target.path(hand, elbow)[:-1]
        leaves = [j for j, p in enumerate(target.parents) if p == elbow and j not in target.parents and j != hand]
        for j in (*within, *leaves):
            away = target.places[j] - target.places[elbow]
            share = float(away @ axis) / max(length, 1e-9)
            if 0 < share < 1 and np.linalg.norm(away - share * bone) < 0.1 * length:
                out[j] = ((elbow, axis), share, angle)
    return out


def has_fingers(rig: Rig) -> bool:
    """Whether any finger of a rig has a joint."""
    return any(f"{side}_{finger}_1" in rig.roles for side in SIDES for finger in FINGERS)
