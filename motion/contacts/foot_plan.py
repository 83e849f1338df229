"""Where one foot shall be: fixed while it stands, rolled over heel and ball, blended in between."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.motion.contacts.blending import blend, smooth_bound
from muybridge.motion.contacts.feet import Leg
from muybridge.motion.contacts.floor import Floor
from muybridge.motion.contacts.footskate import contact_spans

HEEL, BALL = 0, 1
_LIFT_S = 0.05  # over which a foot is lifted out of the floor


@dataclass(frozen=True, eq=False)
class FootPlan:
    """A foot over time.

    Attributes:
        ankle: (T, 3) metres.
        turns: (T, 3, 3) world from foot.
        moved: (T, 3) metres, by which the ankle was moved.
    """

    ankle: FloatArray
    turns: FloatArray
    moved: FloatArray


def plan_foot(
    ankle: FloatArray, turns: FloatArray, leg: Leg, contact: BoolArray, floor: Floor, clearance: FloatArray,
    fps: float, seconds: float, step: float = np.inf, where: BoolArray | None = None, under: FloatArray | None = None,
) -> FootPlan:  # fmt: skip
    """Where a foot shall be.

    A flat foot keeps one orientation and one place; a foot on its ball turns about the ball, on its heel about the
    heel. What that takes is blended into the frames beside it.

    Args:
        ankle: (T, 3) metres, as it is.
        turns: (T, 3, 3) world from foot, as they are.
        leg: heel and ball from the ankle.
        contact: (T, 2) whether heel and ball stand.
        floor: what they stand on.
        clearance: (2,) metres of heel and ball over it.
        fps: frames per second.
        seconds: over which corrections fade.
        step: metres over the floor from which a contact keeps its own height: the foot stands on something.
        where: (T,) frames whose contacts are planned; in others the foot stays as it is. A contact stands where it does
            in its frames beside these, if it has any. None: all contacts, by all of their frames.
        under: (T,) metres that the foot may be in the floor while it does not stand. None: not at all.
    """
    flat = np.asarray(contact.all(1))
    standing = np.asarray(contact.any(1))
    left = _left_alone(standing, where)
    told = np.ones(len(standing), np.bool_) if where is None else ~where
    wanted = _flat_orientations(turns, flat, told, leg, floor, clearance)
    wanted[left] = turns[left]
    change = blend(log_so3(wanted @ np.swapaxes(turns, -1, -2)), flat.astype(np.float64), fps, seconds)
    turned = exp_so3(change) @ turns
    for point, pivot in ((HEEL, BALL), (BALL, HEEL)):
        only = contact[:, pivot] & ~contact[:, point] & ~left
        turned = _lifted_about(turned, only, leg, point, floor, clearance, fps)
    target = _targets(ankle, turned, leg, contact, told, floor, clearance, step)
    target[left] = ankle[left]
    moved = blend(target - ankle, standing.astype(np.float64), fps, seconds)
    moved = np.where(standing[:, None], target - ankle, moved)
    place = ankle + moved
    free = ~standing if where is None else ~standing & _about(where, ~standing)
    moved = moved + lift_out(place, turned, leg, ~free, floor, clearance, fps, under)
    return FootPlan(ankle + moved, turned, moved)


def _left_alone(standing: BoolArray, where: BoolArray | None) -> BoolArray:
    """(T,) frames of contacts that have no frame in `where`."""
    return np.zeros(len(standing), np.bool_) if where is None else standing & ~_about(where, standing)


def _about(where: BoolArray, runs: BoolArray) -> BoolArray:
    """(T,) the runs of true that have a frame in `where`, whole."""
    out = np.zeros(len(runs), np.bool_)
    for a, b in contact_spans(runs):
        out[a:b] = where[a:b].any()
    return out


def depth(place: FloatArray, turns: FloatArray, leg: Leg, floor: Floor, clearance: FloatArray) -> FloatArray:
    """(T,) metres by which heel or ball, whichever is deeper, is in the floor; negative over it. As `lift_out`."""
    points = (place + turns @ _offset(leg, p) for p in (HEEL, BALL))
    return np.asarray(np.max([c - floor.heights(x) for c, x in zip(clearance, points, strict=True)], axis=0))


def lift_out(
    place: FloatArray, turns: FloatArray, leg: Leg, standing: BoolArray, floor: Floor, clearance: FloatArray,
    fps: float, under: FloatArray | None = None,
) -> FloatArray:  # fmt: skip
    """(T, 3) metres, smooth, by which an ankle is lifted where its foot would be in the floor and does not stand.

    Args:
        place: (T, 3) metres, of the ankle.
        turns: (T, 3, 3) world from foot.
        leg: heel and ball from the ankle.
        standing: (T,) frames to be left alone.
        floor: which the foot may not pass.
        clearance: (2,) metres of heel and ball over it.
        fps: frames per second.
        under: (T,) metres that it may be in the floor. None: not at all.
    """
    deep = depth(place, turns, leg, floor, clearance) - (0.0 if under is None else under)
    return np.asarray(_lift(deep, ~standing, fps)[:, None] * np.array(floor.normal))


def _offset(leg: Leg, point: int) -> FloatArray:
    return leg.heel if point == HEEL else leg.ball


def _lift(deep: FloatArray, where: BoolArray, fps: float) -> FloatArray:
    """(T,) metres to lift by: smooth, at least what is `deep` (T,), and no more than that beside frames left alone."""
    least = np.where(where, np.maximum(deep, 0.0), 0.0)
    if where.all() or not least.any():
        return smooth_bound(least, _LIFT_S * fps)
    inside = np.clip(distance_transform_edt(where) / (_LIFT_S * fps + 1.0), 0.0, 1.0)
    return np.where(where, least + inside * (smooth_bound(least, _LIFT_S * fps) - least), 0.0)


def _flat_orientations(
    turns: FloatArray, flat: BoolArray, told: BoolArray, leg: Leg, floor: Floor, clearance: FloatArray
) -> FloatArray:
    """(T, 3, 3) one orientation for each span of a flat foot, heel and ball at their heights; as it is elsewhere."""
    out, line = turns.copy(), leg.ball - leg.heel
    normal = np.array(floor.normal)
    for a, b in contact_spans(flat):
        u, _, vt = np.linalg.svd(_those_told(turns, told, a, b).sum(0))
        mean = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
        now = mean @ line
        level = now - normal * (now @ normal)
        rise = float(np.clip((clearance[BALL] - clearance[HEEL]) / np.linalg.norm(line), -0.5, 0.5))
        axis = np.cross(level, normal)
        axis = axis / (np.linalg.norm(axis) + 1e-12)
        pitch = np.arcsin(rise) - np.arctan2(now @ normal, np.linalg.norm(level))
        out[a:b] = exp_so3(axis * pitch) @ mean
    return out


def _lifted_about(
    turns: FloatArray, only: BoolArray, leg: Leg, point: int, floor: Floor, clearance: FloatArray, fps: float
) -> FloatArray:
    """The orientations, turned about the pivot where the other point would be in the floor."""
    away = _offset(leg, point) - _offset(leg, BALL if point == HEEL else HEEL)
    size, normal = float(np.linalg.norm(away)), np.array(floor.normal)
    now = turns @ away
    rise = now @ normal
    least = clearance[point] - clearance[BALL if point == HEEL else HEEL]
    lift = _lift(least - rise, only, fps)
    if not lift.any():
        return turns
    level = now - rise[:, None] * normal
    axis = np.cross(level, normal)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True) + 1e-12
    angle = np.arcsin(np.clip((rise + lift) / size, -1, 1)) - np.arcsin(np.clip(rise / size, -1, 1))
    return np.asarray(exp_so3(axis * angle[:, None]) @ turns)


def _targets(
    ankle: FloatArray, turns: FloatArray, leg: Leg, contact: BoolArray, told: BoolArray, floor: Floor,
    clearance: FloatArray, step: float,
) -> FloatArray:  # fmt: skip
    """(T, 3) metres: ankles of a foot that stands with its points where each contact has them; as they are elsewhere.

    A contact of the ball has the mean of its places, of those in `told` (T,) if it has any; one of the heel follows
    from a ball that stands at the same time, and has its own mean where none does.
    """
    out = ankle.copy()
    heel, ball = (ankle + turns @ _offset(leg, p) for p in (HEEL, BALL))
    lever = turns @ (leg.ball - leg.heel)
    flat = np.asarray(contact.all(1))
    for start, stop in contact_spans(np.asarray(contact.any(1))):
        fixed: list[tuple[int, int, FloatArray]] = []  # contacts of the heel whose place is known
        for a, b in ((a + start, b + start) for a, b in contact_spans(contact[start:stop, BALL])):
            place = _place(_those_told(ball, told, a, b), floor, float(clearance[BALL]), step)
            for c, d, at in fixed:
                both = np.nonzero(flat[max(a, c) : min(b, d)])[0]
                if len(both):
                    place = at + lever[max(a, c) + both[0]]
                    break
            out[a:b] = place - turns[a:b] @ leg.ball
            for c, d in contact_spans(contact[:, HEEL]):
                both = np.nonzero(flat[max(a, c) : min(b, d)])[0] if max(a, c) < min(b, d) else np.zeros(0, int)
                if not len(both) or any(c == e for e, _, _ in fixed):
                    continue
                at = place - lever[max(a, c) + both[0]]
                fixed.append((c, d, at))
                alone = np.arange(c, d)[~contact[c:d, BALL]]
                out[alone] = at - turns[alone] @ leg.heel
        for c, d in ((a + start, b + start) for a, b in contact_spans(contact[start:stop, HEEL])):
            if not flat[c:d].any():
                place = _place(_those_told(heel, told, c, d), floor, float(clearance[HEEL]), step)
                out[c:d] = place - turns[c:d] @ leg.heel
    return out


def _those_told(values: FloatArray, told: BoolArray, a: int, b: int) -> FloatArray:
    """The values of a span that are in `told`; all of them where none is."""
    return values[a:b][told[a:b]] if told[a:b].any() else values[a:b]


def _place(points: FloatArray, floor: Floor, clearance: float, step: float) -> FloatArray:
    """(3,) metres: where a contact's points (T, 3) stand, on the floor or, `step` over it, at their own height."""
    mean = np.asarray(points.mean(0))
    over = float(floor.heights(mean)) - clearance
    return floor.onto(mean, clearance + (over if over > step else 0.0))
