"""Which side of a symmetric body is its left, by what points forwards: toes, knees, elbows, thumbs, eyes."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.limbs import Limb, finger_chains
from muybridge.geometry.roles.tree import Tree

_WEAK = 0.25  # evidence below which a body says nothing of where its front is


@dataclass(frozen=True)
class Sides:
    """A body whose two sides are known, but not which is left.

    Attributes:
        legs: of one side and of the other.
        arms: the same sides.
        head: the joint of the head, -1 where there is none.
    """

    legs: tuple[Limb, Limb]
    arms: tuple[Limb, Limb]
    head: int


def body_axes(places: FloatArray, sides: Sides) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(3,) unit vectors of a pose: up, from the second side to the first, and forwards if the first side is left.

    Args:
        places: (J, 3) metres.
        sides: of the body.
    """
    hips = [places[leg.joints[0]] for leg in sides.legs]
    shoulders = [places[arm.joints[0]] for arm in sides.arms]
    up = unit((shoulders[0] + shoulders[1]) / 2 - (hips[0] + hips[1]) / 2)
    across = unit(hips[0] - hips[1]) + unit(shoulders[0] - shoulders[1])
    across = unit(across - (across @ up) * up)
    return up, across, np.asarray(np.cross(across, up))


def left_evidence(tree: Tree, places: FloatArray, sides: Sides, rest: bool) -> float:
    """Above zero where the first side is the left one; below, where the second is.

    Args:
        tree: of the skeleton.
        places: (J, 3) metres, one pose.
        sides: of the body.
        rest: whether the pose is the one at rest, in which hands and elbows have their usual places.
    """
    forward = body_axes(places, sides)[2]
    leg = max(float(np.mean([limb.length for limb in sides.legs])), 1e-9)
    out = 0.0
    for limb in sides.legs:
        out += 2.0 * _saturated(_toes(tree, places, limb) @ forward / leg, 0.05)
        out += 1.0 * _saturated(_bulge(places, limb) @ forward / leg, 0.02)
    if not rest:
        return out
    for limb in sides.arms:
        out -= 0.5 * _saturated(_bulge(places, limb) @ forward / leg, 0.02)
        out += 1.0 * _saturated(_thumb(tree, limb) @ forward / leg, 0.04)
    return out + 0.75 * _saturated(_eyes(tree, sides.head) @ forward / leg, 0.04)


def is_weak(evidence: float) -> bool:
    """Whether evidence is too little to tell the left from the right."""
    return abs(evidence) < _WEAK


def unit(vector: FloatArray) -> FloatArray:
    """A vector at length one; zero stays zero."""
    return np.asarray(vector / (np.linalg.norm(vector) + 1e-12))


def _saturated(value: Any, scale: float) -> float:
    return float(np.tanh(value / scale))


def _toes(tree: Tree, places: FloatArray, limb: Limb) -> FloatArray:
    """(3,) from the ankle to the end of the foot's longest branch; zero for a foot without any."""
    if len(limb.joints) < 3:
        return np.zeros(3)
    ankle = limb.joints[-1]
    chain = tree.main_chain(ankle)
    tip = np.nan_to_num(tree.tips[chain[-1]]) if places is tree.at else np.zeros(3)
    return np.asarray(places[chain[-1]] + tip - places[ankle])


def _bulge(places: FloatArray, limb: Limb) -> FloatArray:
    """(3,) from the line between a limb's ends to its middle joint."""
    if len(limb.joints) < 3:
        return np.zeros(3)
    start, middle, end = (places[j] for j in limb.joints)
    line = unit(end - start)
    return np.asarray((middle - start) - ((middle - start) @ line) * line)


def _thumb(tree: Tree, limb: Limb) -> FloatArray:
    """(3,) from the middle of the other fingers to the thumb; zero where there are no fingers."""
    if len(limb.joints) < 3:
        return np.zeros(3)
    hand, line = limb.joints[-1], unit(tree.at[limb.joints[-1]] - tree.at[limb.joints[-2]])
    chains = [c for c in finger_chains(tree, hand) if len(c) >= 2]
    if len(chains) < 3:
        return np.zeros(3)
    bases = np.array([tree.at[c[0]] - tree.at[hand] for c in chains])
    thumb = int(np.argmin(bases @ line))
    across = np.array([np.mean([tree.at[j] for j in c], axis=0) for c in chains])
    gap = across[thumb] - np.delete(across, thumb, axis=0).mean(axis=0)
    return np.asarray(gap - (gap @ line) * line)


def _eyes(tree: Tree, head: int) -> FloatArray:
    """(3,) from the head's joint to the middle of its single joints that come in twos; zero where there are none."""
    if head < 0:
        return np.zeros(3)
    leaves = [j for j in tree.children[head] if not tree.children[j] and tree.lengths[j] > 0]
    gaps = [
        (abs(float(tree.lengths[a] - tree.lengths[b])), a, b) for k, a in enumerate(leaves) for b in leaves[k + 1 :]
    ]
    twins = [(a, b) for gap, a, b in gaps if gap < 0.02 * float(tree.lengths[a])]
    if not twins:
        return np.zeros(3)
    return np.asarray(np.mean([(tree.at[a] + tree.at[b]) / 2 for a, b in twins], axis=0) - tree.at[head])
