"""The feet of a target on its floor: soles level while they stand, then planted."""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, log_so3, quat_from_matrix
from muybridge.geometry.roles.facing import unit
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.blending import blend
from muybridge.motion.contacts.feet import find_legs
from muybridge.motion.contacts.find import ContactOptions, Contacts, find_contacts
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.planting import Planted, PlantOptions, plant_feet
from muybridge.motion.retargeting.alignment import swing
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig
from muybridge.motion.retargeting.soles import Soles

_ADULT_LEG_M = 0.85
_STIFF = 1e-3  # of quaternions
_UP = np.array([0.0, 0.0, 1.0])
_MOST_TILT = np.radians(35)  # of a foot at rest against one that stands


@dataclass(frozen=True, eq=False)
class Ground:
    """What a source stands on.

    Attributes:
        contacts: of its heels and balls.
        height: metres of the floor, of the source.
        ankle: metres of the ankles over it while the feet stand flat.
    """

    contacts: Contacts
    height: float
    ankle: float


def local_motion(rig: Rig, turns: FloatArray, places: FloatArray, fps: float) -> Motion:
    """The motion of a rig's own skeleton.

    Args:
        rig: of K joints.
        turns: (T, K, 3, 3) world from joint.
        places: (T, 3) metres of the mover.
        fps: frames per second.
    """
    local = turns.copy()
    local[:, 1:] = np.swapaxes(turns[:, list(rig.parents[1:])], -1, -2) @ turns[:, 1:]
    return Motion(rig.skeleton(), fps, places, continuous_quat(quat_from_matrix(local)))


def find_ground(rig: Rig, posed: Posed, fps: float, options: ContactOptions | None = None) -> Ground:
    """The contacts and the floor of a source, whatever its units are."""
    factor = _ADULT_LEG_M / rig.leg_length()
    scaled = replace(rig, places=rig.places * factor, tips=rig.tips * factor)
    motion = _with_stiff_toes(local_motion(scaled, posed.turns, posed.places[:, 0] * factor, fps), rig)
    contacts = find_contacts(motion, options, roles=rig.roles)
    ankles = posed.places[:, [rig.roles[f"{s}_foot"] for s in SIDES], 2] - contacts.floor.height / factor
    flat = contacts.contact.all(-1)
    standing = ankles[flat] if flat.any() else ankles[contacts.feet]
    usual = 0.1 * rig.leg_length()
    return Ground(contacts, contacts.floor.height / factor, float(np.median(standing)) if len(standing) else usual)


def _with_stiff_toes(motion: Motion, rig: Rig) -> Motion:
    """Toes that hardly ever bend do not at all: single frames do not make a foot one that rolls over its toes."""
    quat = motion.quat_wxyz.copy()
    for side in SIDES:
        toe = rig.roles.get(f"{side}_toe", -1)
        if toe >= 0:
            usual = np.median(quat[:, toe], axis=0)
            if np.quantile(np.abs(quat[:, toe] - usual).max(axis=1), 0.9) < _STIFF:
                quat[:, toe] = usual / np.linalg.norm(usual)
    return replace(motion, quat_wxyz=quat)


def level_feet(turns: FloatArray, rig: Rig, contact: BoolArray, fps: float, seconds: float) -> FloatArray:
    """(T, K, 3, 3) with the soles level where heel and ball stand, and as far as possible as they were elsewhere.

    How a foot is turned at rest against one that stands is taken from the whole take; what is left is blended.
    """
    out = turns.copy()
    for k, side in enumerate(SIDES):
        foot, flat = rig.roles[f"{side}_foot"], contact[:, k].all(-1)
        was = out[:, foot].copy()
        if flat.any():
            up = unit((np.swapaxes(was[flat], -1, -2) @ _UP).mean(axis=0))
            tilt = log_so3(swing(_UP, up))
            size = float(np.linalg.norm(tilt))
            was = was @ exp_so3(tilt * min(1.0, _MOST_TILT / max(size, 1e-9)))
            change = log_so3(swing(was @ _UP, np.broadcast_to(_UP, (len(was), 3))))
            was = exp_so3(blend(change, flat.astype(np.float64), fps, seconds)) @ was
        change_below = was @ np.swapaxes(out[:, foot], -1, -2)
        for j in range(len(rig.parents)):
            if foot in rig.above(j):
                out[:, j] = change_below @ out[:, j]
    return out


def bend_toes(motion: Motion, rig: Rig, contact: BoolArray, seconds: float) -> Motion:
    """The motion with toes level on the floor while the ball stands."""
    if not any(f"{side}_toe" in rig.roles for side in SIDES):
        return motion
    world = motion.forward()[..., :3, :3]
    quat = motion.quat_wxyz.copy()
    for k, side in enumerate(SIDES):
        toe, foot = rig.roles.get(f"{side}_toe", -1), rig.roles[f"{side}_foot"]
        ball = contact[:, k, 1]
        if toe < 0 or not ball.any() or foot not in rig.above(toe):
            continue
        turn = world[:, toe]
        change = log_so3(swing(turn @ _UP, np.broadcast_to(_UP, (len(turn), 3))))
        level = exp_so3(blend(change, ball.astype(np.float64), motion.fps, seconds)) @ turn
        quat[:, toe] = quat_from_matrix(np.swapaxes(world[:, rig.parents[toe]], -1, -2) @ level)
    return replace(motion, quat_wxyz=continuous_quat(quat))


def plant(motion: Motion, rig: Rig, contact: BoolArray, soles: Soles, options: PlantOptions) -> Planted:
    """The motion with its feet planted, soles on the floor at z = 0."""
    one, other = find_legs(motion.skeleton, rig.roles, motion.quat_wxyz)
    legs = replace(one, heel=soles.heel[0]), replace(other, heel=soles.heel[1])
    clearance = np.array([[0.0, leg.ball[2] - ball[2]] for leg, ball in zip(legs, soles.ball, strict=True)])
    contacts = replace(Contacts.of_feet(contact, motion.fps, Floor()), clearance=clearance)
    return plant_feet(motion, contacts, options, roles=rig.roles, legs=legs)
