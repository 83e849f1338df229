"""Joint angles of a whole stretch of frames at once: damped Gauss-Newton with smoothness and limits.

Every frame has the root's position, a small turn of the root about the world's axes, and the open angles
of the skeleton. Landmarks pull on the frame that they belong to, smoothness ties three frames in a row, so
the normal equations are banded and one banded Cholesky solves a stretch. Limits are an active set: an
angle at its limit whose gradient points outwards is held there for the step, the others are clipped after it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

from muybridge.geometry.rotations import exp_so3, left_jacobian_so3, log_so3
from muybridge.geometry.skeleton import Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose:
    """State of `T` frames: root (T, 3) metres and (T, 3, 3) world from root, angles (T, J, 3) swing and
    twist."""

    root: Array
    turn: Array
    angles: Array

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
    landmark_joints: NDArray[np.intp]
    landmark_offsets: Array
    targets: Array
    information: Array
    rest: Array
    prior: Array
    acceleration: Array
    velocity: Array

    def frames(self, start: int, stop: int) -> "Problem":
        """The stretch from `start` to before `stop`."""
        return replace(self, targets=self.targets[start:stop], information=self.information[start:stop])

    @property
    def open_angles(self) -> NDArray[np.intp]:
        """(K,) indices into the flattened (J, 3) of what may move, the root's left out."""
        moves = self.skeleton.upper - self.skeleton.lower > 1e-9
        moves[0] = False
        return np.flatnonzero(moves.ravel())


def landmark_positions(problem: Problem, pose: Pose) -> Array:
    """(T, L, 3) metres: where the landmarks of a pose are."""
    turns, places = _forward(problem, pose)
    return _carried(problem, turns, places)


def _forward(problem: Problem, pose: Pose) -> tuple[Array, Array]:
    rotations = problem.skeleton.rotations_from_angles(pose.angles)
    rotations[:, 0] = pose.turn
    return problem.skeleton.forward(pose.root, rotations)


def _carried(problem: Problem, turns: Array, places: Array) -> Array:
    j = problem.landmark_joints
    return np.asarray(places[:, j] + (turns[:, j] @ problem.landmark_offsets[..., None])[..., 0])


def jacobian(problem: Problem, pose: Pose) -> tuple[Array, Array]:
    """Landmarks (T, L, 3) and their derivative (T, L, 3, 6 + K) by root position, root turn and open
    angles.
    """
    skeleton, open_angles = problem.skeleton, problem.open_angles
    turns, places = _forward(problem, pose)
    points = _carried(problem, turns, places)
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


def _axes_world(skeleton: Skeleton, pose: Pose, turns: Array) -> Array:
    """(T, J, 3, 3): column `k` is the world axis about which angle `k` of a joint turns what is below it."""
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
    """Half the weighted sum of squares of everything."""
    error = landmark_positions(problem, pose) - problem.targets
    total = np.einsum("tli,tlij,tlj->", error, problem.information, error, optimize=True)
    open_angles = problem.open_angles
    off = (pose.angles - problem.rest).reshape(len(pose), -1)[:, open_angles]
    total += np.sum(off**2 * problem.prior.ravel()[open_angles])
    first, second = _differences(problem, pose)
    chosen = np.r_[np.arange(6), 6 + open_angles]
    total += np.sum(first**2 * problem.velocity[chosen]) + np.sum(second**2 * problem.acceleration[chosen])
    return float(0.5 * total)


def _differences(problem: Problem, pose: Pose) -> tuple[Array, Array]:
    """First (T - 1, 6 + K) and second (T - 2, 6 + K) differences of the state."""
    turn = log_so3(pose.turn[1:] @ np.swapaxes(pose.turn[:-1], -1, -2)) if len(pose) > 1 else np.empty((0, 3))
    angles = pose.angles.reshape(len(pose), -1)[:, problem.open_angles]
    first = np.concatenate([np.diff(pose.root, axis=0), turn, np.diff(angles, axis=0)], axis=1)
    return first, np.diff(first, axis=0)


def _normal_equations(problem: Problem, pose: Pose) -> tuple[Array, Array]:
    """Gradient (T, N) and banded Gauss-Newton matrix (2 N + 1, T N), lower form."""
    points, jac = jacobian(problem, pose)
    t_count, n = len(pose), jac.shape[-1]
    weighted = problem.information @ jac
    error = points - problem.targets
    blocks = np.swapaxes(jac.reshape(t_count, -1, n), 1, 2) @ weighted.reshape(t_count, -1, n)
    gradient = np.einsum("tlin,tli->tn", weighted, error, optimize=True)
    open_angles = problem.open_angles
    prior = problem.prior.ravel()[open_angles]
    gradient[:, 6:] += (pose.angles - problem.rest).reshape(t_count, -1)[:, open_angles] * prior
    diagonal = np.zeros((t_count, n))
    diagonal[:, 6:] += prior
    chosen = np.r_[np.arange(6), 6 + open_angles]
    velocity, acceleration = problem.velocity[chosen], problem.acceleration[chosen]
    first, second = _differences(problem, pose)
    band = np.zeros((2 * n + 1, t_count, n))
    for weight, values, stencil in ((velocity, first, (-1, 1)), (acceleration, second, (1, -2, 1))):
        rows = len(values)
        for i, a in enumerate(stencil):
            gradient[i : i + rows] += a * weight * values
            diagonal[i : i + rows] += a * a * weight
            for k, b in enumerate(stencil[i + 1 :], start=1):
                band[k * n, i : i + rows] += a * b * weight
    blocks[:, np.arange(n), np.arange(n)] += diagonal
    for k in range(n):
        band[k, :, : n - k] = np.diagonal(blocks, -k, axis1=1, axis2=2)
    return gradient, band.reshape(2 * n + 1, t_count * n)


def _held(problem: Problem, pose: Pose, gradient: Array, fixed_frames: int) -> NDArray[np.bool_]:
    """(T, N) what does not move in this step: fixed frames, and angles pressed against a limit."""
    open_angles = problem.open_angles
    angles = pose.angles.reshape(len(pose), -1)[:, open_angles]
    lower, upper = (v.ravel()[open_angles] for v in (problem.skeleton.lower, problem.skeleton.upper))
    slope = gradient[:, 6:]
    held = np.zeros(gradient.shape, dtype=np.bool_)
    held[:, 6:] = ((angles <= lower) & (slope > 0)) | ((angles >= upper) & (slope < 0))
    held[:fixed_frames] = True
    return held


def _step(band: Array, gradient: Array, held: NDArray[np.bool_], damping: float) -> Array:
    """Solve for the damped step (T, N), zero where held."""
    free = (~held).ravel().astype(np.float64)
    matrix = band.copy()
    for k in np.flatnonzero(np.any(band != 0, axis=1)):
        matrix[k, : len(free) - k] *= free[k:] * free[: len(free) - k]
    matrix[0] = np.where(free > 0, matrix[0] * (1 + damping) + 1e-9, 1.0)
    step = solveh_banded(
        matrix, -gradient.ravel() * free, lower=True, overwrite_ab=True, overwrite_b=True, check_finite=False
    )
    return np.asarray(step.reshape(gradient.shape))


def moved(problem: Problem, pose: Pose, step: Array) -> Pose:
    """The pose after a step (T, 6 + K), angles clipped to their limits."""
    flat = pose.angles.reshape(len(pose), -1).copy()
    flat[:, problem.open_angles] += step[:, 6:]
    angles: Array = flat.reshape(pose.angles.shape)
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
        gradient, band = _normal_equations(problem, pose)
        held = _held(problem, pose, gradient, fixed_frames)
        before = value
        for _ in range(6):
            try:
                trial = moved(problem, pose, _step(band, gradient, held, damping))
            except LinAlgError:
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
