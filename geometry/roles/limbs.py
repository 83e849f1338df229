"""Which joints of a chain are the shoulder, elbow and wrist of an arm, or the hip, knee and ankle of a leg.

A limb's two bones are about equally long and each is straight; what comes before (clavicles, buttocks) and after
(hands, feet) is shorter. Joints within a bone (twist bones) lie on its line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.tree import Tree

_HELPER_OF_LEG, _HELPER_OF_ARM = 0.25, 0.45  # of a limb: what may come before it
_RATIO_OF_LEG, _RATIO_OF_ARM = 1.0, 0.9  # usual second bone over first
_TAIL = 0.7  # of the second bone: what may come after it, along the chain
_FORK = 0.6  # for a wrist that the chain branches at
_BENT, _STRAIGHT = np.radians(25), np.radians(12)


@dataclass(frozen=True)
class Limb:
    """The joints of a limb.

    Attributes:
        joints: root, middle and end of the limb; fewer where the chain is shorter.
        before: joints of the chain above the limb's root.
        after: joints of the chain below the limb's end.
        score: how much like a limb it is; comparable between limbs of one kind.
        length: metres of both bones.
    """

    joints: tuple[int, ...]
    before: tuple[int, ...]
    after: tuple[int, ...]
    score: float
    length: float


def split_limb(tree: Tree, chain: Sequence[int], leg: bool, end: int | None = None) -> Limb:
    """The most limb-like three joints of a chain.

    Args:
        tree: of the skeleton.
        chain: joints from the body outwards.
        leg: whether it is a leg, whose end may be known by the bend of the ankle.
        end: index in the chain of the limb's end where that is known (the joint with fingers).
    """
    points = tree.at[list(chain)]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    total = float(along[-1] + np.linalg.norm(np.nan_to_num(tree.tips[chain[-1]])))
    if end is not None:
        total = float(along[end])
    best: tuple[float, tuple[int, int, int]] | None = None
    for triple in combinations(range(len(chain)), 3):
        if end is not None and triple[2] != end:
            continue
        score = _score(points, along, total, triple, leg)
        if not leg and _forks(tree, chain[triple[2]]):
            score += _FORK
        if best is None or score > best[0] + 1e-9:
            best = score, triple
    if best is None or total <= 0:
        return Limb(tuple(chain), (), (), -3.0, total)
    i, j, k = best[1]
    return Limb((chain[i], chain[j], chain[k]), tuple(chain[:i]), tuple(chain[k + 1 :]), best[0],
                float(along[k] - along[i]))  # fmt: skip


def _forks(tree: Tree, j: int) -> bool:
    """Whether branches part at the place of a joint: its children do, or a sibling is at the same place."""
    little = 1e-3 * tree.size
    apart = [c for c in tree.children[j] if tree.lengths[c] > little]
    spots = tree.at[apart]
    together = len(spots) == len(tree.children[j]) > 0 and bool(np.ptp(spots, axis=0).max() < little)
    above = tree.parents[j]
    beside = [c for c in tree.children[above] if c != j] if above >= 0 else []
    return (len(tree.children[j]) > 1 and not together) or any(
        float(np.linalg.norm(tree.at[c] - tree.at[j])) < little for c in beside
    )


def _score(points: FloatArray, along: FloatArray, total: float, triple: tuple[int, int, int], leg: bool) -> float:
    i, j, k = triple
    first, second = float(np.linalg.norm(points[j] - points[i])), float(np.linalg.norm(points[k] - points[j]))
    limb = float(along[k] - along[i])
    if min(first, second) < 1e-3 * total or limb < 1e-9:
        return -9.0
    helper, ratio = (_HELPER_OF_LEG, _RATIO_OF_LEG) if leg else (_HELPER_OF_ARM, _RATIO_OF_ARM)
    score = -1.5 * abs(np.log(second / first / ratio))
    score -= 6.0 * ((along[j] - along[i]) / first - 1 + (along[k] - along[j]) / second - 1)
    score += 1.5 * limb / total
    before, after = along[i] / limb, (total - along[k]) / second
    score -= 3.0 * max(0.0, before - helper) + 1.0 * max(0.0, after - _TAIL)
    score += 0.12 if i and before < helper else 0.0
    score -= 0.2 * (k - i - 2)
    if leg and k + 1 < len(points) and along[k + 1] - along[k] > 0.02 * limb:
        turn = _angle(points[k] - points[j], points[k + 1] - points[k])
        score += 0.5 if turn > _BENT else -0.3 if turn < _STRAIGHT else 0.0
    return float(score)


def _angle(a: FloatArray, b: FloatArray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def finger_chains(tree: Tree, hand: int) -> list[list[int]]:
    """The chains of joints below a hand, without end bones of length zero; the longest first."""
    chains = [tree.main_chain(c) for c in tree.children[hand]]
    return sorted(chains, key=lambda c: -float(tree.reach[c[0]]))


def hand_index(tree: Tree, chain: Sequence[int]) -> int | None:
    """Index in an arm's chain of the joint that carries fingers, None where none does.

    A hand carries three branches or more, each of two joints at least, or two of which neither is a mere helper; helper
    bones beside a forearm (twist, muscles) are single joints.
    """
    for k, joint in enumerate(chain):
        if k < 2:
            continue
        long = [c for c in tree.children[joint] if tree.children[c] and tree.reach[c] > 0]
        # Fingers of one joint each: as many as a hand has, and none of them long.
        short = [c for c in tree.children[joint] if tree.lengths[c] > 0]
        if len(long) >= 3 or len(short) >= 4 or (len(long) == 2 and _like_fingers(tree, chain, k, long)):
            return k
    return None


def _like_fingers(tree: Tree, chain: Sequence[int], k: int, joints: Sequence[int]) -> bool:
    """Whether two branches are shorter than what is above them, as a thumb and the rest of a hand are."""
    above = float(np.linalg.norm(tree.at[chain[k]] - tree.at[chain[k - 1]]))
    return all(tree.lengths[c] + tree.reach[c] < 0.9 * above for c in joints)
