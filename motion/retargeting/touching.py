"""Hands that touch the body or each other, kept touching; hands and forearms kept out of the body.

A hand near a part of the body that it hardly moves against is put where it is as seen from that part: as far along it,
in the same direction, as far from its surface. After the idea of relations between points of the body in E. S. L. Ho,
T. Komura, C.-L. Tai, "Spatial relationship preserving character motion adaptation", 2010.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import FloatArray
from muybridge.geometry.ik.two_bone import move_two_bone
from muybridge.geometry.roles.facing import unit
from muybridge.motion.character.character import Character
from muybridge.motion.contacts.blending import smooth_bound
from muybridge.motion.retargeting.body_parts import (
    ADULT_LEG_M,
    Part,
    Seen,
    find_parts,
    from_part,
    place_part,
    radius_at,
    see,
)
from muybridge.motion.retargeting.rig import SIDES, Posed, Rig

# Of an adult, metres and metres per second; scaled by the length of the legs.
_TOUCHES_M, _AWAY_M = 0.02, 0.07  # from the surface: touching, and not any more
_RESTS, _PASSES = 0.2, 0.6  # speed against the part, likewise
_PALM_M, _THICK_M = 0.07, 0.02  # from the wrist to the middle of the hand, and half of its thickness
_FOREARM_M = 0.035  # its radius
_HANDS_M = 0.12  # between the middles of two hands: they touch; twice as far, not any more
_MOST = 0.4  # of the arm: how far a hand is moved
_SMOOTH_S = 0.05
_BLEND_S = 0.12  # over which a hand goes to what it will touch
_ROUNDS = 4
_LEVERS = (0.5, 0.75, 1.0)  # along the forearm: points that are kept out of the body


@dataclass(frozen=True, eq=False)
class _Arm:
    """One arm of a rig: shoulder, elbow, wrist, and (3,) metres at rest from the wrist to the middle of the hand."""

    shoulder: int
    elbow: int
    wrist: int
    palm: FloatArray


def keep_touch(source: Rig, posed: Posed, target: Rig, ours: Posed, character: Character, fps: float) -> FloatArray:
    """Turn a target's arms such that its hands touch what the source's touch, and stay outside of its body.

    Args:
        source: rig of the take.
        posed: the take.
        target: rig of the character.
        ours: the take on it; its turns and places are changed in place, of the arms alone.
        character: whose meshes show the shape of its body.
        fps: frames per second.

    Returns:
        (T, 2) metres by which the left and the right hand were moved.
    """
    theirs, mine = find_parts(source), find_parts(target, character)
    arms = [(_arm(source, side), _arm(target, side)) for side in SIDES]
    parts, solid = (theirs, mine), bool(character.meshes)
    moves = np.stack([_to_parts(source, posed, target, ours, pair, parts, fps, solid) for pair in arms], axis=1)
    moves = moves + _to_each_other(source, posed, target, ours, arms, fps)
    size = target.leg_length() / ADULT_LEG_M
    for k, (_, arm) in enumerate(arms):
        move = _within(moves[:, k], _MOST * _length(target, arm))
        _move_hand(target, ours, arm, move)
        if character.meshes:
            for _ in range(_ROUNDS):
                out = _out_of_body(ours, arm, mine, size, fps)
                if not out.any():
                    break
                move = move + out
                _move_hand(target, ours, arm, out)
        moves[:, k] = move
    return np.asarray(np.linalg.norm(moves, axis=-1))


def _arm(rig: Rig, side: str) -> _Arm:
    shoulder, elbow, wrist = (rig.roles[f"{side}_{part}"] for part in ("upper_arm", "forearm", "hand"))
    way = unit(rig.places[wrist] - rig.places[elbow])
    return _Arm(shoulder, elbow, wrist, _PALM_M * rig.leg_length() / ADULT_LEG_M * way)


def _length(rig: Rig, arm: _Arm) -> float:
    places = rig.places[[arm.shoulder, arm.elbow, arm.wrist]]
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _palm(posed: Posed, arm: _Arm) -> FloatArray:
    """(T, 3) metres of the middle of a hand."""
    return np.asarray(posed.places[:, arm.wrist] + posed.turns[:, arm.wrist] @ arm.palm)


def _to_parts(
    source: Rig, posed: Posed, target: Rig, ours: Posed, pair: tuple[_Arm, _Arm],
    parts: tuple[dict[str, Part], dict[str, Part]], fps: float, solid: bool,
) -> FloatArray:  # fmt: skip
    """(T, 3) metres to where a hand is as the parts that it touches see it; not within them where they are solid."""
    sizes = source.leg_length() / ADULT_LEG_M, target.leg_length() / ADULT_LEG_M
    hand, now = _palm(posed, pair[0]), _palm(ours, pair[1])
    total, weights = np.zeros_like(now), np.zeros(len(now))
    for name in parts[0].keys() & parts[1].keys():
        placed = place_part(parts[0][name], posed)
        seen = see(placed, hand)
        gap = seen.far - radius_at(parts[0][name], seen) - _THICK_M * sizes[0]
        local = (np.swapaxes(placed.axes, -1, -2) @ (hand - placed.start)[..., None])[..., 0]
        weight = _fading(gap / sizes[0], _TOUCHES_M, _AWAY_M) * _resting(local, sizes[0], fps)
        if not weight.any():
            continue
        weight = smooth_bound(weight, _BLEND_S * fps)
        gap = np.maximum(gap, 0.0) if solid else gap
        far = radius_at(parts[1][name], seen) + _THICK_M * sizes[1] + gap * sizes[1] / sizes[0]
        goal = from_part(place_part(parts[1][name], ours), Seen(seen.along, seen.way, seen.far), far)
        total += weight[:, None] * (goal - now)
        weights += weight
    return np.asarray(total / np.maximum(weights, 1.0)[:, None])


def _to_each_other(
    source: Rig, posed: Posed, target: Rig, ours: Posed, arms: list[tuple[_Arm, _Arm]], fps: float
) -> FloatArray:
    """(T, 2, 3) metres, half of the way each, that bring hands which touch as near to each other as the source's."""
    sizes = source.leg_length() / ADULT_LEG_M, target.leg_length() / ADULT_LEG_M
    gap = np.subtract(*(_palm(posed, theirs) for theirs, _ in arms))
    now = np.subtract(*(_palm(ours, mine) for _, mine in arms))
    weight = _fading(np.linalg.norm(gap, axis=1) / sizes[0], _HANDS_M, 2 * _HANDS_M) * _resting(gap, sizes[0], fps)
    weight = smooth_bound(weight, _BLEND_S * fps)
    half = 0.5 * weight[:, None] * (gap * sizes[1] / sizes[0] - now)
    return np.stack([half, -half], axis=1)


def _fading(values: FloatArray, full: float, none: float) -> FloatArray:
    """1 up to `full`, 0 from `none` on, smoothly between."""
    share = np.clip((none - values) / (none - full), 0.0, 1.0)
    return np.asarray(share * share * (3 - 2 * share))


def _resting(local: FloatArray, size: float, fps: float) -> FloatArray:
    """(T,) 1 where a point (T, 3) hardly moves as a part sees it, 0 where it passes by."""
    if len(local) < 2:
        return np.ones(len(local))
    smooth = gaussian_filter1d(local, max(_SMOOTH_S * fps, 1e-3), axis=0, mode="nearest")
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=1) * fps
    return _fading(speed / size, _RESTS, _PASSES)


def _within(move: FloatArray, most: float) -> FloatArray:
    """(T, 3) moves that are nowhere longer than `most`, and short ones as they are, nearly."""
    far = np.linalg.norm(move, axis=1, keepdims=True)
    return np.asarray(move * np.where(far > 1e-9, most * np.tanh(far / most) / np.maximum(far, 1e-9), 1.0))


def _out_of_body(ours: Posed, arm: _Arm, parts: dict[str, Part], size: float, fps: float) -> FloatArray:
    """(T, 3) metres by which a wrist has to move, smoothly, for forearm and hand to leave the parts of the body."""
    elbow, wrist = ours.places[:, arm.elbow], ours.places[:, arm.wrist]
    points = [(elbow + f * (wrist - elbow), f, _FOREARM_M) for f in _LEVERS] + [(_palm(ours, arm), 1.0, _THICK_M)]
    worst = np.zeros((len(wrist), 3))
    for part in parts.values():
        placed = place_part(part, ours)
        deepest, way = np.zeros(len(wrist)), np.zeros((len(wrist), 3))
        for point, lever, thick in points:
            seen = see(placed, point)
            depth = np.maximum(radius_at(part, seen) + thick * size - seen.far, 0.0) / lever
            # Beyond the line's ends the way out is not along it, which would send a hand over the shoulder.
            flat = seen.way * [1, 1, 0]
            flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
            more = depth > deepest
            deepest = np.where(more, depth, deepest)
            way = np.where(more[:, None], (placed.axes @ flat[..., None])[..., 0], way)
        worst += deepest[:, None] * way
    far = np.linalg.norm(worst, axis=1)
    if far.max(initial=0.0) < 1e-3 * size:
        return np.zeros_like(worst)
    frames = _SMOOTH_S * fps
    ways = gaussian_filter1d(worst, max(frames, 0.5), axis=0, mode="nearest")
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
    return np.asarray(ways * smooth_bound(far, frames)[:, None])


def _move_hand(rig: Rig, ours: Posed, arm: _Arm, move: FloatArray) -> None:
    """Turn an arm, in place, so that its wrist moves by (T, 3) metres; the hand keeps its orientation."""
    moved = np.linalg.norm(move, axis=1) > 0
    if not moved.any():
        return
    hip, knee, end = (ours.places[moved, j] for j in (arm.shoulder, arm.elbow, arm.wrist))
    back = ours.turns[moved, arm.elbow] @ np.array([0.0, 1.0, 0.0])
    upper, lower, _ = move_two_bone((hip, knee, end), hip, end + move[moved], back)
    for j in range(len(rig.parents)):
        line = rig.above(j)
        if arm.shoulder not in line:
            continue
        turn = None if arm.wrist in line else lower if arm.elbow in line else upper
        if turn is not None:
            ours.turns[moved, j] = turn @ ours.turns[moved, j]
        if j != arm.shoulder:
            parent = rig.parents[j]
            shift = ours.turns[moved, parent] @ (rig.places[j] - rig.places[parent])
            ours.places[moved, j] = ours.places[moved, parent] + shift
