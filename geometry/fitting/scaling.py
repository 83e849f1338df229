"""Lengths of a person's bones, and the places of markers on them, for any skeleton."""

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.fitting.bone_lengths import length_equations
from muybridge.geometry.fitting.gauss_newton import Pose, Problem, landmark_positions
from muybridge.geometry.fitting.skeleton_fit import (
    Rigging,
    SkeletonFit,
    SkeletonFitOptions,
    checked,
    fit_take,
    take_problem,
    weighed,
)
from muybridge.geometry.skeleton.skeleton import Skeleton

_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("_l", "_r"), ("_L", "_R"), (".L", ".R"))


def calibrate_skeleton(
    skeleton: Skeleton, points_world: FloatArray, fps: float, rigging: Rigging | None = None,
    options: SkeletonFitOptions | None = None, length_spread: float = 0.2, side_spread: float = 0.02,
    offset_spread: float = 0.0,
) -> tuple[Skeleton, Rigging]:  # fmt: skip
    """Lengths of a person's bones, and where the points sit on them, from a take.

    One scale per bone along the offset that the template has, about the same left and right where names pair
    (`left_x`/`right_x`, `LeftX`/`RightX`); alternately the pose by `fit_take` and the scales by linear least squares.

    Args:
        skeleton: the template; its lengths are the prior, up to one scale that the points determine.
        points_world, fps, rigging, options: as of `fit_take`; one second of varied motion is enough.
        length_spread: standard deviation of a bone's share of its length, over the common scale.
        side_spread: standard deviation of the difference of the two sides' scales.
        offset_spread: metres, how far points may sit from where `rigging` has them; 0: they do not move.

    Returns:
        The skeleton with its new offsets and tips, and the rigging with its new offsets.
    """
    options = options or SkeletonFitOptions()
    given, (skeleton, rigging) = skeleton, checked(skeleton, points_world, fps, rigging)
    common = _common_scale(skeleton, rigging, points_world)
    template = replace(skeleton, offsets=skeleton.offsets * common, tips=skeleton.tips * common)
    rigging = Rigging(rigging.joints, rigging.offsets * common)
    group, pairs = _bone_scales(template)
    groups, size = group.max() + 1, group.max() + 1 + (3 * len(rigging.joints) if offset_spread > 0 else 0)
    joint_basis = np.zeros((len(template), 3, size))
    moves = group >= 0
    joint_basis[moves, :, group[moves]] = template.offsets[moves]
    landmark_basis = np.zeros((len(rigging.joints), 3, size))
    if offset_spread > 0:
        for k in range(len(rigging.joints)):
            landmark_basis[k, :, groups + 3 * k : groups + 3 * k + 3] = np.eye(3)
    mean = np.r_[np.ones(groups), rigging.offsets.ravel()][:size]
    spread = np.r_[np.full(groups, length_spread), np.full(size - groups, max(offset_spread, 1e-9))]
    certain = np.diag(1.0 / spread**2)
    for a, b in pairs:
        certain[np.ix_([a, b], [a, b])] += np.array([[1, -1], [-1, 1]]) / side_spread**2
    value, current, rigged = mean.copy(), template, rigging
    chosen = points_world[_calibration_span(points_world)]
    for _ in range(4):
        fit = fit_take(current, chosen, fps, rigged, options)
        sigma = options.sigma or fit.sigma
        problem = take_problem(current, rigged, chosen, sigma, fps, options)
        pose = Pose(fit.motion.root_positions_world, _root_turns(fit), fit.angles)
        problem = weighed(problem, pose, sigma, options)
        matrix, vector = length_equations(problem, pose, joint_basis, landmark_basis)
        if offset_spread == 0:
            vector -= _of_fixed_offsets(problem, pose, joint_basis, landmark_basis, rigging)
        value = np.linalg.solve(matrix + certain, vector + certain @ mean)
        scale = np.where(moves, np.clip(value[group], 0.3, 3.0), 1.0)
        offsets = value[groups:].reshape(-1, 3) if offset_spread > 0 else rigging.offsets
        current = replace(template, offsets=template.offsets * scale[:, None], tips=_tips(template, scale))
        rigged = Rigging(rigging.joints, offsets)
    return replace(given, offsets=current.offsets, tips=current.tips), rigged


def _tips(template: Skeleton, scale: FloatArray) -> FloatArray:
    """The tips, scaled with the bone before them."""
    return np.asarray(template.tips * scale[:, None])


def _root_turns(fit: SkeletonFit) -> FloatArray:
    return fit.motion.forward()[:, 0, :3, :3]


def _calibration_span(points_world: FloatArray, most: int = 600) -> slice:
    """The stretch of at most `most` frames with most points in it."""
    if len(points_world) <= most:
        return slice(None)
    known = np.concatenate([[0], np.cumsum(np.isfinite(points_world[..., 0]).sum(axis=1))])
    start = int(np.argmax(known[most:] - known[:-most]))
    return slice(start, start + most)


def _of_fixed_offsets(
    problem: Problem, pose: Pose, joint_basis: FloatArray, landmark_basis: FloatArray, rigging: Rigging
) -> FloatArray:
    """Terms of points away from joint centres on the right-hand side where their offsets are known."""
    still = replace(problem, skeleton=replace(problem.skeleton, offsets=0 * problem.skeleton.offsets))
    moved = replace(problem, targets=landmark_positions(still, Pose(0 * pose.root, pose.turn, pose.angles)))
    _, vector = length_equations(moved, Pose(0 * pose.root, pose.turn, pose.angles), joint_basis, landmark_basis)
    return vector


def _bone_scales(skeleton: Skeleton) -> tuple[IndexArray, list[tuple[int, int]]]:
    """(J,) number of the scale that each bone has, -1 where there is no length; and the left-right pairs."""
    long = skeleton.bone_lengths > 1e-6
    long[0] = False
    number = np.where(long, np.cumsum(long) - 1, -1)
    pairs = []
    for j, name in enumerate(skeleton.names):
        twins = [name.replace(a, b, 1) for a, b in _SIDES if a in name] + ["R" + name[1:]] * name.startswith("L")
        other = next((skeleton.index(t) for t in twins if t in skeleton.names and t != name), -1)
        if other >= 0 and long[j] and long[other]:
            pairs.append((int(number[j]), int(number[other])))
    return number, pairs


def _common_scale(skeleton: Skeleton, rigging: Rigging, points_world: FloatArray) -> float:
    """Median ratio of the points' distances to those at rest, over bones with points at both ends."""
    at = skeleton.rest_positions[rigging.joints] + rigging.offsets
    ratios = []
    for a, joint in enumerate(rigging.joints):
        for b, other in enumerate(rigging.joints):
            length = np.linalg.norm(at[a] - at[b])
            if skeleton.parents[joint] == other and length > 0.05:
                seen = np.linalg.norm(points_world[:, a] - points_world[:, b], axis=-1)
                if np.isfinite(seen).any():
                    ratios.append(float(np.nanmedian(seen)) / length)
    return float(np.median(ratios)) if ratios else 1.0
