"""The feet of a target on its floor: soles level while they stand, then planted."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.ik.two_bone import move_two_bone
from muybridge.geometry.numerics.rotations import (
    continuous_quat,
    exp_so3,
    log_so3,
    matrix_from_quat,
    quat_from_rotation,
)
from muybridge.geometry.roles.facing import unit
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.blending import blend, smooth_bound
from muybridge.motion.contacts.feet import find_legs
from muybridge.motion.contacts.find import ContactOptions, Contacts, find_contacts
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.planting import Planted, PlantOptions, plant_feet
from muybridge.motion.retargeting.alignment import foot_frame, swing
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig
from muybridge.motion.retargeting.soles import Soles

_ADULT_LEG_M = 0.85
_FEW = 10
_JUMP, _JUMP_OF_STEPS = 0.15, 4.0  # of the leg, and of the usual largest step
_STEPS = 400.0
_TILT_STEP = 0.01  # radians; as for heights
_PASSES = 2  # of fitting soles: skin that follows the shin too moves when that does
_LIFT_S = 0.05  # over which a foot is lifted out of the floor
_STEEP = 0.9  # sine
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
    return Motion(rig.skeleton(), fps, places, continuous_quat(quat_from_rotation(local)))


def find_ground(rig: Rig, posed: Posed, fps: float, options: ContactOptions | None = None) -> Ground:
    """The contacts and the floor of a source, whatever its units are."""
    factor = _ADULT_LEG_M / rig.leg_length()
    scaled = replace(rig, places=rig.places * factor, tips=rig.tips * factor)
    motion = _with_stiff_toes(local_motion(scaled, posed.turns, posed.places[:, 0] * factor, fps), rig)
    contacts = _contacts(motion, rig, options)
    height = _coarse(contacts.floor.height, _ADULT_LEG_M) / factor
    ankles = posed.places[:, [rig.roles[f"{s}_foot"] for s in SIDES], 2] - height
    flat = contacts.contact.all(-1)
    standing = ankles[flat] if flat.any() else ankles[contacts.feet]
    usual = float(np.median(standing)) if len(standing) else 0.1 * rig.leg_length()
    return Ground(contacts, height, _coarse(usual, rig.leg_length()))


def _contacts(motion: Motion, rig: Rig, options: ContactOptions | None) -> Contacts:
    """The contacts, without a look at frames before a jump at the start: a pose that was put there stands nowhere."""
    skip = _put_before(motion)
    contacts = find_contacts(motion.select(slice(skip, None)), options, roles=rig.roles)
    if not skip:
        return contacts
    none = np.zeros((skip, 2, 2))
    return replace(contacts, contact=np.concatenate([none > 0, contacts.contact]),
                   probability=np.concatenate([none, contacts.probability]))  # fmt: skip


def _put_before(motion: Motion) -> int:
    """1 where the first frame is far from the second, for the steps of the take; 0 otherwise."""
    if len(motion) < _FEW:
        return 0
    at = motion.joint_positions_world()
    steps = np.linalg.norm(np.diff(at, axis=0), axis=-1).max(axis=-1)
    return int(steps[0] > max(_JUMP * _ADULT_LEG_M, _JUMP_OF_STEPS * np.quantile(steps[1:], 0.95)))


def _coarse(value: float, leg: float) -> float:
    """A height to a four hundredth of the leg: a frame more or less changes nothing of the rest of a take."""
    return round(value / leg * _STEPS) * leg / _STEPS


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
    """(T, K, 3, 3) with the soles of standing feet level from side to side, and as they were elsewhere.

    How a foot is turned at rest against one that stands is taken from the whole take; what is left of its roll is
    blended. Planting levels it from heel to ball.
    """
    out = turns.copy()
    for k, side in enumerate(SIDES):
        foot, flat = rig.roles[f"{side}_foot"], np.asarray(contact[:, k].all(-1))
        was = out[:, foot].copy()
        if flat.any():
            up = unit((np.swapaxes(was[flat], -1, -2) @ _UP).mean(axis=0))
            tilt = np.round(log_so3(swing(_UP, up)) / _TILT_STEP) * _TILT_STEP
            size = float(np.linalg.norm(tilt))
            was = was @ exp_so3(tilt * min(1.0, _MOST_TILT / max(size, 1e-9)))
        stands = np.asarray(contact[:, k].any(-1))
        if stands.any():
            ahead = foot_frame(rig, side)[:, 0]
            roll = blend(_without_roll(was, ahead), stands.astype(np.float64), fps, seconds)
            was = exp_so3(roll) @ was
        change_below = was @ np.swapaxes(out[:, foot], -1, -2)
        for j in range(len(rig.parents)):
            if foot in rig.above(j):
                out[:, j] = change_below @ out[:, j]
    return out


def _without_roll(turns: FloatArray, ahead: FloatArray) -> FloatArray:
    """(T, 3) rotation vectors along the feet that put them level from side to side, as a foot on heel or ball is."""
    line = turns @ ahead
    side = turns @ np.cross(_UP, ahead)
    level = np.cross(_UP, line)
    level /= np.maximum(np.linalg.norm(level, axis=-1, keepdims=True), 1e-9)
    angle = np.arctan2((np.cross(side, level) * line).sum(-1), (side * level).sum(-1))
    steep = np.abs(line[:, 2]) > _STEEP  # a foot on end has no sides
    return np.where(steep, 0.0, np.clip(angle, -_MOST_TILT, _MOST_TILT))[:, None] * line


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
        quat[:, toe] = quat_from_rotation(np.swapaxes(world[:, rig.parents[toe]], -1, -2) @ level)
    return replace(motion, quat_wxyz=continuous_quat(quat))


def fit_soles(motion: Motion, rig: Rig, contact: BoolArray, soles: Soles, seconds: float) -> Motion:
    """The motion with each ankle raised or lowered such that the lowest vertex of a foot that stands is on the floor.

    Planting takes feet for stiff pieces with a heel and a ball; their skin bends and has edges. Feet in the air are
    raised where they would be in the floor.
    """
    for _ in range(_PASSES if soles.skins else 0):
        motion = _fitted_once(motion, rig, contact, soles, seconds)
    return motion


def _away_from(stands: BoolArray, frames: float) -> FloatArray:
    """(T,) 0 while a foot stands, rising smoothly to 1 so many frames away from that."""
    if not stands.any():
        return np.ones(len(stands))
    share = np.clip(distance_transform_edt(~stands) / max(frames, 1.0), 0.0, 1.0)
    return np.asarray(share * share * (3 - 2 * share))


def _fitted_once(motion: Motion, rig: Rig, contact: BoolArray, soles: Soles, seconds: float) -> Motion:
    world, turns = motion.forward(), matrix_from_quat(motion.quat_wxyz)
    parents = motion.skeleton.parents
    for k, (side, skin) in enumerate(zip(SIDES, soles.skins, strict=True)):
        thigh, shin, foot = (rig.roles[f"{side}_{part}"] for part in ("thigh", "shin", "foot"))
        low, stands = skin.lowest(rig, world[..., :3, :3], world[..., :3, 3]), np.asarray(contact[:, k].any(-1))
        rise = blend(-low[:, None], stands.astype(np.float64), motion.fps, seconds)[:, 0]
        rise = np.where(stands, -low, rise)
        deep = np.where(stands, 0.0, np.maximum(-low - rise, 0.0))
        rise = rise + smooth_bound(deep, _LIFT_S * motion.fps) * _away_from(stands, _LIFT_S * motion.fps)
        hip, knee, ankle = (world[:, j, :3, 3] for j in (thigh, shin, foot))
        ahead = world[:, thigh, :3, :3] @ np.array([0.0, -1.0, 0.0])
        upper, lower, _ = move_two_bone((hip, knee, ankle), hip, ankle + rise[:, None] * _UP, ahead)
        above = world[:, parents[thigh], :3, :3]
        turns[:, thigh] = np.swapaxes(above, -1, -2) @ upper @ world[:, thigh, :3, :3]
        above = upper @ world[:, parents[shin], :3, :3]
        turns[:, shin] = np.swapaxes(above, -1, -2) @ lower @ world[:, shin, :3, :3]
        above = lower @ world[:, parents[foot], :3, :3]
        turns[:, foot] = np.swapaxes(above, -1, -2) @ world[:, foot, :3, :3]
    return replace(motion, quat_wxyz=continuous_quat(quat_from_rotation(turns)))


def plant(motion: Motion, rig: Rig, contact: BoolArray, soles: Soles, options: PlantOptions) -> Planted:
    """The motion with its feet planted, soles on the floor at z = 0."""
    one, other = find_legs(motion.skeleton, rig.roles, motion)
    legs = replace(one, heel=soles.heel[0]), replace(other, heel=soles.heel[1])
    clearance = np.array([[0.0, leg.ball[2] - ball[2]] for leg, ball in zip(legs, soles.ball, strict=True)])
    contacts = replace(Contacts.of_feet(contact, motion.fps, Floor()), clearance=clearance)
    return plant_feet(motion, contacts, options, roles=rig.roles, legs=legs)
