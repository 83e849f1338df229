"""Joint angles of a whole stretch of frames at once: damped Gauss-Newton with smoothness and limits.

Every frame has the root's position, a small turn of the root about the world's axes, and the open angles
of the skeleton. Landmarks pull on the frame that they belong to, smoothness ties three frames in a row, so
the normal equations are banded and one banded Cholesky solves a stretch. Limits are an active set: an
angle at its limit whose gradient points outwards is held there for the step, the others are clipped after it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.fitting._banded_kernel import assemble, hold, total_cost
from muybridge.geometry.fitting._chain_kernel import landmarks_of
from muybridge.geometry.fitting.chain import Chain, make_chain, open_angles
from muybridge.geometry.numerics.rotations import exp_so3, left_jacobian_so3
from muybridge.geometry.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Pose:
    """State of `T` frames: root (T, 3) metres and (T, 3, 3) world from root, angles (T, J, 3) swing and
    twist."""

    root: FloatArray
    turn: FloatArray
    angles: FloatArray

    def __len__(self) -> int:
        return len(self.root)

    def frames(self, start: int, stop: int) -> "Pose":
        """The stretch from `start` to before `stop`."""
        return Pose(self.root[start:stop], self.turn[start:stop], self.angles[start:stop])


@dataclass(frozen=True, eq=False)
class Problem:
    """What a pose is fitted to.

    Attributes:
        skeleton: with its lengths.
        landmark_joints: (L,) joint that carries each landmark.
        landmark_offsets: (L, 3) metres.
        targets: (T, L, 3) metres; any finite value where `information` is zero.
        information: (T, L, 3, 3) inverse covariance, robust weight included, zero where missing.
        rest: (J, 3) radians, mean of the prior on each angle.
        prior: (J, 3) its inverse variance.
        acceleration: (6 + 3 J,) inverse variance of second differences: root position, root turn, angles.
        velocity: (6 + 3 J,) inverse variance of first differences.
    """

    skeleton: Skeleton
    landmark_joints: IndexArray
    landmark_offsets: FloatArray
    targets: FloatArray
    information: FloatArray
    rest: FloatArray
    prior: FloatArray
    acceleration: FloatArray
    velocity: FloatArray

    def frames(self, start: int, stop: int) -> "Problem":
        """The stretch from `start` to before `stop`."""
        return replace(self, targets=self.targets[start:stop], information=self.information[start:stop])

    @property
    def open_angles(self) -> IndexArray:
        """(K,) indices into the flattened (J, 3) of the angles that may move, without the root's."""
        return open_angles(self.skeleton)

    @cached_property
    def chain(self) -> Chain:
        """The same for the compiled kernels."""
        return make_chain(self.skeleton, self.landmark_joints, self.landmark_offsets, self.rest, self.prior)


def landmark_positions(problem: Problem, pose: Pose) -> FloatArray:
    """(T, L, 3) metres: the landmarks of a pose."""
    return np.asarray(landmarks_of(problem.chain, *_state(pose)))


def jacobian(problem: Problem, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Landmarks (T, L, 3) and their derivative (T, L, 3, 6 + K) by root position, root turn and open
    angles.
    """
    skeleton, open_angles = problem.skeleton, problem.open_angles
    rotations = skeleton.rotations_from_angles(pose.angles)
    rotations[:, 0] = pose.turn
    turns, places = skeleton.forward(pose.root, rotations)
    points = landmark_positions(problem, pose)
    joint, axis = np.divmod(open_angles, 3)
    axes_world = _axes_world(skeleton, pose, turns)[:, joint, :, axis].transpose(1, 0, 2)
    moved = skeleton.is_ancestor[joint][:, problem.landmark_joints].T
    arm = points[:, :, None, :] - places[:, None, joint, :]
    out = np.zeros((*points.shape, 6 + len(open_angles)))
    out[..., :3] = np.eye(3)
    lever = points - pose.root[:, None]
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        out[..., k, 3 + i], out[..., m, 3 + i] = -lever[..., m], lever[..., k]
        column = axes_world[:, None, :, k] * arm[..., m] - axes_world[:, None, :, m] * arm[..., k]
        out[..., i, 6:] = column * moved
    return points, out


def _axes_world(skeleton: Skeleton, pose: Pose, turns: FloatArray) -> FloatArray:
    """(T, J, 3, 3): column `k` is the world axis about which angle `k` of a joint rotates everything below it."""
    out = np.empty_like(turns)
    parents = np.array(skeleton.parents)
    for axis in range(3):
        chosen = [j for j in range(1, len(skeleton)) if skeleton.twist_axis[j] == axis]
        swing = pose.angles[:, chosen].copy()
        swing[..., axis] = 0.0
        local = left_jacobian_so3(swing)
        local[..., :, axis] = exp_so3(swing)[..., :, axis]
        out[:, chosen] = turns[:, parents[chosen]] @ local
    return out


def cost(problem: Problem, pose: Pose) -> float:
    """Half the weighted sum of squares of all terms."""
    return float(total_cost(problem.chain, *_state(pose), *_data(problem)))


def _state(pose: Pose) -> tuple[FloatArray, FloatArray, FloatArray]:
    return np.ascontiguousarray(pose.root), np.ascontiguousarray(pose.turn), np.ascontiguousarray(pose.angles)


def _data(problem: Problem) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    chosen = np.r_[np.arange(6), 6 + problem.open_angles]
    targets, information = np.ascontiguousarray(problem.targets), np.ascontiguousarray(problem.information)
    return targets, information, problem.velocity[chosen], problem.acceleration[chosen]


def _held(problem: Problem, pose: Pose, gradient: FloatArray, fixed_frames: int) -> BoolArray:
    """(T, N) unknowns that are held in this step: fixed frames, and angles pressed against a limit."""
    open_angles = problem.open_angles
    angles = pose.angles.reshape(len(pose), -1)[:, open_angles]
    lower, upper = (v.ravel()[open_angles] for v in (problem.skeleton.lower, problem.skeleton.upper))
    slope = gradient[:, 6:]
    held = np.zeros(gradient.shape, dtype=np.bool_)
    held[:, 6:] = ((angles <= lower) & (slope > 0)) | ((angles >= upper) & (slope < 0))
    held[:fixed_frames] = True
    return held


def _step(band: FloatArray, gradient: FloatArray, held: BoolArray, damping: float) -> FloatArray:
    """Solve for the damped step (T, N), zero where held."""
    matrix, right = hold(band, gradient, held, damping)
    step = scipy.linalg.solveh_banded(
        matrix.T, right, lower=True, overwrite_ab=True, overwrite_b=True, check_finite=False
    )
    return np.asarray(step.reshape(gradient.shape))


def moved(problem: Problem, pose: Pose, step: FloatArray) -> Pose:
    """The pose after a step (T, 6 + K), angles clipped to their limits."""
    flat = pose.angles.reshape(len(pose), -1).copy()
    flat[:, problem.open_angles] += step[:, 6:]
    angles: FloatArray = flat.reshape(pose.angles.shape)
    np.clip(angles[:, 1:], problem.skeleton.lower[1:], problem.skeleton.upper[1:], out=angles[:, 1:])
    return Pose(pose.root + step[:, :3], exp_so3(step[:, 3:6]) @ pose.turn, angles)


def solve(problem: Problem, pose: Pose, steps: int, fixed_frames: int = 0, damping: float = 1e-3) -> Pose:
    """Gauss-Newton steps on one stretch; a step that makes things worse is taken back and damped.

    Args:
        problem: what to fit.
        pose: where to start; within the limits.
        steps: how many steps at most.
        fixed_frames: so many frames at the start are not moved, only connected to.
        damping: share of the diagonal that is added, adapted from step to step.

    Returns:
        The pose, its cost never above the start's.
    """
    value = cost(problem, pose)
    for _ in range(steps):
        band, gradient = assemble(problem.chain, *_state(pose), *_data(problem))
        held = _held(problem, pose, gradient, fixed_frames)
        before = value
        for _ in range(6):
            try:
                trial = moved(problem, pose, _step(band, gradient, held, damping))
            except np.linalg.LinAlgError:
                damping = max(damping * 10, 1e-6)
                continue
            trial_value = cost(problem, trial)
            if trial_value <= value:
                pose, value, damping = trial, trial_value, max(damping * 0.3, 1e-7)
                break
            damping = max(damping * 10, 1e-6)
        if before - value <= 1e-6 * before:
            break
    return pose


def solve_in_stretches(problem: Problem, pose: Pose, steps: int, stretch: int = 500, overlap: int = 30) -> Pose:
    """`solve` for takes of any length in bounded memory: overlapping stretches, each tied to the one
    before it.

    A stretch sees `overlap` frames beyond its end, so that its last frames know what comes; the next one
    starts two frames before that end, which it holds.
    """
    t_count = len(pose)
    out = Pose(pose.root.copy(), pose.turn.copy(), pose.angles.copy())
    start = 0
    while start < t_count:
        stop = min(start + stretch, t_count)
        begin, end = max(start - 2, 0), min(stop + overlap, t_count)
        solved = solve(problem.frames(begin, end), out.frames(begin, end), steps, fixed_frames=start - begin)
        kept = slice(start - begin, stop - begin)
        out.root[start:stop] = solved.root[kept]
        out.turn[start:stop] = solved.turn[kept]
        out.angles[start:stop] = solved.angles[kept]
        start = stop
    return out
