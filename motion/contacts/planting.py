"""Feet that stand still: footskate removed from a motion.

After L. Kovar, J. Schreiner, M. Gleicher, "Footskate cleanup for motion capture editing", 2002: a place for each
contact, ankles from the places, a root from which they can be reached, the legs by inverse kinematics of two bones, and
blending into the frames beside. Other than there, heel and ball roll: see `foot_plan`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.ik.two_bone import move_two_bone
from muybridge.geometry.numerics.rotations import continuous_quat, matrix_from_quat, quat_from_matrix
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.contacts.blending import smooth_bound
from muybridge.motion.contacts.feet import USUAL_LEG_M, Leg, feet_of_motion, find_legs, leg_length, points_of_foot
from muybridge.motion.contacts.find import Contacts, find_contacts, with_floor
from muybridge.motion.contacts.foot_plan import FootPlan, plan_foot
from muybridge.motion.contacts.footskate import contact_spans

_ROUNDS = 6  # of moving the root to where both feet can be reached
_STRAIGHT = 0.02  # bounds how much more a straight leg counts than a bent one
_SAME_M = 5e-6  # that rounding in files may move a point that is still
_HELD_S = 0.06  # of a point that is still for it to have been planted
_STAY = 0.3  # how much it counts that the root stays, against that a leg stays bent as it is


@dataclass(frozen=True)
class PlantOptions:
    """How feet are planted.

    Attributes:
        blend: seconds over which corrections fade beside a contact.
        straight: share of its length up to which a leg may be straightened, unless it is straighter already.
        root: seconds over which the root moves to where feet can be reached.
        step: metres, of an adult, over the floor from which a contact keeps its own height, as on a stair or a beam, or
            with the toes up; lower ones are put onto the floor.
    """

    blend: float = 0.15
    straight: float = 0.99
    root: float = 0.15
    step: float = 0.015


@dataclass(frozen=True, eq=False)
class Planted:
    """A motion with planted feet.

    Attributes:
        motion: of the same skeleton.
        contacts: what was planted.
        moved_root_m: metres, the farthest that the root was moved.
        moved_feet_m: metres, the farthest that an ankle was moved.
        unreached_m: metres, the farthest that an ankle is from where it should be.
    """

    motion: Motion
    contacts: Contacts
    moved_root_m: float
    moved_feet_m: float
    unreached_m: float


def plant_feet(
    motion: Motion,
    contacts: Contacts | None = None,
    options: PlantOptions | None = None,
    *,
    roles: Mapping[str, int] | None = None,
    legs: tuple[Leg, Leg] | None = None,
    where: BoolArray | None = None,
    under: FloatArray | None = None,
) -> Planted:
    """The motion with heels and balls of the feet still while they stand, and never through the floor.

    Args:
        motion: Z up, of any skeleton with known thighs, shins and feet.
        contacts: None finds them; in a motion that was planted before, only what stands perfectly still.
        options: how they are planted.
        roles: role -> joint; None finds them.
        legs: with heels and balls that are known better than from the skeleton; None finds them.
        where: (T,) frames: contacts with none of these stay as they are, and the others stand where they do beside
            these. None: all are planted.
        under: (T, 2) metres that the left and the right foot may be in the floor while they do not stand. None: they
            are lifted out of it.

    Raises:
        ValueError: legs are not known, or the contacts are of another number of frames.
    """
    options = options or PlantOptions()
    roles = find_motion_roles(motion).roles if roles is None else roles
    legs = find_legs(motion.skeleton, roles, motion) if legs is None else legs
    step = options.step * leg_length(motion.skeleton, legs) / USUAL_LEG_M
    if contacts is None:
        contacts = _but_blends(find_contacts(motion, roles=roles), motion, legs, step)
    if len(contacts) != len(motion):
        raise ValueError(f"contacts of {len(contacts)} frames do not belong to a motion of {len(motion)}")
    if not len(motion):
        return Planted(motion, contacts, 0.0, 0.0, 0.0)
    if not np.isfinite(contacts.clearance).all():
        contacts = with_floor(contacts, feet_of_motion(motion, roles))
    world = motion.forward()
    plans = [
        plan_foot(world[:, leg.foot, :3, 3], world[:, leg.foot, :3, :3], leg, contacts.contact[:, k], contacts.floor,
                  contacts.clearance[k], motion.fps, options.blend, step, where,
                  None if under is None else under[:, k])
        for k, leg in enumerate(legs)
    ]  # fmt: skip
    out, shift, unreached = carry_out(motion, world, legs, plans, options)
    return Planted(out, contacts, shift, float(max(np.linalg.norm(p.moved, axis=1).max() for p in plans)), unreached)


def carry_out(
    motion: Motion, world: FloatArray, legs: tuple[Leg, Leg], plans: list[FootPlan], options: PlantOptions
) -> tuple[Motion, float, float]:
    """A motion with its feet where they are planned, by the root and the legs.

    Args:
        motion: Z up.
        world: (T, J, 4, 4) its joints in the world.
        legs: left and right.
        plans: of the left and the right foot.
        options: how the root follows.

    Returns:
        The motion; metres, the farthest that the root was moved; metres, the farthest that an ankle is from its plan.
    """
    shift = _root_shift(world, legs, plans, motion.fps, options)
    motion = _with_feet_sliding(motion, legs)
    turns = matrix_from_quat(motion.quat_wxyz)
    short, ankles = np.zeros((len(motion), 2)), []
    for k, (leg, plan) in enumerate(zip(legs, plans, strict=True)):
        short[:, k], ankle = _bend_leg(motion, world, turns, leg, plan, shift)
        ankles.append(ankle)
    out = _moved(motion, world, turns, shift, legs, ankles)
    return out, float(np.linalg.norm(shift, axis=1).max()), float(np.abs(short).max())


def _but_blends(contacts: Contacts, motion: Motion, legs: tuple[Leg, Leg], step: float) -> Contacts:
    """Contacts without the frames beside those in which a point is perfectly still: such a point was planted before,
    and where that was blended in, it moves so little that it seems to stand. Its clearance is the one it has, unless it
    stands on something: more than `step` metres from where it rests."""
    world, out, clearance = motion.forward(), contacts.contact.copy(), contacts.clearance.copy()
    for k, leg in enumerate(legs):
        places = points_of_foot(world[:, leg.foot, :3, 3], world[:, leg.foot, :3, :3], leg)
        for p in range(2):
            same = np.linalg.norm(np.diff(places[:, p], axis=0), axis=1) < _SAME_M
            still = np.append(same, False) | np.insert(same, 0, False)
            held = np.zeros(len(motion), np.bool_)
            for a, b in contact_spans(contacts.contact[:, k, p]):
                if max((d - c for c, d in contact_spans(still[a:b])), default=0) >= max(_HELD_S * motion.fps, 3):
                    out[a:b, k, p] = held[a:b] = still[a:b]
            heights = contacts.floor.heights(places[held, p])
            heights = heights[np.abs(heights - clearance[k, p]) <= step]
            if len(heights):
                clearance[k, p] = np.median(heights)
    return replace(contacts, contact=out, clearance=clearance)


def _root_shift(
    world: FloatArray, legs: tuple[Leg, Leg], plans: list[FootPlan], fps: float, options: PlantOptions
) -> FloatArray:
    """(T, 3) metres by which the root moves, smoothly, so that both legs reach their feet."""
    shift = _following(world, legs, plans, fps * options.root)
    hips, most = [], []
    for leg in legs:
        hip, knee, ankle = (world[:, j, :3, 3] for j in (leg.thigh, leg.shin, leg.foot))
        whole = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        hips.append(hip)
        most.append(np.clip(np.linalg.norm(ankle - hip, axis=1), options.straight * whole, 0.9995 * whole))
    for _ in range(_ROUNDS):
        step, needed = np.zeros_like(shift), np.zeros(len(world), np.bool_)
        for _ in range(8):  # onto what both legs reach, each frame alone
            for hip, plan, limit in zip(hips, plans, most, strict=True):
                away = hip + shift + step - plan.ankle
                far = np.linalg.norm(away, axis=1)
                over = np.maximum(far - limit, 0.0)
                needed |= over > 1e-4
                step -= away / far[:, None] * over[:, None]
        if not needed.any():
            break
        width = options.root * fps
        ahead = gaussian_filter1d(step, max(width / 3, 0.5), axis=0, mode="nearest")
        ahead /= np.linalg.norm(ahead, axis=1, keepdims=True) + 1e-9
        shift = shift + ahead * smooth_bound(np.linalg.norm(step, axis=1), width)[:, None]
    return shift


def _following(world: FloatArray, legs: tuple[Leg, Leg], plans: list[FootPlan], frames: float) -> FloatArray:
    """(T, 3) metres by which the root follows the feet, so that legs are bent as they were: a straight leg's knee moves
    by several times what its length changes by, so it counts the more."""
    matrix, side = np.tile(np.eye(3), (len(world), 1, 1)), np.zeros((len(world), 3, 1))
    for leg, plan in zip(legs, plans, strict=True):
        hip, knee, ankle = (world[:, j, :3, 3] for j in (leg.thigh, leg.shin, leg.foot))
        whole = np.linalg.norm(knee - hip, axis=1) + np.linalg.norm(ankle - knee, axis=1)
        away = ankle - hip
        far = np.linalg.norm(away, axis=1)
        along = (away / far[:, None])[..., None]
        share = np.clip(far / whole, 0.0, 1.0) ** 2
        weight = (share / (1.0 - share + _STRAIGHT))[:, None, None]
        matrix += weight * (along @ np.swapaxes(along, -1, -2) + _STAY * np.eye(3))
        side += weight * along * (np.swapaxes(along, -1, -2) @ plan.moved[..., None])
    shift = np.linalg.solve(matrix, side)[..., 0]
    return np.asarray(gaussian_filter1d(shift, max(frames / 3, 1e-3), axis=0, mode="nearest"))


def _bend_leg(
    motion: Motion, world: FloatArray, turns: FloatArray, leg: Leg, plan: FootPlan, shift: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turn a leg's joints, in `turns` (T, J, 3, 3), so that its foot is where it is planned.

    Returns:
        (T,) metres that lack, and (T, 3) where the ankle gets.
    """
    parents = motion.skeleton.parents
    hip, knee, ankle = (world[:, j, :3, 3] for j in (leg.thigh, leg.shin, leg.foot))
    ahead = world[:, leg.thigh, :3, :3] @ leg.ahead
    upper, lower, short = move_two_bone((hip, knee, ankle), hip + shift, plan.ankle, ahead)
    above = world[:, parents[leg.thigh], :3, :3] if parents[leg.thigh] >= 0 else np.eye(3)
    turns[:, leg.thigh] = np.swapaxes(above, -1, -2) @ upper @ world[:, leg.thigh, :3, :3]
    above = upper @ world[:, parents[leg.shin], :3, :3]
    turns[:, leg.shin] = np.swapaxes(above, -1, -2) @ lower @ world[:, leg.shin, :3, :3]
    above = world[:, parents[leg.foot], :3, :3]
    if not _is_apart(motion.skeleton, leg):
        above = lower @ above
    turns[:, leg.foot] = np.swapaxes(above, -1, -2) @ plan.turns
    reached = hip + shift + (upper @ (knee - hip)[..., None] + lower @ (ankle - knee)[..., None])[..., 0]
    return short, reached


def _is_apart(skeleton: Skeleton, leg: Leg) -> bool:
    """Whether a foot hangs elsewhere than on its shin, such as on a control bone."""
    return not skeleton.is_ancestor[leg.shin, leg.foot]


def _with_feet_sliding(motion: Motion, legs: tuple[Leg, Leg]) -> Motion:
    """The motion with feet that hang elsewhere than on their shins sliding, since nothing else can move them."""
    skeleton = motion.skeleton
    new = {leg.foot for leg in legs if _is_apart(skeleton, leg)} - set(skeleton.sliding)
    if not new:
        return motion
    sliding = tuple(sorted({*skeleton.sliding, *new}))
    slides = np.tile(skeleton.offsets[list(sliding)], (len(motion), 1, 1))
    if motion.translations is not None:
        slides[:, [sliding.index(j) for j in skeleton.sliding]] = motion.translations
    return replace(motion, skeleton=replace(skeleton, sliding=sliding), translations=slides)


def _moved(
    motion: Motion, world: FloatArray, turns: FloatArray, shift: FloatArray, legs: tuple[Leg, Leg],
    ankles: Sequence[FloatArray],
) -> Motion:  # fmt: skip
    """The motion with these rotations, and its root moved: the root that the legs hang on."""
    skeleton = motion.skeleton
    quat = continuous_quat(quat_from_matrix(turns))
    same = np.abs((quat * motion.quat_wxyz).sum(-1)) > 1 - 1e-15
    quat = np.where(same[..., None], motion.quat_wxyz, quat)
    top = legs[0].thigh
    while skeleton.parents[top] >= 0:
        top = skeleton.parents[top]
    root, translations = motion.root_positions_world, motion.translations
    if top == 0 or translations is None:
        root = root + shift
    else:
        translations = translations.copy()
        translations[:, skeleton.sliding.index(top)] += shift
    for leg, ankle in zip(legs, ankles, strict=True):
        if not _is_apart(skeleton, leg):
            continue
        assert translations is not None
        translations, parent = translations.copy(), skeleton.parents[leg.foot]
        gap = ankle - world[:, parent, :3, 3] - (shift if skeleton.is_ancestor[top, parent] else 0.0)
        back = np.swapaxes(world[:, parent, :3, :3], -1, -2)
        translations[:, skeleton.sliding.index(leg.foot)] = (back @ gap[..., None])[..., 0]
    return replace(motion, root_positions_world=root, translations=translations, quat_wxyz=continuous_quat(quat))
