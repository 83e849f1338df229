"""A robot's joints over a whole take at once: damped Gauss-Newton with limits, smoothness, capsules and floor.

Poses are found on a few frames a second first, all of them from the robot's own pose; then all frames are solved
together, in stretches whose first two frames are those of the stretch before.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.banded import solve_damped
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.motion.robots._solver_kernel import Terms, assemble, total_cost
from muybridge.motion.robots.capsules import Capsules
from muybridge.motion.robots.robot import Robot
from muybridge.motion.robots.targets import RobotSole, Targets

_STRETCH, _OVERLAP = 900, 60  # frames that are solved together, and that two stretches share
_COARSE_FPS = 8.0  # of the frames that are solved first
_PRIOR = 0.02  # of joints towards their own pose: inverse variance, one over radians squared
_SLOWER = 0.98  # of the largest speed, that the solve aims at
_MARGIN_M = 0.004  # that capsules are kept apart
_SOFT_M = 0.001  # of floor and capsules
_INSIDE_M, _FIRMER = 0.004, 3  # links that are farther inside each other are solved again, so often


@dataclass(frozen=True)
class SolveOptions:
    """How a robot is solved.

    Attributes:
        smoothing: radians per second squared, standard deviation of the joints' acceleration; a third of it in metres
            for the root. Smaller is smoother.
        iterations: at most, of a stretch.
        tolerance: relative fall of the cost below which a stretch is done.
    """

    smoothing: float = 40.0
    iterations: int = 12
    tolerance: float = 2e-3


@dataclass(frozen=True, eq=False)
class RobotPose:
    """A robot over time.

    Attributes:
        root: (T, 3) metres, the root link in the world, Z up.
        turn: (T, 3, 3) world from root link.
        free: (T, D) values of the free joints.
    """

    root: FloatArray
    turn: FloatArray
    free: FloatArray

    def __len__(self) -> int:
        return len(self.root)

    def frames(self, start: int, stop: int) -> "RobotPose":
        """The stretch from `start` to before `stop`."""
        return RobotPose(self.root[start:stop], self.turn[start:stop], self.free[start:stop])


@dataclass(frozen=True, eq=False)
class _Stretch:
    """What some frames are solved for, and between which limits."""

    robot: Robot
    terms: Terms
    places: FloatArray
    weights: FloatArray
    turns: FloatArray
    turn_weights: FloatArray
    lower: FloatArray
    upper: FloatArray

    def frames(self, chosen: slice) -> "_Stretch":
        cut = (
            np.ascontiguousarray(each[chosen]) for each in (self.places, self.weights, self.turns, self.turn_weights)
        )
        places, weights, turns, turn_weights = cut
        return replace(self, places=places, weights=weights, turns=turns, turn_weights=turn_weights)

    def state(self, pose: RobotPose) -> tuple[Any, ...]:
        parts = (np.ascontiguousarray(each) for each in (pose.root, pose.turn, pose.free))
        return (self.robot.tree, self.terms, *parts, self.places, self.weights, self.turns, self.turn_weights)

    def cost(self, pose: RobotPose) -> float:
        return float(total_cost(*self.state(pose)))


def solve_robot(
    robot: Robot, targets: Targets, capsules: Capsules, soles: tuple[tuple[int, RobotSole], ...], fps: float,
    options: SolveOptions | None = None, progress: Callable[[int], None] | None = None,
) -> RobotPose:  # fmt: skip
    """The robot's poses over a take.

    Args:
        robot: that moves.
        targets: where to.
        capsules: of its links, which are kept apart and over the floor.
        soles: (link, sole) of the feet, which are kept over the floor.
        fps: frames per second.
        options: how.
        progress: called with the number of frames of each stretch that is done.
    """
    options = options or SolveOptions()
    lower, upper, speed = robot.limits
    terms = _terms(robot, targets, capsules, soles, speed, fps, options)
    whole = _Stretch(robot, terms, targets.places, targets.weights, targets.turns, targets.turn_weights, lower, upper)
    frames = len(targets.places)
    pose = _first(whole, targets, fps, options)
    start = 0
    while True:
        stop = min(start + _STRETCH, frames)
        fixed = 2 if start else 0
        part = _solve_stretch(whole.frames(slice(start, stop)), pose.frames(start, stop), capsules, options, fixed)
        for whole_part, mine in ((pose.root, part.root), (pose.turn, part.turn), (pose.free, part.free)):
            whole_part[start:stop] = mine
        if progress is not None:
            progress(stop - start)
        if stop == frames:
            break
        start = stop - _OVERLAP
    return replace(pose, free=_within_speed(pose.free, speed / fps))


def _terms(
    robot: Robot, targets: Targets, capsules: Capsules, soles: tuple[tuple[int, RobotSole], ...], speed: FloatArray,
    fps: float, options: SolveOptions,
) -> Terms:  # fmt: skip
    nodes = robot.tree.node_of_link
    turns, places = robot.at_rest()
    low_link = np.concatenate([*(np.full(4, link) for link, _ in soles), capsules.link, capsules.link]).astype(np.int64)
    corners = [(sole.corners - places[link]) @ turns[link] for link, sole in soles]
    feet = [link for link, _ in soles]
    low = np.concatenate([*corners, capsules.start, capsules.stop])
    radius = np.concatenate([np.zeros(4 * len(soles)), capsules.radius, capsules.radius])
    keep = ~np.isin(low_link, feet) | (np.arange(len(low)) < 4 * len(soles))
    return Terms(
        nodes[targets.links], targets.points, nodes[targets.turned], nodes[capsules.link], capsules.start,
        capsules.stop, capsules.radius, capsules.pairs, nodes[low_link[keep]], np.ascontiguousarray(low[keep]),
        radius[keep], robot.rest, np.full(len(robot.rest), _PRIOR), *_smoothness(robot, fps, options),
        _SLOWER * speed / fps, _MARGIN_M, 1 / _SOFT_M**2, 1 / _SOFT_M**2, 1e4 * fps**2,
    )  # fmt: skip


def _smoothness(robot: Robot, fps: float, options: SolveOptions) -> tuple[FloatArray, FloatArray]:
    """(N,) weights of first and second differences; a frame's targets weigh the same at every rate."""
    sigma = np.full(6 + len(robot.rest), options.smoothing)
    sigma[:3] /= 3
    for d, k in enumerate(robot.free):
        if robot.joints[k].kind == "slide":
            sigma[6 + d] /= 3
    acceleration = (fps**2 / sigma) ** 2
    return np.full(len(sigma), 1e-6), acceleration


def _first(whole: _Stretch, targets: Targets, fps: float, options: SolveOptions) -> RobotPose:
    """Poses to begin with: every few frames from the robot's own pose, splines between them."""
    frames = len(targets.places)
    step = max(round(fps / _COARSE_FPS), 1)
    some = np.unique(np.append(np.arange(0, frames, step), frames - 1))
    robot = whole.robot
    turns, places = robot.at_rest()
    hips = targets.turned[0]
    turn = targets.turns[some, 0] @ turns[hips].T @ turns[0]
    point = places[hips] + turns[hips] @ targets.points[0] - places[0]
    root = targets.places[some, 0] - (turn @ (turns[0].T @ point)[None, :, None])[..., 0]
    coarse = replace(whole.frames(slice(None)), terms=whole.terms._replace(
        acceleration=whole.terms.acceleration / step**4, fastest=np.full(len(robot.rest), np.inf)))  # fmt: skip
    coarse = replace(
        coarse, places=targets.places[some], weights=np.minimum(targets.weights[some], 1e4), turns=targets.turns[some],
        turn_weights=np.minimum(targets.turn_weights[some], 1e3),
    )  # fmt: skip
    loose = replace(options, iterations=30, tolerance=1e-3)
    begin = RobotPose(root, turn, np.tile(robot.rest, (len(some), 1)))
    apart = coarse.terms._replace(apart=0.0, floor=0.0)
    pose = _gauss_newton(replace(coarse, terms=apart), begin, loose, 0)
    pose = _gauss_newton(coarse, pose, replace(loose, iterations=10), 0)
    if len(some) == frames:
        return pose
    at = np.arange(frames)
    turned = Slerp(some, Rotation.from_matrix(pose.turn))(at).as_matrix() if frames > 1 else pose.turn
    free = np.clip(PchipInterpolator(some, pose.free)(at), whole.lower, whole.upper)
    return RobotPose(PchipInterpolator(some, pose.root)(at), turned, free)


def _solve_stretch(
    stretch: _Stretch, pose: RobotPose, capsules: Capsules, options: SolveOptions, fixed: int
) -> RobotPose:
    """A stretch; where links are still inside each other, again with more weight on that."""
    pose = _gauss_newton(stretch, pose, options, fixed)
    robot, terms = stretch.robot, stretch.terms
    for _ in range(_FIRMER):
        turns, places = robot.forward(pose.root, pose.turn, robot.all_joints(pose.free))
        gaps = capsules.distances(turns, places)
        if not gaps.size or gaps.min() > -_INSIDE_M:
            break
        terms = terms._replace(apart=10 * terms.apart)
        pose = _gauss_newton(replace(stretch, terms=terms), pose, options, fixed)
    return pose


def _gauss_newton(stretch: _Stretch, pose: RobotPose, options: SolveOptions, fixed: int) -> RobotPose:
    """Minimise a stretch from a pose; the first `fixed` frames stay."""
    cost, damping = stretch.cost(pose), 1e-5
    for _ in range(options.iterations):
        band, slope = assemble(*stretch.state(pose))
        held = _held(stretch, pose, slope, fixed)
        accepted = False
        for _ in range(8):
            change = solve_damped(band, slope, held, damping)
            if change is not None:
                trial = _moved(stretch, pose, change)
                now = stretch.cost(trial)
                if now <= cost:
                    accepted = True
                    break
            damping *= 10
        if not accepted:
            break
        fall, pose, cost = cost - now, trial, now
        damping = max(damping / 5, 1e-7)
        if fall <= options.tolerance * cost:
            break
    return pose


def _held(stretch: _Stretch, pose: RobotPose, slope: FloatArray, fixed: int) -> BoolArray:
    """(T, N) unknowns that stay in this step: fixed frames, and joints that are pressed against a limit."""
    held = np.zeros(slope.shape, np.bool_)
    below, above = pose.free <= stretch.lower, pose.free >= stretch.upper
    held[:, 6:] = (below & (slope[:, 6:] > 0)) | (above & (slope[:, 6:] < 0))
    held[:fixed] = True
    return held


def _moved(stretch: _Stretch, pose: RobotPose, change: FloatArray) -> RobotPose:
    change = np.clip(change, -1.0, 1.0)
    free = np.clip(pose.free + change[:, 6:], stretch.lower, stretch.upper)
    return RobotPose(pose.root + change[:, :3], exp_so3(change[:, 3:6]) @ pose.turn, free)


def _within_speed(free: FloatArray, fastest: FloatArray) -> FloatArray:
    """(T, D) with no step larger than it may be: each frame as near to what was solved as it can be."""
    if not np.isfinite(fastest).any() or not (np.abs(np.diff(free, axis=0)) > fastest).any():
        return free
    out = free.copy()
    for t in range(1, len(out)):
        out[t] = np.clip(out[t], out[t - 1] - fastest, out[t - 1] + fastest)
    return out
