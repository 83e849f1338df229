"""The compiled part of the whole-take solve: what pulls on one frame, and the banded normal equations.

Every frame has the unknowns of `_tree_kernel`: the root's position, a small turn of it about the world's axes, the free
joints. The band is stored as in `muybridge.geometry.fitting._banded_kernel`.
"""

from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.fitting._banded_kernel import log_between, resist_acceleration
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.robots._pair_kernel import nearest
from muybridge.motion.robots._tree_kernel import Tree, pose_tree, rotate


class Terms(NamedTuple):
    """What is the same in all frames: points and orientations of nodes, capsules, and weights (inverse variances)."""

    point_node: IndexArray
    point: FloatArray
    turn_node: IndexArray
    capsule_node: IndexArray
    start: FloatArray
    stop: FloatArray
    radius: FloatArray
    pairs: IndexArray
    low_node: IndexArray
    low: FloatArray
    low_radius: FloatArray
    rest: FloatArray
    prior: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    fastest: FloatArray  # of the free joints, a frame
    margin: float
    apart: float  # weight of capsules that are nearer than the margin
    floor: float  # weight of points under the floor
    fast: float  # weight of joints that are faster than they may be


class Work(NamedTuple):
    """Memory of one frame."""

    turns: FloatArray
    places: FloatArray
    axes: FloatArray
    anchors: FloatArray
    columns: IndexArray
    rows: FloatArray


@compiled
def make_work(tree: Tree) -> Work:
    m = len(tree.parent)
    return Work(
        np.empty((m, 3, 3)), np.empty((m, 3)), np.zeros((m, 3)), np.zeros((m, 3)), np.empty(2 * m + 12, np.int64),
        np.empty((3, 2 * m + 12)),
    )  # fmt: skip


@compiled
def _columns(tree: Tree, work: Work, node: int, point: FloatArray, root: FloatArray, angular: bool) -> int:
    """Unknowns that move a point of a node (or turn the node), and how: the number of columns that are filled."""
    columns, rows = work.columns, work.rows
    count = 0
    for k in range(3):
        if not angular:
            columns[count] = k
            for i in range(3):
                rows[i, count] = 1.0 if i == k else 0.0
            count += 1
    x, y, z = point[0] - root[0], point[1] - root[1], point[2] - root[2]
    for k in range(3):
        columns[count] = 3 + k
        for i in range(3):
            rows[i, count] = 1.0 if i == k and angular else 0.0
        if not angular:
            if k == 0:
                rows[1, count], rows[2, count] = -z, y
            elif k == 1:
                rows[0, count], rows[2, count] = z, -x
            else:
                rows[0, count], rows[1, count] = -y, x
        count += 1
    return _joint_columns(tree, work, node, point, angular, 1.0, count)


@compiled
def _joint_columns(tree: Tree, work: Work, node: int, point: FloatArray, angular: bool, sign: float, count: int) -> int:
    columns, rows = work.columns, work.rows
    n = node
    while n >= 0:
        if tree.kind[n] != 0 and tree.gain[n] != 0.0:
            columns[count] = 6 + tree.dof[n]
            gain = sign * tree.gain[n]
            ax, ay, az = work.axes[n, 0], work.axes[n, 1], work.axes[n, 2]
            if tree.kind[n] == 2:
                gain = 0.0 if angular else gain
                rows[0, count], rows[1, count], rows[2, count] = gain * ax, gain * ay, gain * az
            elif angular:
                rows[0, count], rows[1, count], rows[2, count] = gain * ax, gain * ay, gain * az
            else:
                x = point[0] - work.anchors[n, 0]
                y = point[1] - work.anchors[n, 1]
                z = point[2] - work.anchors[n, 2]
                rows[0, count] = gain * (ay * z - az * y)
                rows[1, count] = gain * (az * x - ax * z)
                rows[2, count] = gain * (ax * y - ay * x)
            count += 1
        n = tree.parent[n]
    return count


@compiled
def _add(work: Work, count: int, first: int, last: int, miss: FloatArray, weight: float, matrix: FloatArray,
         slope: FloatArray) -> None:  # fmt: skip
    """Rows `first` to before `last` into the normal equations of a frame."""
    columns, rows = work.columns, work.rows
    for a in range(count):
        ca = columns[a]
        total = 0.0
        for i in range(first, last):
            total += rows[i, a] * miss[i]
        slope[ca] += weight * total
        for b in range(count):
            cb = columns[b]
            if cb <= ca:
                total = 0.0
                for i in range(first, last):
                    total += rows[i, a] * rows[i, b]
                matrix[ca, cb] += weight * total


@compiled
def frame_terms(
    tree: Tree, terms: Terms, work: Work, root: FloatArray, turn: FloatArray, free: FloatArray, target: FloatArray,
    weight: FloatArray, facing: FloatArray, facing_weight: FloatArray, matrix: FloatArray, slope: FloatArray,
    want: bool,
) -> float:  # fmt: skip
    """Half the weighted squares of one frame; where wanted, its matrix (lower triangle) and gradient are added to."""
    pose_tree(tree, root, turn, free, work.turns, work.places, work.axes, work.anchors)
    cost = 0.0
    step, miss = np.empty(3), np.empty(3)
    for p in range(len(terms.point_node)):
        w = weight[p]
        if w > 0.0:
            n = terms.point_node[p]
            rotate(work.turns[n], terms.point[p], step)
            for i in range(3):
                step[i] += work.places[n, i]
                miss[i] = step[i] - target[p, i]
            cost += 0.5 * w * (miss[0] ** 2 + miss[1] ** 2 + miss[2] ** 2)
            if want:
                count = _columns(tree, work, n, step, root, False)
                _add(work, count, 0, 3, miss, w, matrix, slope)
    for p in range(len(terms.turn_node)):
        w = facing_weight[p]
        if w > 0.0:
            n = terms.turn_node[p]
            log_between(facing[p], work.turns[n], miss)
            cost += 0.5 * w * (miss[0] ** 2 + miss[1] ** 2 + miss[2] ** 2)
            if want:
                count = _columns(tree, work, n, root, root, True)
                _add(work, count, 0, 3, miss, w, matrix, slope)
    for p in range(len(terms.low_node)):
        n = terms.low_node[p]
        rotate(work.turns[n], terms.low[p], step)
        depth = step[2] + work.places[n, 2] - terms.low_radius[p]
        if depth < 0.0:
            cost += 0.5 * terms.floor * depth * depth
            if want:
                for i in range(3):
                    step[i] += work.places[n, i]
                miss[2] = depth
                count = _columns(tree, work, n, step, root, False)
                _add(work, count, 2, 3, miss, terms.floor, matrix, slope)
    for d in range(len(free)):
        gap = free[d] - terms.rest[d]
        cost += 0.5 * terms.prior[d] * gap * gap
        if want:
            matrix[6 + d, 6 + d] += terms.prior[d]
            slope[6 + d] += terms.prior[d] * gap
    return cost + _pair_terms(tree, terms, work, matrix, slope, want)


@compiled
def _pair_terms(tree: Tree, terms: Terms, work: Work, matrix: FloatArray, slope: FloatArray, want: bool) -> float:
    c = len(terms.capsule_node)
    ends = np.empty((2, c, 3))
    for k in range(c):
        n = terms.capsule_node[k]
        rotate(work.turns[n], terms.start[k], ends[0, k])
        rotate(work.turns[n], terms.stop[k], ends[1, k])
        for i in range(3):
            ends[0, k, i] += work.places[n, i]
            ends[1, k, i] += work.places[n, i]
    cost = 0.0
    one, other, miss = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(terms.pairs)):
        i, j = terms.pairs[k, 0], terms.pairs[k, 1]
        reach = terms.radius[i] + terms.radius[j] + terms.margin
        # Balls around both capsules first: most pairs are far apart.
        gap = size_i = size_j = 0.0
        for x in range(3):
            gap += (ends[0, i, x] + ends[1, i, x] - ends[0, j, x] - ends[1, j, x]) ** 2
            size_i += (ends[1, i, x] - ends[0, i, x]) ** 2
            size_j += (ends[1, j, x] - ends[0, j, x]) ** 2
        if np.sqrt(gap) - np.sqrt(size_i) - np.sqrt(size_j) > 2 * reach:
            continue
        s, t = nearest(ends[0, i], ends[1, i], ends[0, j], ends[1, j])
        total = 0.0
        for x in range(3):
            one[x] = ends[0, i, x] + s * (ends[1, i, x] - ends[0, i, x])
            other[x] = ends[0, j, x] + t * (ends[1, j, x] - ends[0, j, x])
            total += (one[x] - other[x]) ** 2
        distance = np.sqrt(total)
        short = distance - reach
        if short < 0.0 and distance > 1e-9:
            cost += 0.5 * terms.apart * short * short
            if want:
                count = _joint_columns(tree, work, terms.capsule_node[i], one, False, 1.0, 0)
                count = _joint_columns(tree, work, terms.capsule_node[j], other, False, -1.0, count)
                for a in range(count):
                    total = 0.0
                    for x in range(3):
                        total += (one[x] - other[x]) / distance * work.rows[x, a]
                    work.rows[0, a] = total
                miss[0] = short
                _add(work, count, 0, 1, miss, terms.apart, matrix, slope)
    return cost


@compiled
def steps_of(root: FloatArray, turn: FloatArray, free: FloatArray) -> FloatArray:
    """(T - 1, N) from each frame to the next."""
    n = 6 + free.shape[1]
    out = np.empty((max(len(root) - 1, 0), n))
    for t in range(len(out)):
        for i in range(3):
            out[t, i] = root[t + 1, i] - root[t, i]
        log_between(turn[t], turn[t + 1], out[t, 3:6])
        for k in range(n - 6):
            out[t, 6 + k] = free[t + 1, k] - free[t, k]
    return out


@compiled
def total_cost(
    tree: Tree, terms: Terms, root: FloatArray, turn: FloatArray, free: FloatArray, target: FloatArray,
    weight: FloatArray, facing: FloatArray, facing_weight: FloatArray,
) -> float:  # fmt: skip
    """Half the weighted sum of squares of all terms."""
    work, n = make_work(tree), 6 + free.shape[1]
    matrix, slope, total = np.empty((1, 1)), np.empty(1), 0.0
    for t in range(len(root)):
        total += frame_terms(tree, terms, work, root[t], turn[t], free[t], target[t], weight[t], facing[t],
                             facing_weight[t], matrix, slope, False)  # fmt: skip
    step = steps_of(root, turn, free)
    for t in range(len(step)):
        for i in range(n):
            total += 0.5 * terms.velocity[i] * step[t, i] ** 2
            if t:
                total += 0.5 * terms.acceleration[i] * (step[t, i] - step[t - 1, i]) ** 2
        for d in range(n - 6):
            over = abs(step[t, 6 + d]) - terms.fastest[d]
            if over > 0.0:
                total += 0.5 * terms.fast * over * over
    return total


@compiled
def assemble(
    tree: Tree, terms: Terms, root: FloatArray, turn: FloatArray, free: FloatArray, target: FloatArray,
    weight: FloatArray, facing: FloatArray, facing_weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Band (T N, 2 N + 1) and gradient (T, N) of all terms."""
    work, n, frames = make_work(tree), 6 + free.shape[1], len(root)
    band, slope, matrix = np.zeros((frames * n, 2 * n + 1)), np.zeros((frames, n)), np.empty((n, n))
    for t in range(frames):
        matrix[:] = 0.0
        frame_terms(tree, terms, work, root[t], turn[t], free[t], target[t], weight[t], facing[t], facing_weight[t],
                    matrix, slope[t], True)  # fmt: skip
        for b in range(n):
            for a in range(b, n):
                band[t * n + b, a - b] = matrix[a, b]
    step = steps_of(root, turn, free)
    for t in range(frames - 1):
        here = t * n
        for i in range(n):
            w, moved = terms.velocity[i], terms.velocity[i] * step[t, i]
            if i >= 6:
                over = abs(step[t, i]) - terms.fastest[i - 6]
                if over > 0.0:
                    w += terms.fast
                    moved += terms.fast * (over if step[t, i] > 0 else -over)
            slope[t, i] -= moved
            slope[t + 1, i] += moved
            band[here + i, 0] += w
            band[here + n + i, 0] += w
            band[here + i, n] -= w
            if t + 2 < frames:
                resist_acceleration(band, slope, step, t, i, terms.acceleration[i])
    return band, slope
