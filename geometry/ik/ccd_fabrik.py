"""Methods without a Jacobian: cyclic coordinate descent and FABRIK.

Both turn one hinge at a time by the angle that is best in closed form: of points and axes that a hinge carries and
should be elsewhere, the sum of squares is `c - a cos(angle) - b sin(angle)`.

Sources: L.-C. T. Wang, C. C. Chen, 1991 (CCD); A. Aristidou, J. Lasenby, "FABRIK: a fast, iterative solver for the
inverse kinematics problem", 2011 (several end effectors, sub-bases as centroids, targets out of reach) and
"Extending FABRIK with model constraints", 2016 (the bone pointed as far as the joint's limits let it).
"""

import math
from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.ik.jacobian import good_enough, perturb, uniform
from muybridge.geometry.ik.tree import GoalArrays, KinematicTree, Links, errors, forward, forward_from, rotate
from muybridge.geometry.numerics._numba import compiled

_LATER = 0.1  # weight of what comes one link later


class Nodes(NamedTuple):
    """A tree for FABRIK: nodes, which are hinges at one place, and the links between them."""

    of_joint: IntArray  # (N,) node of each joint
    first: IntArray  # (G,) first joint of each node
    last: IntArray  # (G,) last joint of each node
    parent: IntArray  # (G,) -1 on the base
    length: FloatArray  # (G,) metres from the parent's place


def make_nodes(tree: KinematicTree) -> Nodes:
    """Hinges at one place, each the only one on the one before it, are one node."""
    children = np.bincount([p for p in tree.parents if p >= 0], minlength=len(tree))
    of_joint, length = np.zeros(len(tree), dtype=np.int64), []
    first: list[int] = []
    last: list[int] = []
    parent: list[int] = []
    for j, up in enumerate(tree.parents):
        shift = float(np.linalg.norm(tree.offsets[j]))
        if up >= 0 and shift < 1e-9 and children[up] == 1:
            of_joint[j] = of_joint[up]
            last[of_joint[j]] = j
            continue
        of_joint[j] = len(first)
        first.append(j)
        last.append(j)
        parent.append(int(of_joint[up]) if up >= 0 else -1)
        length.append(shift)
    a, b, c = (np.array(v, dtype=np.int64) for v in (first, last, parent))
    return Nodes(of_joint, a, b, c, np.array(length, dtype=np.float64))


@compiled
def add_pair(axis: FloatArray, now: FloatArray, target: FloatArray, weight: float, sums: FloatArray) -> None:
    """Add to (2,) `a` and `b` the terms of one vector that the hinge carries."""
    along = (now[0] * axis[0] + now[1] * axis[1] + now[2] * axis[2]) * (
        target[0] * axis[0] + target[1] * axis[1] + target[2] * axis[2]
    )
    sums[0] += weight * (now[0] * target[0] + now[1] * target[1] + now[2] * target[2] - along)
    sums[1] += weight * (
        axis[0] * (now[1] * target[2] - now[2] * target[1])
        + axis[1] * (now[2] * target[0] - now[0] * target[2])
        + axis[2] * (now[0] * target[1] - now[1] * target[0])
    )


@compiled
def best_angle(sums: FloatArray, theta: float, lower: float, upper: float) -> float:
    """The angle within the limits at which `a cos + b sin` of the turn from `theta` is largest."""
    if sums[0] * sums[0] + sums[1] * sums[1] < 1e-24:
        return theta
    turn = math.atan2(sums[1], sums[0])
    best, value = theta, sums[0]  # staying
    for k in range(-1, 2):
        angle = theta + turn + 2 * math.pi * k
        if lower <= angle <= upper:
            return angle
    for angle in (lower, upper):
        if abs(angle) < 1e6:
            here = sums[0] * math.cos(angle - theta) + sums[1] * math.sin(angle - theta)
            if here > value:
                best, value = angle, here
    return best


@compiled
def turn_joint(
    links: Links,
    targets: GoalArrays,
    theta: FloatArray,
    j: int,
    turns: FloatArray,
    places: FloatArray,
    axes: FloatArray,
    sums: FloatArray,
) -> None:
    """Add to `sums` the terms of the goals below hinge `j`."""
    now, target, point = np.empty(3), np.empty(3), np.empty(3)
    for e in range(len(targets.joint)):
        carrier = targets.joint[e]
        up = carrier
        while up > j:
            up = links.parents[up]
        if up != j:
            continue
        if targets.place_weight[e] > 0:
            rotate(turns[carrier], targets.offset[e], point)
            for i in range(3):
                now[i] = point[i] + places[carrier, i] - places[j, i]
                target[i] = targets.place[e, i] - places[j, i]
            add_pair(axes[j], now, target, targets.place_weight[e] ** 2, sums)
        for k in range(targets.pairs[e]):
            rotate(turns[carrier], targets.local[e, k], now)
            share = 0.5 if targets.pairs[e] == 3 else 1.0  # two axes determine the third
            add_pair(axes[j], now, targets.world[e, k], share * targets.turn_weight[e] ** 2, sums)


@compiled
def cyclic_descent(
    links: Links, targets: GoalArrays, theta: FloatArray, iterations: int, near: float, straight: float, patience: int,
    seed: int,
) -> tuple[FloatArray, int]:  # fmt: skip
    """Cyclic coordinate descent from the tips to the base; best angles and sweeps.

    A straight chain whose target is on its line gives no hinge anything to do: without progress the angles are
    shaken a little, more each time.
    """
    n, e_count = len(theta), len(targets.joint)
    state = np.array([seed], dtype=np.uint64)
    uniform(state)
    turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    place, turn, sums = np.zeros(e_count), np.zeros(e_count), np.empty(2)
    best, value = theta.copy(), errors(links, targets, theta, place, turn)
    since, tried, local = 0, 0, value
    for k in range(iterations):
        if good_enough(place, turn, near, straight):
            return theta, k
        forward(links, theta, turns, places, axes)
        for j in range(n - 1, -1, -1):
            sums[:] = 0.0
            turn_joint(links, targets, theta, j, turns, places, axes, sums)
            angle = best_angle(sums, theta[j], links.lower[j], links.upper[j])
            if angle != theta[j]:
                theta[j] = angle
                forward_from(links, theta, j, turns, places, axes)
        now = errors(links, targets, theta, place, turn)
        if now < value:
            best, value = theta.copy(), now
        since = 0 if now < 0.999 * local else since + 1
        local = min(local, now)
        if since > patience:
            tried += 1
            theta = perturb(links, best, min(0.05 * 2.0**tried, 1.0), state)
            local, since = errors(links, targets, theta, place, turn), 0
    return best, iterations


@compiled
def reach_back(
    nodes: Nodes, targets: GoalArrays, places: FloatArray, points: FloatArray, wanted: FloatArray, counts: FloatArray
) -> None:
    """FABRIK from the tips: (G, 3) where each node should be; where links meet, the mean of their targets."""
    wanted[:], counts[:] = 0.0, 0.0
    for e in range(len(targets.joint)):
        if targets.place_weight[e] == 0:
            continue
        g = nodes.of_joint[targets.joint[e]]
        # The effector's own link: from its target back towards its node, or as its orientation has it.
        length = math.sqrt(targets.offset[e, 0] ** 2 + targets.offset[e, 1] ** 2 + targets.offset[e, 2] ** 2)
        way = np.empty(3)
        if targets.pairs[e] == 3:
            for i in range(3):
                way[i] = -(
                    targets.world[e, 0, i] * targets.offset[e, 0] + targets.world[e, 1, i] * targets.offset[e, 1]
                    + targets.world[e, 2, i] * targets.offset[e, 2]
                )  # fmt: skip
        else:
            norm = 0.0
            for i in range(3):
                way[i] = places[g, i] - targets.place[e, i]
                norm += way[i] ** 2
            way *= length / max(math.sqrt(norm), 1e-12)
        for i in range(3):
            wanted[g, i] += targets.place_weight[e] * (targets.place[e, i] + way[i])
        counts[g] += targets.place_weight[e]
    for g in range(len(nodes.parent) - 1, -1, -1):
        if counts[g] == 0:
            continue
        for i in range(3):
            wanted[g, i] /= counts[g]
        up = nodes.parent[g]
        if up < 0:
            continue
        norm = 0.0
        for i in range(3):
            norm += (places[up, i] - wanted[g, i]) ** 2
        scale = nodes.length[g] / max(math.sqrt(norm), 1e-12)
        for i in range(3):
            wanted[up, i] += wanted[g, i] + scale * (places[up, i] - wanted[g, i])
        counts[up] += 1.0


@compiled
def targets_of_node(
    links: Links, nodes: Nodes, targets: GoalArrays, g: int, j: int, wanted: FloatArray, counts: FloatArray,
    turns: FloatArray, places: FloatArray, axes: FloatArray, later: float, sums: FloatArray,
) -> None:  # fmt: skip
    """Add to `sums` what hangs on hinge `j` of node `g` says about its angle.

    That is the nodes after it and the effectors on it, as in FABRIK; and with a small weight what comes one link
    later, or a hinge along a link (a roll) would have nothing to go by and an elbow would stay in its plane.
    """
    now, target = np.empty(3), np.empty(3)
    for other in range(g + 1, len(nodes.first)):
        up = nodes.parent[other]
        if counts[other] == 0 or up < 0 or (up != g and nodes.parent[up] != g):
            continue
        for i in range(3):
            now[i] = places[nodes.first[other], i] - places[j, i]
            target[i] = wanted[other, i] - places[j, i]
        add_pair(axes[j], now, target, 1.0 if up == g else later, sums)
    for e in range(len(targets.joint)):
        carrier = targets.joint[e]
        here = nodes.of_joint[carrier]
        if here == g and carrier < j or here != g and nodes.parent[here] != g:
            continue
        weight = 1.0 if here == g else later
        rotate(turns[carrier], targets.offset[e], now)
        if targets.place_weight[e] > 0:
            for i in range(3):
                now[i] += places[carrier, i] - places[j, i]
                target[i] = targets.place[e, i] - places[j, i]
            add_pair(axes[j], now, target, weight * targets.place_weight[e] ** 2, sums)
        share = 0.5 if targets.pairs[e] == 3 else 1.0
        for p in range(targets.pairs[e]):
            rotate(turns[carrier], targets.local[e, p], now)
            add_pair(axes[j], now, targets.world[e, p], share * weight * targets.turn_weight[e] ** 2, sums)


@compiled
def reach_forward(
    links: Links, nodes: Nodes, targets: GoalArrays, theta: FloatArray, wanted: FloatArray, counts: FloatArray,
    turns: FloatArray, places: FloatArray, axes: FloatArray, later: float,
) -> None:  # fmt: skip
    """FABRIK from the base: each node's hinges point its links at where the nodes after it should be, limits kept."""
    sums = np.empty(2)
    forward(links, theta, turns, places, axes)
    for g in range(len(nodes.first)):
        if counts[g] == 0:
            continue
        for _ in range(3 if nodes.last[g] > nodes.first[g] else 1):
            for j in range(nodes.last[g], nodes.first[g] - 1, -1):
                if nodes.of_joint[j] != g:
                    continue
                sums[:] = 0.0
                targets_of_node(links, nodes, targets, g, j, wanted, counts, turns, places, axes, later, sums)
                angle = best_angle(sums, theta[j], links.lower[j], links.upper[j])
                if angle != theta[j]:
                    theta[j] = angle
                    forward_from(links, theta, j, turns, places, axes)


@compiled
def fabrik(
    links: Links, nodes: Nodes, targets: GoalArrays, theta: FloatArray, iterations: int, near: float, straight: float,
    patience: int, seed: int,
) -> tuple[FloatArray, int]:  # fmt: skip
    """Forward and backward reaching; best angles and iterations.

    Points on a line stay on it, so without progress the angles are perturbed, more each time.
    """
    n, e_count, g_count = len(theta), len(targets.joint), len(nodes.first)
    state = np.array([seed], dtype=np.uint64)
    uniform(state)
    turns, places, axes = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    at, wanted, counts = np.empty((g_count, 3)), np.empty((g_count, 3)), np.empty(g_count)
    place, turn = np.zeros(e_count), np.zeros(e_count)
    best, value = theta.copy(), errors(links, targets, theta, place, turn)
    since, tried, local = 0, 0, value
    forward(links, theta, turns, places, axes)
    for k in range(iterations):
        if good_enough(place, turn, near, straight):
            return theta, k
        for g in range(g_count):
            at[g] = places[nodes.first[g]]
        reach_back(nodes, targets, at, places, wanted, counts)
        # A node on a way to an effector without a target for its place still has to turn for its orientation.
        for e in range(e_count):
            g = nodes.of_joint[targets.joint[e]]
            if counts[g] == 0:
                counts[g] = 1.0
                wanted[g] = at[g]
        later = _LATER * 0.9 ** (k % 60)
        reach_forward(links, nodes, targets, theta, wanted, counts, turns, places, axes, later)
        now = errors(links, targets, theta, place, turn)
        if now < value:
            best, value = theta.copy(), now
        since = 0 if now < 0.98 * local else since + 1
        local = min(local, now)
        if since > patience:
            tried += 1
            theta = perturb(links, best, min(0.05 * 2.0**tried, 1.0), state)
            forward(links, theta, turns, places, axes)
            local, since = errors(links, targets, theta, place, turn), 0
    return best, iterations
