"""Roles by geometry alone: the two mirrored pairs of branches that are most like legs and arms, and what joins them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.facing import Sides, body_axes, is_weak, left_evidence, unit
from muybridge.geometry.roles.limbs import Limb, hand_index, split_limb
from muybridge.geometry.roles.role_map import LIMBS, Kind
from muybridge.geometry.roles.tree import Pair, Tree, build_tree, lowest_common, mirrored_pairs
from muybridge.geometry.roles.trunk import finger_roles, head_chain, head_roles, trunk_roles
from muybridge.geometry.skeleton.skeleton import Skeleton

_ARM_OF_LEG, _TRUNK_OF_LEG = 0.85, 0.6  # usual lengths
_UPRIGHT = 0.5  # cosine between the trunk and the reverse of the legs above which a body stands on two legs
_SHORTEST_TRUNK, _SHORTEST_ARM = 0.12, 0.25  # of the leg: less is no human body
_MOST_PAIRS = 24
_MOST_POSES = 12


@dataclass(frozen=True, eq=False)
class Body:
    """What geometry finds.

    Attributes:
        roles: role -> index; empty where nothing human was found.
        kind: of the skeleton.
        notes: assumptions, one sentence each.
    """

    roles: dict[str, int]
    kind: Kind
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Guess:
    legs: Pair
    arms: Pair
    sides: Sides
    score: float


def find_by_geometry(skeleton: Skeleton, positions: FloatArray | None = None) -> Body:
    """Roles of a skeleton without a look at its names.

    Args:
        skeleton: in any units, with any axis up.
        positions: (T, J, 3) metres of a motion, which is judged where the rest pose is no standing body.
    """
    tree = build_tree(skeleton)
    guess = _best_guess(tree)
    if guess is None:
        return Body({}, "other")
    poses, at_rest = [tree.at], True
    kind = _kind(poses, guess)
    if kind != "human" and positions is not None and len(positions) > 1:
        moved = list(positions[np.linspace(0, len(positions) - 1, min(len(positions), _MOST_POSES)).astype(int)])
        if (of_motion := _kind(moved, guess)) == "human":
            poses, kind, at_rest = moved, of_motion, False
    if kind != "human":
        return Body({}, kind)
    evidence = float(np.mean([left_evidence(tree, pose, guess.sides, at_rest) for pose in poses]))
    if at_rest and positions is not None and len(positions) > 1:
        evidence += _of_motion(tree, positions, guess.sides)
    left, notes = evidence > 0, []
    if is_weak(evidence):
        left = _usual_side(poses[0], guess.sides)
        notes.append("nothing of the skeleton shows where its front is, so left and right were taken as if it faced -Y")
    return Body(_roles(tree, guess, left, poses[0]), "human", tuple(notes))


def _of_motion(tree: Tree, positions: FloatArray, sides: Sides) -> float:
    """Evidence for the first side as the left one from how the knees bend over a motion."""
    frames = np.linspace(0, len(positions) - 1, min(len(positions), _MOST_POSES)).astype(int)
    return float(np.mean([left_evidence(tree, positions[t], sides, False) for t in frames]))


def _usual_side(places: FloatArray, sides: Sides) -> bool:
    """Whether the first side is the left one of a body that faces -Y, or +X where it is seen from the side."""
    forward = body_axes(places, sides)[2]
    weight = -forward[1] if abs(forward[1]) > 0.5 else forward[0] if abs(forward[0]) > 0.5 else forward[2]
    return bool(weight > 0)


def _best_guess(tree: Tree) -> _Guess | None:
    pairs = sorted(mirrored_pairs(tree), key=lambda p: -float(tree.reach[list(p.tops)].sum()) * p.matched)
    pairs = pairs[:_MOST_PAIRS]
    nested = [set(tree.below(p.tops[0])) | set(tree.below(p.tops[1])) for p in pairs]
    best: _Guess | None = None
    legs = [_limbs(tree, p, leg=True) for p in pairs]
    arms = [_limbs(tree, p, leg=False) for p in pairs]
    for i, low in enumerate(pairs):
        for k, high in enumerate(pairs):
            if i == k or nested[i] & nested[k]:
                continue
            sides = _same_side(tree, legs[i], arms[k])
            score = _score(tree, low, high, sides)
            if best is None or score > best.score:
                best = _Guess(low, high, sides, score)
    return best


def _limbs(tree: Tree, pair: Pair, leg: bool) -> tuple[Limb, Limb]:
    ends = [None if leg else hand_index(tree, chain) for chain in pair.chains]
    end = ends[0] if ends[0] == ends[1] else ends[0] or ends[1]
    first, second = (split_limb(tree, chain, leg, end) for chain in pair.chains)
    # Both sides are split at the same places, as the better one is.
    if len(first.joints) == 3 and len(first.before) != len(second.before) or len(first.after) != len(second.after):
        better = first if first.score >= second.score else second
        places = [pair.chains[0 if better is first else 1].index(j) for j in better.joints]
        first, second = (_at_places(better, chain, places) for chain in pair.chains)
    return first, second


def _at_places(limb: Limb, chain: Sequence[int], places: Sequence[int]) -> Limb:
    return Limb(tuple(chain[p] for p in places), tuple(chain[: places[0]]), tuple(chain[places[-1] + 1 :]), limb.score,
                limb.length)  # fmt: skip


def _same_side(tree: Tree, legs: tuple[Limb, Limb], arms: tuple[Limb, Limb]) -> Sides:
    """Legs and arms with the first leg on the side of the first arm."""
    across = tree.at[legs[0].joints[0]] - tree.at[legs[1].joints[0]]
    reach = tree.at[arms[0].joints[0]] - tree.at[arms[1].joints[0]]
    if np.linalg.norm(across) < 1e-6 * tree.size:
        across = tree.at[legs[0].joints[-1]] - tree.at[legs[1].joints[-1]]
    if np.linalg.norm(reach) < 1e-6 * tree.size:
        reach = tree.at[arms[0].joints[-1]] - tree.at[arms[1].joints[-1]]
    return Sides(legs, arms if across @ reach >= 0 else (arms[1], arms[0]), -1)


def _score(tree: Tree, low: Pair, high: Pair, sides: Sides) -> float:
    """How much like a human body's legs and arms two pairs of branches are."""
    leg = float(np.mean([limb.length for limb in sides.legs]))
    arm = float(np.mean([limb.length for limb in sides.arms]))
    hips, ends = _middle(tree.at, sides.legs, 0), _middle(tree.at, sides.legs, -1)
    trunk = _middle(tree.at, sides.arms, 0) - hips
    long = float(np.linalg.norm(trunk))
    if min(leg, arm, long) < 1e-6 * tree.size:
        return -99.0
    score = float(np.mean([limb.score for limb in (*sides.legs, *sides.arms)])) * 2
    score -= 1.5 * float(unit(trunk) @ unit(ends - hips))
    score -= abs(float(np.log(arm / leg / _ARM_OF_LEG))) + 0.7 * abs(float(np.log(long / leg / _TRUNK_OF_LEG)))
    widths = [unit(tree.at[pair[0].joints[n]] - tree.at[pair[1].joints[n]])
              for pair, n in ((sides.legs, 0), (sides.legs, -1), (sides.arms, 0), (sides.arms, -1))]  # fmt: skip
    score += 0.5 * float(widths[0] @ widths[2] + widths[1] @ widths[3])
    score -= float(np.mean([abs(w @ unit(trunk)) for w in widths]))
    score += low.matched + high.matched
    above_low, above_high = tree.above(low.parent), tree.above(high.parent)
    if low.parent == high.parent:
        score -= 0.5
    elif low.parent in above_high:
        score += 1.0
    elif high.parent in above_low:
        score -= 3.0
    return score


def _middle(places: FloatArray, limbs: tuple[Limb, Limb], n: int) -> FloatArray:
    return np.asarray((places[limbs[0].joints[n]] + places[limbs[1].joints[n]]) / 2)


def _kind(poses: Sequence[FloatArray], guess: _Guess) -> Kind:
    """What stands there: two legs below an upright trunk, four below a level one, or something else."""
    sides, cosines, levels, sizes = guess.sides, [], [], []
    for places in poses:
        legs = [places[limb.joints[-1]] - places[limb.joints[0]] for limb in sides.legs]
        arms = [places[limb.joints[-1]] - places[limb.joints[0]] for limb in sides.arms]
        trunk = _middle(places, sides.arms, 0) - _middle(places, sides.legs, 0)
        leg = max(float(np.mean([np.linalg.norm(v) for v in legs])), 1e-9)
        cosines.append(-float(unit(trunk) @ unit(legs[0] + legs[1])))
        sizes.append([float(np.linalg.norm(trunk)) / leg, float(np.mean([np.linalg.norm(v) for v in arms])) / leg])
        levels.append(_front_legs(places, guess))
    upright = float(np.median(cosines))
    trunk_size, arm_size = np.median(sizes, axis=0)
    if abs(upright) < 0.85 and np.median(levels) > 0.5:
        return "quadruped"
    if upright < _UPRIGHT or trunk_size < _SHORTEST_TRUNK or arm_size < _SHORTEST_ARM:
        return "other"
    return "human"


def _front_legs(places: FloatArray, guess: _Guess) -> bool:
    """Whether the arms reach down as far as the legs, as the front legs of an animal do."""
    ends, ways = [], []
    for pair in (guess.legs, guess.arms):
        sides = [places[chain[-1]] - places[chain[0]] for chain in pair.chains]
        ends.append((places[pair.chains[0][-1]] + places[pair.chains[1][-1]]) / 2)
        # Shorter than one where the two sides point apart, as the arms of a T-pose do.
        ways.append((sides[0] + sides[1]) / max(float(np.linalg.norm(sides[0]) + np.linalg.norm(sides[1])), 1e-9))
    leg = max(float(np.linalg.norm(places[c[-1]] - places[c[0]])) for c in guess.legs.chains)
    down = unit(unit(ways[0]) + unit(ways[1]))
    return bool((ends[1] - ends[0]) @ down > -0.2 * leg and min(w @ down for w in ways) > 0.6)


def _roles(tree: Tree, guess: _Guess, first_is_left: bool, pose: FloatArray) -> dict[str, int]:
    sides = guess.sides
    up, across, _ = body_axes(pose, sides)
    chest = guess.arms.parent
    roles: dict[str, int] = {}
    legs, arms = LIMBS[:3], LIMBS[3:]
    for limbs, parts in ((sides.legs, legs), (sides.arms, arms)):
        for limb, side in zip(limbs, ("left", "right") if first_is_left else ("right", "left"), strict=True):
            roles |= {f"{side}_{part}": j for part, j in zip(parts, limb.joints, strict=False)}
            if parts is arms and limb.before:
                roles[f"{side}_clavicle"] = limb.before[-1]
            if len(limb.joints) == 3 and parts is legs and limb.after:
                roles[f"{side}_toe"] = limb.after[0]
    roles["hips"] = guess.legs.parent
    if roles["hips"] < 0:
        roles["hips"] = lowest_common(tree, [*guess.legs.tops, *guess.arms.tops])
    if roles["hips"] < 0:
        del roles["hips"]
        return _feet_elsewhere(tree, roles, pose)
    roles |= {r: j for r, j in trunk_roles(tree, roles["hips"], chest).items() if j not in roles.values()}
    long = float(np.linalg.norm(_middle(tree.at, sides.arms, 0) - _middle(tree.at, sides.legs, 0)))
    limbs_tops = {*guess.legs.tops, *guess.arms.tops}
    chain = head_chain(tree, chest, limbs_tops, up, across) if pose is tree.at else []
    roles |= {
        r: j for r, j in head_roles(tree, chain, long, len(sides.legs[0].after) > 1).items() if j not in roles.values()
    }
    for side in ("left", "right"):
        if {f"{side}_hand", f"{side}_forearm"} <= set(roles):
            hand, elbow = roles[f"{side}_hand"], roles[f"{side}_forearm"]
            fingers = finger_roles(tree, hand, unit(tree.at[hand] - tree.at[elbow]))
            roles |= {f"{side}_{name}": j for name, j in fingers.items()}
    return _feet_elsewhere(tree, roles, pose)


def _feet_elsewhere(tree: Tree, roles: dict[str, int], pose: FloatArray) -> dict[str, int]:
    """Feet that hang from a control bone of their own, at the end of the shins: joints that carry others.

    Where the shin's own end is a bare end bone, a joint with joints below it at the same place is the foot.
    """
    out = dict(roles)
    for side in ("left", "right"):
        thigh, shin = roles.get(f"{side}_thigh"), roles.get(f"{side}_shin")
        foot = roles.get(f"{side}_foot")
        if thigh is None or shin is None or (foot is not None and tree.children[foot]):
            continue
        bone = pose[shin] - pose[thigh]
        wanted = pose[shin] + bone if foot is None else pose[foot]
        room = (0.45 if foot is None else 0.15) * float(np.linalg.norm(bone))
        taken = set(tree.below(thigh)) | set(out.values())
        near = [(float(np.linalg.norm(pose[j] - wanted)), j) for j in range(len(pose))
                if j not in taken and (tree.children[j] or foot is None)]  # fmt: skip
        if near and min(near)[0] < room:
            out[f"{side}_foot"] = min(near)[1]
    return out
