"""A take on another character's skeleton: directions of limbs, a root of its size, feet on its own soles."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.character import Character
from muybridge.motion.contacts.find import ContactOptions, Contacts
from muybridge.motion.contacts.planting import PlantOptions
from muybridge.motion.retargeting.carrying import carry
from muybridge.motion.retargeting.grounding import (
    Ground,
    bend_toes,
    find_ground,
    level_feet,
    local_motion,
    plant,
)
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig, make_rig, pose_rig
from muybridge.motion.retargeting.soles import Soles, measure_soles


@dataclass(frozen=True)
class RetargetOptions:
    """How a take is put onto a character.

    Attributes:
        plant: whether feet are planted and soles put on the floor; without, limbs have the source's directions alone.
        scale: of the path over the ground; None for the ratio of the legs' lengths.
        contacts: how contacts are found in the take.
        planting: how feet are planted.
    """

    plant: bool = True
    scale: float | None = None
    contacts: ContactOptions = field(default_factory=ContactOptions)
    planting: PlantOptions = field(default_factory=PlantOptions)


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
    """

    motion: Motion
    contacts: Contacts
    soles: Soles
    scale: float
    moved_feet_m: float
    unreached_m: float


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
    source = make_rig(motion.skeleton, roles, motion=motion)
    target = make_rig(character.skeleton, character_roles, character.root_at_rest)
    target = replace(target, tips=_of_feet(target))
    posed = pose_rig(source, motion)
    soles = measure_soles(target, character)
    ground = find_ground(source, posed, motion.fps, options.contacts)
    contact, seconds = ground.contacts.contact, options.planting.blend
    turns = carry(source, posed, target)
    if options.plant:
        turns = level_feet(turns, target, contact, motion.fps, seconds)
    scale = options.scale or target.leg_length() / source.leg_length()
    places = _root(source, posed, target, turns, soles, ground, scale)
    moved = local_motion(target, turns, places, motion.fps)
    feet, unreached = 0.0, 0.0
    if options.plant and contact.any():
        planted = plant(moved, target, contact, soles, options.planting)
        moved = bend_toes(planted.motion, target, contact, seconds)
        feet, unreached = planted.moved_feet_m, planted.unreached_m
    return Retargeted(_whole(character, target, moved), ground.contacts, soles, scale, feet, unreached)


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


def _whole(character: Character, rig: Rig, moved: Motion) -> Motion:
    """The motion of the character's whole skeleton: joints beside the rig stay at rest."""
    skeleton = character.skeleton
    world = moved.forward()
    turns = world[..., :3, :3] @ rig.unposed  # back from the rig's axes
    mover = rig.joints[0]
    slides = {*skeleton.roots[1:], *(rig.joints[j] for j in rig.detached)} | ({mover} if mover else set())
    sliding = tuple(sorted(slides))
    skeleton = replace(skeleton, sliding=sliding)
    frames, index = len(moved), {j: k for k, j in enumerate(rig.joints)}
    local = np.tile(np.eye(3), (frames, len(skeleton), 1, 1))
    here = np.tile(np.eye(3), (frames, len(skeleton), 1, 1))
    at = np.tile(skeleton.rest_positions + character.root_at_rest, (frames, 1, 1))
    shifts = np.zeros((frames, len(sliding), 3))
    for j, parent in enumerate(skeleton.parents):
        above = here[:, parent] if parent >= 0 else np.eye(3)
        place_above = at[:, parent] if parent >= 0 else np.zeros(3)
        if j in index:
            here[:, j], at[:, j] = turns[:, index[j]], world[:, index[j], :3, 3]
            local[:, j] = np.swapaxes(above, -1, -2) @ here[:, j]
        elif parent >= 0:
            here[:, j], at[:, j] = above, place_above + above @ skeleton.offsets[j]
        if j in slides:
            shifts[:, sliding.index(j)] = (np.swapaxes(above, -1, -2) @ (at[:, j] - place_above)[..., None])[..., 0]
    quat = continuous_quat(quat_from_matrix(local))
    return Motion(skeleton, moved.fps, at[:, 0], quat, shifts if sliding else None)
