"""A take on another character's skeleton: directions of limbs, a root of its size, feet on its own soles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_rotation
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.contacts.find import ContactOptions, Contacts
from muybridge.motion.contacts.planting import PlantOptions
from muybridge.motion.retargeting.carrying import carry
from muybridge.motion.retargeting.grounding import (
    Ground,
    bend_toes,
    find_ground,
    fit_soles,
    level_feet,
    local_motion,
    plant,
)
from muybridge.motion.retargeting.rig import (
    SIDES,
    Posed,
    Rig,
    legs_of,
    make_rig,
    named_part,
    part_of,
    pose_rig,
)
from muybridge.motion.retargeting.soles import Soles, measure_soles
from muybridge.motion.retargeting.touching import keep_touch


@dataclass(frozen=True)
class RetargetOptions:
    """How a take is put onto a character.

    Attributes:
        plant: whether feet are planted and soles put on the floor.
        touch: whether hands that touch the body or each other keep to that, and hands and forearms stay out of the
            body; without both, limbs have the source's directions alone.
        scale: of the path over the ground; None for the ratio of the legs' lengths.
        contacts: how contacts are found in the take.
        planting: how feet are planted.
    """

    plant: bool = True
    touch: bool = True
    scale: float | None = None
    contacts: ContactOptions = field(default_factory=ContactOptions)
    planting: PlantOptions = field(default_factory=lambda: PlantOptions(step=math.inf))  # soles go onto the floor


@dataclass(frozen=True, eq=False)
class Retargeted:
    """A take on a character.

    Attributes:
        motion: of the character's skeleton; the joint that moves the body slides where it is not the root.
        contacts: of the take's feet.
        soles: of the character.
        scale: of the path over the ground.
        moved_feet_m: metres, the farthest that planting moved an ankle.
        unreached_m: metres, the farthest that an ankle is from where it should be.
        moved_hands_m: (T, 2) metres by which the left and the right hand were moved.
    """

    motion: Motion
    contacts: Contacts
    soles: Soles
    scale: float
    moved_feet_m: float
    unreached_m: float
    moved_hands_m: FloatArray


def retarget(
    motion: Motion,
    roles: Mapping[str, int],
    character: Character,
    character_roles: Mapping[str, int],
    options: RetargetOptions | None = None,
) -> Retargeted:
    """Put a motion onto a character.

    The whole take is solved at once, and its first frame means nothing special.

    Args:
        motion: Z up, of at least one frame; units may be any.
        roles: role -> joint of its skeleton, the core roles at least (`muybridge.geometry.roles.find_roles`).
        character: whose skeleton is moved (`muybridge.motion.character.read_character`).
        character_roles: role -> joint of that.
        options: how.

    Raises:
        ValueError: no frames, or legs and arms that do not hang together.
    """
    options = options or RetargetOptions()
    if not len(motion):
        raise ValueError("a motion without frames cannot be put onto a character")
    source = named_part(make_rig(motion.skeleton, roles, motion=motion))
    target = make_rig(character.skeleton, character_roles, character.root_at_rest, character.motion)
    target = replace(target, tips=_of_feet(target))
    legs = legs_of(target)
    low = part_of(target, legs)
    posed = pose_rig(source, motion)
    soles = measure_soles(low, character)
    ground = find_ground(source, posed, motion.fps, options.contacts)
    contact, seconds = ground.contacts.contact, options.planting.blend
    turns = carry(source, posed, target)
    if options.plant:
        turns = level_feet(turns, target, contact, motion.fps, seconds)
    scale = options.scale or target.leg_length() / source.leg_length()
    places = _root(source, posed, target, turns, soles, ground, scale)
    feet, unreached = 0.0, 0.0
    if options.plant and contact.any():
        moved = local_motion(low, turns[:, legs], places, motion.fps)
        planted = plant(moved, low, contact, soles, options.planting)
        moved = fit_soles(bend_toes(planted.motion, low, contact, seconds), low, contact, soles, seconds)
        feet, unreached = planted.moved_feet_m, planted.unreached_m
        places = moved.root_positions_world
        turns = _with_legs(target, turns, legs, moved.forward()[..., :3, :3])
    hands = np.zeros((len(motion), 2))
    if options.touch:
        ours = Posed(turns, target.joint_places(turns, places))
        hands = keep_touch(source, posed, target, ours, character, motion.fps)
        turns = ours.turns
    return Retargeted(
        _whole(character, target, turns, places, motion.fps), ground.contacts, soles, scale, feet, unreached, hands
    )


def _with_legs(rig: Rig, turns: FloatArray, legs: list[int], moved: FloatArray) -> FloatArray:
    """(T, K, 3, 3) orientations with those of the legs (T, L, 3, 3) in place, and what they carry."""
    out = turns.copy()
    out[:, legs] = moved
    changed = set(legs)
    for j, parent in enumerate(rig.parents):
        if j not in changed and parent in changed:
            out[:, j] = out[:, parent] @ np.swapaxes(turns[:, parent], -1, -2) @ turns[:, j]
            changed.add(j)
    return out


def _of_feet(rig: Rig) -> FloatArray:
    """The ends of the feet's bones alone: other ends mean nothing to planting."""
    tips = np.full_like(rig.tips, np.nan)
    feet = [rig.roles[f"{side}_foot"] for side in SIDES]
    tips[feet] = rig.tips[feet]
    return tips


def _root(
    source: Rig, posed: Posed, target: Rig, turns: FloatArray, soles: Soles, ground: Ground, scale: float
) -> FloatArray:
    """(T, 3) metres of the target's mover: its hip joints are over the ground as the source's are, to scale.

    Heights are scaled such that one who stands straight does so on the soles of both.
    """
    thighs = [source.roles[f"{side}_thigh"] for side in SIDES]
    middle = posed.places[:, thighs].mean(axis=1)
    ankle = -float(np.mean([soles.heel[:, 2], soles.ball[:, 2]]))
    height = (target.leg_length() + ankle) / (source.leg_length() + max(ground.ankle, 0.0))
    wanted = np.stack([*(middle[:, :2] * scale).T, (middle[:, 2] - ground.height) * height], axis=1)
    return wanted - _from_mover(target, turns, [target.roles[f"{side}_thigh"] for side in SIDES])


def _from_mover(rig: Rig, turns: FloatArray, joints: list[int]) -> FloatArray:
    """(T, 3) metres from the mover to the middle of some joints in the world."""
    out = np.zeros((len(turns), 3))
    for j in joints:
        while rig.parents[j] >= 0:
            parent = rig.parents[j]
            out += turns[:, parent] @ (rig.places[j] - rig.places[parent]) / len(joints)
            j = parent
    return out


def _whole(character: Character, rig: Rig, turns: FloatArray, places: FloatArray, fps: float) -> Motion:
    """The motion of the character's whole skeleton: joints beside the rig stay at rest."""
    skeleton, mover = character.skeleton, rig.joints[0]
    detached = {rig.joints[j]: j for j in rig.detached}
    sliding = tuple(sorted({*skeleton.roots[1:], *detached} | ({mover} if mover else set())))
    rest, frames = skeleton.rest_positions + character.root_at_rest, len(turns)
    turns = turns @ rig.unposed  # back from the rig's axes
    index = {j: k for k, j in enumerate(rig.joints)}
    above = [index.get(skeleton.parents[j], -1) for j in rig.joints]
    local = turns.copy()
    for k, parent in enumerate(above):
        if parent >= 0 and k:
            local[:, k] = np.swapaxes(turns[:, parent], -1, -2) @ turns[:, k]
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(skeleton), 1))
    quat[:, list(rig.joints)] = quat_from_rotation(local)
    shifts = np.zeros((frames, len(sliding), 3))
    for k, j in enumerate(sliding):
        parent = skeleton.parents[j]
        at = rest[j] + np.zeros((frames, 3))
        if j == mover or j in detached:
            at = places + _from_mover(rig, turns @ np.swapaxes(rig.unposed, -1, -2), [index[j]])
        if parent >= 0 and parent in index:
            gap = at - places - _from_mover(rig, turns @ np.swapaxes(rig.unposed, -1, -2), [index[parent]])
            shifts[:, k] = (np.swapaxes(turns[:, index[parent]], -1, -2) @ gap[..., None])[..., 0]
        else:
            shifts[:, k] = at - (rest[parent] if parent >= 0 else 0.0)
    root = places if mover == 0 else np.tile(rest[0], (frames, 1))
    return Motion(replace(skeleton, sliding=sliding), fps, root, continuous_quat(quat), shifts if sliding else None)
