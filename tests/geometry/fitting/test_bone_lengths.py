"""Lengths that are linear in the landmarks, against the equations written out."""

from dataclasses import replace

import numpy as np

from muybridge.geometry.fitting.bone_lengths import length_equations
from muybridge.geometry.fitting.gauss_newton import Pose, Problem
from muybridge.geometry.skeleton.body import BODY, prior_shape

FRAMES = 12


def problem_and_pose() -> tuple[Problem, Pose]:
    """BODY in random poses within its limits, its own landmarks as targets."""
    rng, shape = np.random.default_rng(0), prior_shape(1.75)
    skeleton = BODY.skeleton(shape)
    low, high = np.clip(skeleton.lower, -1, 1), np.clip(skeleton.upper, -1, 1)
    angles = rng.uniform(low, high, (FRAMES, len(skeleton), 3))
    pose = Pose(rng.normal(size=(FRAMES, 3)), np.tile(np.eye(3), (FRAMES, 1, 1)), angles)
    rotations = skeleton.rotations_from_angles(angles)
    rotations[:, 0] = pose.turn
    turns, places = skeleton.forward(pose.root, rotations)
    j = BODY.landmark_joints
    targets = places[:, j] + (turns[:, j] @ BODY.landmark_offsets(shape)[..., None])[..., 0]
    root = rng.normal(size=(FRAMES, len(j), 3, 3))
    information = root @ np.swapaxes(root, -1, -2) + np.eye(3)
    information[rng.random((FRAMES, len(j))) < 0.2] = 0.0
    free = np.zeros(6 + 3 * len(skeleton))
    problem = Problem(skeleton, j, BODY.landmark_offsets(shape), targets, information, BODY.rest,
                      np.ones((len(skeleton), 3)), free, free)  # fmt: skip
    return problem, pose


def test_the_equations_are_those_of_the_design_written_out() -> None:
    problem, pose = problem_and_pose()
    matrix, vector = length_equations(problem, pose, BODY.joint_basis, BODY.landmark_basis)
    size = len(vector)
    expected, right = np.zeros((size, size)), np.zeros(size)
    rotations = problem.skeleton.rotations_from_angles(pose.angles)
    rotations[:, 0] = pose.turn
    turns, _ = problem.skeleton.forward(pose.root, rotations)
    for t in range(FRAMES):
        of_joint = np.zeros((len(problem.skeleton), 3, size))
        for joint, parent in enumerate(problem.skeleton.parents):
            if parent >= 0:
                of_joint[joint] = of_joint[parent] + turns[t, parent] @ BODY.joint_basis[joint]
        # The root's place is three more unknowns of the frame, eliminated by Schur's complement.
        full, of_full = np.zeros((size + 3, size + 3)), np.zeros(size + 3)
        full[size:, size:] = 1e-6 * np.eye(3)
        for k, joint in enumerate(problem.landmark_joints):
            design = np.hstack([of_joint[joint] + turns[t, joint] @ BODY.landmark_basis[k], np.eye(3)])
            full += design.T @ problem.information[t, k] @ design
            of_full += design.T @ problem.information[t, k] @ (problem.targets[t, k] - pose.root[t])
        free = np.linalg.solve(full[size:, size:], np.c_[full[size:, :size], of_full[size:]])
        expected += full[:size, :size] - full[:size, size:] @ free[:, :size]
        right += of_full[:size] - full[:size, size:] @ free[:, size]
    np.testing.assert_allclose(matrix, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(vector, right, rtol=1e-9, atol=1e-9 * np.abs(right).max())


def test_true_points_give_the_true_lengths_wherever_the_root_is() -> None:
    problem, pose = problem_and_pose()
    moved = replace(pose, root=pose.root + 0.3)
    matrix, vector = length_equations(problem, moved, BODY.joint_basis, BODY.landmark_basis)
    found = np.linalg.lstsq(matrix, vector, rcond=1e-12)[0]
    here = problem.skeleton.offsets
    np.testing.assert_allclose((BODY.joint_basis @ found)[1:], here[1:], atol=1e-4)
