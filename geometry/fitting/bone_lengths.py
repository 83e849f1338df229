"""Lengths by linear least squares: given the joints' orientations, every landmark is linear in them."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.fitting._chain_kernel import forward_one
from muybridge.geometry.fitting.chain import Chain
from muybridge.geometry.fitting.gauss_newton import Pose, Problem
from muybridge.geometry.numerics._numba import compiled, leaf, sums
from muybridge.geometry.numerics.covariances import inverse_one


def length_equations(
    problem: Problem, pose: Pose, joint_basis: FloatArray, landmark_basis: FloatArray, most: int = 1000
) -> tuple[FloatArray, FloatArray]:
    """Normal equations of the lengths, given the pose; the root's place is left free in every frame.

    Args:
        problem: targets and information; its skeleton's orientations.
        pose: of every frame.
        joint_basis: (J, 3, S) metres of a joint's offset per unit of each parameter.
        landmark_basis: (L, 3, S) the same for a landmark on its joint.
        most: no more frames than about this are looked at.

    Returns:
        (S, S) matrix and (S,) vector.
    """
    every = max(len(pose) // most, 1)
    target = problem.targets - pose.root[:, None]
    turn, angles, target, information, joint_basis, landmark_basis = (
        np.ascontiguousarray(a)
        for a in (
            *(array[::every] for array in (pose.turn, pose.angles, target, problem.information)),
            joint_basis,
            landmark_basis,
        )
    )
    matrix, vector = fill_equations(problem.chain, turn, angles, target, information, joint_basis, landmark_basis)
    return np.tril(matrix) + np.tril(matrix, -1).T, vector


@compiled
def fill_equations(
    chain: Chain, turn: FloatArray, angles: FloatArray, target: FloatArray, information: FloatArray,
    joint_basis: FloatArray, landmark_basis: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Lower triangle and vector of `length_equations`; `target` is relative to the root."""
    j_count, size = len(chain.parents), joint_basis.shape[2]
    turns, places, axes = np.empty((j_count, 3, 3)), np.empty((j_count, 3)), np.empty((0, 3))
    of_joint, design, pulled, by_root = (np.zeros((j_count, 3, size)), np.empty((3, size)), np.empty((3, size)),
                                         np.empty((3, size)))  # fmt: skip
    root, free, residual, back = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty((3, size))
    matrix, vector, little = np.zeros((size, size)), np.zeros(size), 1e-6 * np.eye(3)
    for t in range(len(turn)):
        forward_one(chain, turn[t], angles[t], turns, places, axes, False)
        for j in range(1, j_count):
            _copy(of_joint[chain.parents[j]], of_joint[j])
            _add_product(turns[chain.parents[j]], joint_basis[j], of_joint[j])
        by_root[:], residual[:] = 0.0, 0.0
        _copy(little, root)
        for k in range(len(chain.carrier)):
            w = information[t, k]
            if w[0, 0] == 0 and w[1, 1] == 0 and w[2, 2] == 0:
                continue
            _copy(of_joint[chain.carrier[k]], design)
            pulled[:] = 0.0
            _add_product(turns[chain.carrier[k]], landmark_basis[k], design)
            _add_product(w, design, pulled)
            by_root += pulled
            root += w
            for i in range(3):
                _add_outer(design[i], pulled[i], matrix)
                _add_scaled(pulled[i], target[t, k, i], vector)
                residual[i] += w[i, 0] * target[t, k, 0] + w[i, 1] * target[t, k, 1] + w[i, 2] * target[t, k, 2]
        inverse_one(root, free)
        back[:] = 0.0
        _add_product(free, by_root, back)
        for i in range(3):
            _add_outer(-by_root[i], back[i], matrix)
            _add_scaled(back[i], -residual[i], vector)
    return matrix, vector


@leaf
def _copy(a: FloatArray, out: FloatArray) -> None:
    # Copying by slices compiles the text of an error message too, which takes long.
    for i in range(len(a)):
        for s in range(a.shape[1]):
            out[i, s] = a[i, s]


@sums
def _add_product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Add the product of (3, 3) and (3, S)."""
    for i in range(3):
        for s in range(b.shape[1]):
            out[i, s] += a[i, 0] * b[0, s] + a[i, 1] * b[1, s] + a[i, 2] * b[2, s]


@sums
def _add_outer(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Add the lower triangle of the outer product."""
    for r in range(len(a)):
        for s in range(r + 1):
            out[r, s] += a[r] * b[s]


@sums
def _add_scaled(values: FloatArray, share: float, out: FloatArray) -> None:
    for s in range(len(values)):
        out[s] += share * values[s]
