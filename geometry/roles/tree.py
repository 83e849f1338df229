"""A skeleton's tree by its geometry: how far it reaches below each joint, and which of its branches mirror each other.

Names are never looked at. Lengths are compared with the size of the whole, so that units do not matter.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.skeleton import Skeleton

_UNLIKE = 0.55  # difference of two branches above which they do not mirror each other
_SHORTEST = 0.03  # of the size: a limb reaches at least so far


@dataclass(frozen=True, eq=False)
class Tree:
    """What the search for limbs needs of a skeleton.

    Attributes:
        parents: (J,) as in the skeleton.
        children: (J,) tuples of indices.
        at: (J, 3) metres, the joints at rest.
        tips: (J, 3) metres from a joint to its bone's end, NaN where that is not known.
        lengths: (J,) metres from the parent.
        reach: (J,) metres of the longest path below a joint, along the bones.
        counts: (J,) joints at and below each.
        size: metres, the diagonal of the box around all joints.
    """

    parents: tuple[int, ...]
    children: tuple[tuple[int, ...], ...]
    at: FloatArray
    tips: FloatArray
    lengths: FloatArray
    reach: FloatArray
    counts: FloatArray
    size: float

    def above(self, j: int) -> list[int]:
        """A joint and those above it, itself first."""
        path = []
        while j >= 0:
            path.append(j)
            j = self.parents[j]
        return path

    def below(self, j: int) -> list[int]:
        """A joint and all below it, parents first."""
        out = [j]
        for k in out:
            out.extend(self.children[k])
        return out

    def main_chain(self, j: int) -> list[int]:
        """From a joint down the branch that reaches farthest at every fork."""
        chain = [j]
        while self.children[chain[-1]]:
            chain.append(max(self.children[chain[-1]], key=lambda c: float(self.lengths[c] + self.reach[c])))
        return chain

    def end(self, j: int) -> FloatArray:
        """(3,) where a joint's bone ends: its tip where it is known, else the joint."""
        return np.asarray(self.at[j] + np.nan_to_num(self.tips[j]))


def build_tree(skeleton: Skeleton) -> Tree:
    """The tree of a skeleton at rest."""
    count = len(skeleton)
    children: list[list[int]] = [[] for _ in range(count)]
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            children[parent].append(j)
    at, lengths = skeleton.rest_positions, skeleton.bone_lengths
    reach, counts = np.zeros(count), np.ones(count)
    tips = np.linalg.norm(np.nan_to_num(skeleton.tips), axis=1)
    for j in reversed(range(count)):
        reach[j] = max((lengths[c] + reach[c] for c in children[j]), default=tips[j])
        counts[j] += sum(counts[c] for c in children[j])
    size = float(np.linalg.norm(np.ptp(at, axis=0))) or 1.0
    return Tree(skeleton.parents, tuple(map(tuple, children)), at, skeleton.tips, lengths, reach, counts, size)


def lowest_common(tree: Tree, joints: list[int]) -> int:
    """The lowest joint above all of these (itself one of them possibly), -1 if there is none."""
    shared = set(tree.above(joints[0])).intersection(*(tree.above(j) for j in joints[1:]))
    return max(shared, key=lambda j: len(tree.above(j)), default=-1)


@dataclass(frozen=True)
class Pair:
    """Two branches that mirror each other.

    Attributes:
        parent: the joint that both hang from, -1 for two roots.
        chains: the main chain of each, of equal length and joint by joint.
        matched: share of the bones' length, of the larger branch, that has its counterpart in the other.
    """

    parent: int
    chains: tuple[tuple[int, ...], tuple[int, ...]]
    matched: float

    @property
    def tops(self) -> tuple[int, int]:
        """The first joint of each branch."""
        return self.chains[0][0], self.chains[1][0]


def mirrored_pairs(tree: Tree) -> list[Pair]:
    """All pairs of branches that hang from one joint, are long enough for a limb and mirror each other."""
    groups = [(j, tree.children[j]) for j in range(len(tree.parents))]
    groups.append((-1, tuple(j for j, p in enumerate(tree.parents) if p < 0)))
    out = []
    for parent, joints in groups:
        for k, a in enumerate(joints):
            for b in joints[k + 1 :]:
                if min(tree.reach[a], tree.reach[b]) >= _SHORTEST * tree.size and _difference(tree, a, b) < _UNLIKE:
                    out.append(_pair(tree, parent, a, b))
    return out


def _pair(tree: Tree, parent: int, a: int, b: int) -> Pair:
    centre = tree.at[parent] if parent >= 0 else (tree.at[a] + tree.at[b]) / 2
    twins = _twins(tree, a, b, centre)
    first = [a]
    while options := [c for c in tree.children[first[-1]] if c in twins]:
        first.append(max(options, key=lambda c: float(tree.lengths[c] + tree.reach[c])))
    whole = max(_bones(tree, a), _bones(tree, b))
    matched = float(sum(tree.lengths[j] for j in twins if j != a)) / whole if whole > 0 else 0.0
    return Pair(parent, (tuple(first), tuple(twins[j] for j in first)), min(matched, 1.0))


def _bones(tree: Tree, j: int) -> float:
    return float(sum(tree.lengths[k] for k in tree.below(j)[1:]))


def _twins(tree: Tree, a: int, b: int, centre: FloatArray) -> dict[int, int]:
    """Joint of the first branch -> its counterpart in the second."""
    out = {a: b}
    mine, others = tree.children[a], tree.children[b]
    if not mine or not others:
        return out
    cost = np.array([[_difference(tree, x, y, centre) for y in others] for x in mine])
    for i, k in zip(*scipy.optimize.linear_sum_assignment(cost), strict=True):
        if cost[i, k] < _UNLIKE:
            out |= _twins(tree, mine[i], others[k], centre)
    return out


def _difference(tree: Tree, a: int, b: int, centre: FloatArray | None = None) -> float:
    """How unlike two branches are in what a reflection keeps: lengths, number of joints, distance to a centre."""
    little = 0.02 * tree.size
    out = 0.0
    for values in (tree.lengths, tree.reach):
        out += abs(float(values[a] - values[b])) / (max(float(values[a]), float(values[b])) + little)
    out += 0.15 * abs(float(np.log(tree.counts[a] / tree.counts[b])))
    if centre is not None:
        far = [float(np.linalg.norm(tree.at[j] - centre)) for j in (a, b)]
        out += abs(far[0] - far[1]) / (max(far) + little)
    return out
