"""The compiled core of the body fit: one frame's landmarks, their cost and their normal equations.

The Gauss-Newton matrix is built without the Jacobian, as the composite-rigid-body algorithm builds a mass matrix:
every landmark is a 6 x 6 block of information about a turn and a shift, the blocks of everything below a joint
are summed, and an entry of the matrix is the product of two screws with such a sum. The matrix has the sparsity
of the tree (a hand does not depend on the other hand), and its factor L of `H = L^T L` has the same: factor,
solution and inverse walk from each angle to the root only.

Source: R. Featherstone, Rigid Body Dynamics Algorithms, 2008, sections 6.2 (composite rigid bodies) and 6.5
(factors of tree-sparse matrices).
"""

from __future__ import annotations

import math

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.fitting.chain import Chain
from muybridge.geometry.numerics._numba import compiled, leaf, subroutine


@leaf
def exp_one(x: float, y: float, z: float, out: FloatArray) -> None:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    square = x * x + y * y + z * z
    if square < 1e-12:
        a, b = 1.0 - square / 6, 0.5 - square / 24
    else:
        angle = math.sqrt(square)
        a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / square
    c = 1.0 - b * square
    out[0, 0], out[1, 1], out[2, 2] = c + b * x * x, c + b * y * y, c + b * z * z
    out[0, 1], out[1, 0] = b * x * y - a * z, b * x * y + a * z
    out[0, 2], out[2, 0] = b * x * z + a * y, b * x * z - a * y
    out[1, 2], out[2, 1] = b * y * z - a * x, b * y * z + a * x


@leaf
def left_jacobian_one(x: float, y: float, z: float, out: FloatArray) -> None:
    """`exp(v + dv) = exp(J dv) exp(v)` to first order."""
    square = x * x + y * y + z * z
    if square < 1e-8:
        a, b, c = 1 - square / 6, 0.5 - square / 24, 1 / 6 - square / 120
    else:
        angle = math.sqrt(square)
        a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / square
        c = (1 - a) / square
    out[0, 0], out[1, 1], out[2, 2] = a + c * x * x, a + c * y * y, a + c * z * z
    out[0, 1], out[1, 0] = c * x * y - b * z, c * x * y + b * z
    out[0, 2], out[2, 0] = c * x * z + b * y, c * x * z - b * y
    out[1, 2], out[2, 1] = c * y * z - b * x, c * y * z + b * x


@leaf
def multiply(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """3 x 3 product."""
    for i in range(3):
        for k in range(3):
            out[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@subroutine
def forward_one(
    chain: Chain,
    turn: FloatArray,
    angles: FloatArray,
    turns: FloatArray,
    places: FloatArray,
    axes: FloatArray,
    with_axes: bool,
) -> None:
    """Joint orientations (J, 3, 3) and places (J, 3) about the root, and the world axis (K, 3) of each open angle."""
    swing, roll, local = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        places[0, i] = 0.0
        for k in range(3):
            turns[0, i, k] = turn[i, k]
    for j in range(1, len(chain.parents)):
        up = chain.parents[j]
        place_child(turns[up], places[up], chain.offsets[j], places[j])
        first, last = chain.first[j], chain.first[j + 1]
        twist = chain.twist[j]
        x, y, z = angles[j, 0], angles[j, 1], angles[j, 2]
        rolled = angles[j, twist]
        if twist == 0:
            x = 0.0
        elif twist == 1:
            y = 0.0
        else:
            z = 0.0
        if first == last and rolled == 0 and x == 0 and y == 0 and z == 0:
            for i in range(3):
                for k in range(3):
                    turns[j, i, k] = turns[up, i, k]
            continue
        exp_one(x, y, z, swing)
        multiply(turns[up], swing, local)
        exp_one(rolled if twist == 0 else 0.0, rolled if twist == 1 else 0.0, rolled if twist == 2 else 0.0, roll)
        multiply(local, roll, turns[j])
        if with_axes and first < last:
            left_jacobian_one(x, y, z, roll)
            for k in range(first - 6, last - 6):
                i = chain.open_axis[k]
                for row in range(3):
                    if i == twist:
                        axes[k, row] = local[row, i]
                    else:
                        axes[k, row] = (
                            turns[up, row, 0] * roll[0, i] + turns[up, row, 1] * roll[1, i]
                            + turns[up, row, 2] * roll[2, i]
                        )  # fmt: skip


@compiled
def rotations_of(chain: Chain, turn: FloatArray, angles: FloatArray) -> FloatArray:
    """(T, J, 3, 3) parent from joint; the root's is `turn` (T, 3, 3)."""
    out = np.empty((*angles.shape, 3))
    swing, roll, bent = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for t in range(len(angles)):
        for i in range(3):
            for k in range(3):
                out[t, 0, i, k] = turn[t, i, k]
        for j in range(1, len(chain.parents)):
            twist = chain.twist[j]
            for i in range(3):
                bent[i] = angles[t, j, i]
            rolled, bent[twist] = bent[twist], 0.0
            exp_one(bent[0], bent[1], bent[2], swing)
            bent[:] = 0.0
            bent[twist] = rolled
            exp_one(bent[0], bent[1], bent[2], roll)
            multiply(swing, roll, out[t, j])
    return out


@leaf
def place_child(turn: FloatArray, place: FloatArray, offset: FloatArray, out: FloatArray) -> None:
    """`place + turn offset`."""
    for i in range(3):
        out[i] = place[i] + turn[i, 0] * offset[0] + turn[i, 1] * offset[1] + turn[i, 2] * offset[2]


@compiled
def landmarks_of(chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray) -> FloatArray:
    """(T, L, 3) landmarks of a pose: root (T, 3), turn (T, 3, 3), angles (T, J, 3)."""
    j_count = len(chain.parents)
    turns, places, axes = np.empty((j_count, 3, 3)), np.empty((j_count, 3)), np.empty((0, 3))
    out = np.empty((len(root), len(chain.carrier), 3))
    for t in range(len(root)):
        forward_one(chain, turn[t], angles[t], turns, places, axes, False)
        for landmark in range(len(chain.carrier)):
            j = chain.carrier[landmark]
            place_child(turns[j], places[j], chain.places[landmark], out[t, landmark])
            for i in range(3):
                out[t, landmark, i] += root[t, i]
    return out


@leaf
def add_landmark(r: FloatArray, w: FloatArray, e: FloatArray, block: FloatArray, force: FloatArray) -> None:
    """A landmark at `r` with information `w` and error `e`: adds its 6 x 6 block and its wrench."""
    wx, wy, wz = (w[0, 0] * e[0] + w[0, 1] * e[1] + w[0, 2] * e[2], w[1, 0] * e[0] + w[1, 1] * e[1] + w[1, 2] * e[2],
                  w[2, 0] * e[0] + w[2, 1] * e[1] + w[2, 2] * e[2])  # fmt: skip
    force[0] += r[1] * wz - r[2] * wy
    force[1] += r[2] * wx - r[0] * wz
    force[2] += r[0] * wy - r[1] * wx
    force[3] += wx
    force[4] += wy
    force[5] += wz
    for k in range(3):
        # Column k of [r]x w, and of [r]x w [r]x^T by the same product on its rows.
        x = r[1] * w[2, k] - r[2] * w[1, k]
        y = r[2] * w[0, k] - r[0] * w[2, k]
        z = r[0] * w[1, k] - r[1] * w[0, k]
        block[0, 3 + k] += x
        block[1, 3 + k] += y
        block[2, 3 + k] += z
        for i in range(k + 1):
            block[3 + i, 3 + k] += w[i, k]
    for i in range(3):
        # Row i of [r]x w, again, turned into row i of the upper left block.
        if i == 0:
            x, y, z = r[1] * w[2, 0] - r[2] * w[1, 0], r[1] * w[2, 1] - r[2] * w[1, 1], r[1] * w[2, 2] - r[2] * w[1, 2]
        elif i == 1:
            x, y, z = r[2] * w[0, 0] - r[0] * w[2, 0], r[2] * w[0, 1] - r[0] * w[2, 1], r[2] * w[0, 2] - r[0] * w[2, 2]
        else:
            x, y, z = r[0] * w[1, 0] - r[1] * w[0, 0], r[0] * w[1, 1] - r[1] * w[0, 1], r[0] * w[1, 2] - r[1] * w[0, 2]
        row = (r[1] * z - r[2] * y, r[2] * x - r[0] * z, r[0] * y - r[1] * x)
        for k in range(i, 3):
            block[i, k] += row[k]


@subroutine
def gather(
    chain: Chain,
    places: FloatArray,
    axes: FloatArray,
    blocks: FloatArray,
    forces: FloatArray,
    matrix: FloatArray,
    slope: FloatArray,
) -> None:
    """From blocks (J, 6, 6; upper triangles) and wrenches (J, 6) of the joints' own landmarks: matrix and gradient.

    Only `matrix[k, m]` with `m` on the way from `k` to the root, and `k` itself, is written.
    """
    j_count, n = len(chain.parents), len(chain.above)
    screws, product = np.zeros((n, 6)), np.empty(6)
    for i in range(3):
        screws[i, 3 + i] = 1.0
        screws[3 + i, i] = 1.0
    for k in range(n - 6):
        c, a = places[chain.open_joint[k]], axes[k]
        s = screws[6 + k]
        s[0], s[1], s[2] = a[0], a[1], a[2]
        s[3], s[4], s[5] = c[1] * a[2] - c[2] * a[1], c[2] * a[0] - c[0] * a[2], c[0] * a[1] - c[1] * a[0]
    for j in range(j_count - 1, -1, -1):
        block, force = blocks[j], forces[j]
        low = chain.first[j] if j else 0
        high = chain.first[j + 1] if j else 6
        for k in range(high - 1, low - 1, -1):
            s = screws[k]
            total = 0.0
            for a in range(6):
                value = 0.0
                for b in range(6):
                    value += (block[a, b] if a <= b else block[b, a]) * s[b]
                product[a] = value
                total += s[a] * force[a]
            slope[k] = total
            m = k
            while m >= 0:
                other = screws[m]
                matrix[k, m] = (
                    other[0] * product[0] + other[1] * product[1] + other[2] * product[2]
                    + other[3] * product[3] + other[4] * product[4] + other[5] * product[5]
                )  # fmt: skip
                m = chain.above[m]
        if j:
            up = chain.parents[j]
            for a in range(6):
                forces[up, a] += force[a]
                for b in range(a, 6):
                    blocks[up, a, b] += block[a, b]


@leaf
def factor(above: IntArray, matrix: FloatArray) -> bool:
    """`matrix = L^T L` in place, tree-sparse; whether it was positive definite."""
    for k in range(len(above) - 1, -1, -1):
        if not matrix[k, k] > 0:
            return False
        pivot = math.sqrt(matrix[k, k])
        matrix[k, k] = pivot
        i = above[k]
        while i >= 0:
            matrix[k, i] /= pivot
            i = above[i]
        i = above[k]
        while i >= 0:
            share = matrix[k, i]
            j = i
            while j >= 0:
                matrix[i, j] -= share * matrix[k, j]
                j = above[j]
            i = above[i]
    return True


@leaf
def substitute(above: IntArray, matrix: FloatArray, vector: FloatArray) -> None:
    """Solve with the factor, in place."""
    n = len(above)
    for k in range(n - 1, -1, -1):
        vector[k] /= matrix[k, k]
        i = above[k]
        while i >= 0:
            vector[i] -= matrix[k, i] * vector[k]
            i = above[i]
    for k in range(n):
        value = vector[k]
        i = above[k]
        while i >= 0:
            value -= matrix[k, i] * vector[i]
            i = above[i]
        vector[k] = value / matrix[k, k]


@leaf
def inverse_diagonal(above: IntArray, matrix: FloatArray, rows: FloatArray, out: FloatArray) -> None:
    """Diagonal of the inverse from the factor; `rows` (N, N) is scratch, and becomes the inverse factor."""
    for k in range(len(above)):
        pivot = 1.0 / matrix[k, k]
        i = above[k]
        while i >= 0:
            rows[k, i] = 0.0
            i = above[i]
        i = above[k]
        while i >= 0:
            share, j = matrix[k, i] * pivot, i
            while j >= 0:
                rows[k, j] -= share * rows[i, j]
                j = above[j]
            i = above[i]
        rows[k, k] = pivot
        total, i = pivot * pivot, above[k]
        while i >= 0:
            total += rows[k, i] ** 2
            i = above[i]
        out[k] = total


@compiled
def normal_equations(
    chain: Chain, root: FloatArray, turn: FloatArray, angles: FloatArray, targets: FloatArray, information: FloatArray,
    begin: int, end: int,
) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
    """Of the frames from `begin` to before `end`: (T, N, N) tree-sparse lower parts of `J^T W J`, (T, N) gradients and
    half the sum of squares."""
    t_count, j_count, n = end - begin, len(chain.parents), len(chain.above)
    turns, places, axes = np.empty((j_count, 3, 3)), np.empty((j_count, 3)), np.empty((n - 6, 3))
    blocks, forces = np.empty((j_count, 6, 6)), np.empty((j_count, 6))
    matrices, slopes = np.zeros((t_count, n, n)), np.empty((t_count, n))
    r, e = np.empty(3), np.empty(3)
    total = 0.0
    for t in range(begin, end):
        forward_one(chain, turn[t], angles[t], turns, places, axes, True)
        blocks[:], forces[:] = 0.0, 0.0
        for landmark in range(len(chain.carrier)):
            w = information[t, landmark]
            if w[0, 0] == 0 and w[1, 1] == 0 and w[2, 2] == 0:
                continue
            j = chain.carrier[landmark]
            place_child(turns[j], places[j], chain.places[landmark], r)
            for i in range(3):
                e[i] = r[i] + root[t, i] - targets[t, landmark, i]
            add_landmark(r, w, e, blocks[j], forces[j])
            for i in range(3):
                total += 0.5 * e[i] * (w[i, 0] * e[0] + w[i, 1] * e[1] + w[i, 2] * e[2])
        gather(chain, places, axes, blocks, forces, matrices[t - begin], slopes[t - begin])
    return matrices, slopes, total
