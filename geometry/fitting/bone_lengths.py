"""Lengths by linear least squares: given the joints' orientations, every landmark is linear in them."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.fitting.gauss_newton import Pose, Problem


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
    skeleton = problem.skeleton
    rotations = skeleton.rotations_from_angles(pose.angles[::every])
    rotations[:, 0] = pose.turn[::every]
    turns, _ = skeleton.forward(pose.root[::every], rotations)
    of_joint = np.zeros((len(turns), len(skeleton), 3, joint_basis.shape[-1]))
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            of_joint[:, j] = of_joint[:, parent] + turns[:, parent] @ joint_basis[j]
    carrier = problem.landmark_joints
    design = of_joint[:, carrier] + turns[:, carrier] @ landmark_basis
    information = problem.information[::every]
    target = problem.targets[::every] - pose.root[::every, None]
    pulled = information @ design
    by_root = pulled.sum(axis=1)  # (T, 3, S)
    root = information.sum(axis=1) + np.eye(3) * 1e-6
    back = np.linalg.solve(root, by_root)
    residual = np.einsum("tlij,tlj->ti", information, target)
    matrix = np.einsum("tlis,tlir->sr", design, pulled, optimize=True) - np.einsum("tis,tir->sr", by_root, back)
    vector = np.einsum("tlis,tli->s", pulled, target) - np.einsum("tis,ti->s", back, residual)
    return matrix, vector
