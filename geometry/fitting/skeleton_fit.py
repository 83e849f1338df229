"""Fitting any skeleton to any labelled points: frame by frame, or the whole take at once.

`fit_online` is causal: a frame depends on itself and on earlier ones (a Kalman prediction, Gauss-Newton with limits
and robust weights on top). `fit_take` starts there and then moves all frames together, tied by smoothness. Bones keep
the lengths that the skeleton has; `scaling.calibrate_skeleton` estimates them. `body_fit.fit_body` does the same for
the project's own body with its landmarks, whose proportions have a prior.
"""

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting._chain_kernel import landmarks_of, rotations_of
from muybridge.geometry.fitting._kalman_kernel import count_far, settle, track, track_one
from muybridge.geometry.fitting.chain import Chain, make_chain
from muybridge.geometry.fitting.gauss_newton import Pose, Problem, landmark_positions, solve_in_stretches
from muybridge.geometry.numerics.rotations import continuous_quat, exp_so3, kabsch, quat_from_rotation
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import with_limits
from muybridge.geometry.skeleton.skeleton import Skeleton

State = tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]  # root, turn, angles, their rates, and their variances

_PATIENCE = 10  # frames until a body that could not be found again is looked for once more


@dataclass(frozen=True)
class SkeletonFitOptions:
    """How a skeleton is fitted to points.

    Attributes:
        sigma: metres, standard deviation of a coordinate; None measures it on the points (`noise_of`).
        student_dof: degrees of freedom of Student's t, the robust loss; 0 is least squares.
        root_acceleration: metres per second squared, standard deviation of the root's acceleration.
        angular_acceleration: radians per second squared, of every angle's.
        root_velocity, angular_velocity: metres and radians per second, hold the take back across gaps.
        rest_spread: radians, of the weak prior that holds what no point determines.
        iterations: Gauss-Newton steps per frame online.
        rounds: how often robust weights are taken anew for the whole take; steps: Gauss-Newton steps a round.
    """

    sigma: float | None = None
    student_dof: float = 4.0
    root_acceleration: float = 20.0
    angular_acceleration: float = 130.0
    root_velocity: float = 3.0
    angular_velocity: float = 12.0
    rest_spread: float = 2.0
    iterations: int = 2
    rounds: int = 2
    steps: int = 2


@dataclass(frozen=True, eq=False)
class SkeletonFit:
    """A skeleton in motion, and how the points agree.

    Attributes:
        motion: of the skeleton given.
        angles: (T, J, 3) radians, swing and twist, within the skeleton's limits.
        landmarks_world: (T, L, 3) metres, in every frame.
        residual_m: (T, L) metres from each point; NaN where missing.
        weight: (T, L) 0..1, how much each point counted.
        sigma: metres, the noise that was measured or given.
    """

    motion: Motion
    angles: FloatArray
    landmarks_world: FloatArray
    residual_m: FloatArray
    weight: FloatArray
    sigma: float


@dataclass(frozen=True, eq=False)
class Rigging:
    """Which points sit where on a skeleton.

    Attributes:
        joints: (L,) index of the joint that carries each point.
        offsets: (L, 3) metres in that joint's axes.
    """

    joints: IndexArray
    offsets: FloatArray


def joint_rigging(skeleton: Skeleton, names: tuple[str, ...] | None = None) -> Rigging:
    """Points that are joint centres: all joints, or those named."""
    joints = np.arange(len(skeleton)) if names is None else np.array([skeleton.index(n) for n in names])
    return Rigging(joints.astype(np.intp), np.zeros((len(joints), 3)))


def noise_of(points_world: FloatArray, fps: float) -> float:
    """Standard deviation of a coordinate of (T, L, 3) points, metres: from third differences, which motion hardly has.

    Reliable at 50 frames per second and above: in slower takes quick motion counts as noise.
    """
    third = np.diff(points_world, 3, axis=0)
    known = third[np.isfinite(third)]
    if not known.size or fps <= 0:
        return 0.01
    # Of independent noise the third difference has the variance 1 + 9 + 9 + 1.
    return float(np.clip(np.median(np.abs(known)) / 0.6745 / np.sqrt(20.0), 5e-4, 0.2))


def fit_online(
    skeleton: Skeleton, points_world: FloatArray, fps: float, rigging: Rigging | None = None,
    options: SkeletonFitOptions | None = None,
) -> SkeletonFit:  # fmt: skip
    """Fit frame by frame, each from itself and the frames before it.

    Args:
        skeleton: with its lengths and limits; where all are infinite, those of `with_limits`.
        points_world: (T, L, 3) metres, NaN where missing.
        fps: frames per second.
        rigging: where the points sit; joint centres in the skeleton's order if None.
        options: see SkeletonFitOptions.

    Returns:
        A SkeletonFit with every frame; before the first frame that places the body it is held.

    Raises:
        MuybridgeError: no frame has three points.
    """
    options = options or SkeletonFitOptions()
    given, (skeleton, rigging) = skeleton, checked(skeleton, points_world, fps, rigging)
    chain = _chain(skeleton, rigging, options)
    sigma = options.sigma or noise_of(points_world, fps)
    pose, _ = _tracked(chain, points_world, sigma, fps, options)
    return _result(given, skeleton, chain, pose, points_world, fps, sigma, options)


def fit_take(
    skeleton: Skeleton, points_world: FloatArray, fps: float, rigging: Rigging | None = None,
    options: SkeletonFitOptions | None = None,
) -> SkeletonFit:  # fmt: skip
    """Fit all frames together; arguments, result and errors as of `fit_online`."""
    options = options or SkeletonFitOptions()
    given, (skeleton, rigging) = skeleton, checked(skeleton, points_world, fps, rigging)
    chain = _chain(skeleton, rigging, options)
    sigma = options.sigma or noise_of(points_world, fps)
    pose, lost = _tracked(chain, points_world, sigma, fps, options)
    problem = take_problem(skeleton, rigging, points_world, sigma, fps, options)
    edges = [0, *_cuts(chain, pose, lost, fps), len(pose)]
    for begin, end in zip(edges, edges[1:], strict=False):
        part, here = problem.frames(begin, end), pose.frames(begin, end)
        for _ in range(options.rounds):
            here = solve_in_stretches(weighed(part, here, sigma, options), here, options.steps)
        pose.root[begin:end], pose.turn[begin:end], pose.angles[begin:end] = here.root, here.turn, here.angles
    return _result(given, skeleton, chain, pose, points_world, fps, sigma, options)


class OnlineFit:
    """`fit_online` as a stream: takes one frame after another."""

    def __init__(
        self, skeleton: Skeleton, fps: float, sigma: float, rigging: Rigging | None = None,
        options: SkeletonFitOptions | None = None,
    ) -> None:  # fmt: skip
        self.options = options or SkeletonFitOptions()
        self.rigging = rigging or joint_rigging(skeleton)
        self.skeleton, self.fps, self.sigma = solvable(skeleton, self.rigging), fps, sigma
        self._chain = _chain(self.skeleton, self.rigging, self.options)
        self._state: State | None = None
        self._patience = 0
        self._jerkiness = _jerkiness(self._chain, self.options)

    def update(self, points_world: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """The next frame: (L, 3) metres, NaN where missing.

        Returns:
            Root position (3,) and joint rotations (J, 3, 3), parent from joint; None until a frame has had enough
            points to place the body.
        """
        targets, information = _known(points_world[None], self.sigma)
        if self._state is None:
            if np.count_nonzero(information[0]) < _enough(self._chain):
                return None
            self._state = _begun(self._chain, targets[0], information[0], self.options)
        else:
            o = self.options
            data = targets[0], information[0]
            track_one(self._chain, *self._state, *data, 1 / self.fps, self._jerkiness, o.student_dof, o.iterations)
            known, far = count_far(self._chain, *self._state[:3], *data)
            self._patience -= 1
            if known >= 4 and 4 * far > known and self._patience < 0:
                self._state, found = _recovered(self._chain, self._state, *data, o)
                self._patience = 0 if found else _PATIENCE
        root, turn, angles = self._state[:3]
        return root.copy(), np.asarray(rotations_of(self._chain, turn[None], angles[None])[0])


def checked(
    skeleton: Skeleton, points_world: FloatArray, fps: float, rigging: Rigging | None
) -> tuple[Skeleton, Rigging]:
    """The skeleton prepared for the solver, and the rigging."""
    rigging = rigging or joint_rigging(skeleton)
    if points_world.ndim != 3 or points_world.shape[1:] != (len(rigging.joints), 3):
        raise ValueError(f"points_world must be (T, {len(rigging.joints)}, 3), not {points_world.shape}")
    if not fps > 0:
        raise ValueError(f"fps must be above zero, not {fps}")
    return solvable(skeleton, rigging), rigging


def solvable(skeleton: Skeleton, rigging: Rigging, lever: float = 0.005) -> Skeleton:
    """The skeleton with limits, if it has none, and with angles locked that move no point.

    Args:
        skeleton: any; without any finite limit it gets those of `with_limits`.
        rigging: the points.
        lever: metres per radian; what moves no point by more is locked at zero, or at the limit that is nearest.
    """
    if not np.isfinite(skeleton.lower[1:]).any() and not np.isfinite(skeleton.upper[1:]).any():
        skeleton = with_limits(skeleton)
    lower, upper = skeleton.lower.copy(), skeleton.upper.copy()
    rest = skeleton.rest_positions
    at = rest[rigging.joints] + rigging.offsets
    below = skeleton.is_ancestor[:, rigging.joints]
    for j in range(1, len(skeleton)):
        arms = at[below[j]] - rest[j]
        reach = np.linalg.norm(np.cross(np.eye(3)[:, None], arms[None]), axis=-1).max(axis=1, initial=0.0)
        still = reach < lever
        lower[j, still] = upper[j, still] = np.clip(0.0, skeleton.lower[j], skeleton.upper[j])[still]
    return replace(skeleton, lower=lower, upper=upper)


def _chain(skeleton: Skeleton, rigging: Rigging, options: SkeletonFitOptions) -> Chain:
    rest, prior = _rest(skeleton, options)
    return make_chain(skeleton, rigging.joints, rigging.offsets, rest, prior)


def _rest(skeleton: Skeleton, options: SkeletonFitOptions) -> tuple[FloatArray, FloatArray]:
    rest = np.clip(np.zeros((len(skeleton), 3)), skeleton.lower, skeleton.upper)
    return rest, np.full(rest.shape, options.rest_spread**-2.0)


def _jerkiness(chain: Chain, options: SkeletonFitOptions) -> FloatArray:
    out = np.full(len(chain.above), options.angular_acceleration**2)
    out[:3] = options.root_acceleration**2
    return out


def _known(points_world: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray]:
    points = np.ascontiguousarray(points_world)  # of one layout, or everything is compiled for each
    known = np.asarray(np.isfinite(points).all(axis=-1))
    return np.where(known[..., None], points, 0.0), np.where(known, sigma**-2.0, 0.0)


def _enough(chain: Chain) -> int:
    """Number of points that are needed to place the body for the first time."""
    return max(3, len(chain.carrier) // 2)


def _tracked(
    chain: Chain, points_world: FloatArray, sigma: float, fps: float, options: SkeletonFitOptions
) -> tuple[Pose, BoolArray]:
    """The pose of every frame, and (T,) where the body was lost."""
    targets, information = _known(points_world, sigma)
    count = np.count_nonzero(information, axis=1)
    wanted = min(_enough(chain), int(count.max(initial=0)))
    if wanted < 3:
        raise MuybridgeError(
            "no frame has three of the skeleton's points, so the body has no place; check the points' names and units"
        )
    first = int(np.argmax(count >= wanted))
    state = _begun(chain, targets[first], information[first], options)
    poses = tuple(np.repeat(a[None], len(targets), axis=0) for a in state[:3])
    lost = np.zeros(len(targets), dtype=np.bool_)
    at = first + 1
    patience = 0
    while at < len(targets):
        later = slice(at, None)
        here = tuple(p[later] for p in poses)
        at += track(
            chain, *state, targets[later], information[later], 1 / fps, _jerkiness(chain, options), options.student_dof,
            options.iterations, patience, *here,
        )  # fmt: skip
        if at < len(targets):
            state, lost[at] = _recovered(chain, state, targets[at], information[at], options)
            for pose, value in zip(poses, state[:3], strict=True):
                pose[at] = value
            patience = 0 if lost[at] else _PATIENCE
            at += 1
    return Pose(*poses), lost


def _recovered(
    chain: Chain, state: State, targets: FloatArray, information: FloatArray, options: SkeletonFitOptions
) -> tuple[State, bool]:
    """Re-initialise the state from one frame if that at most halves the outliers; returns whether it did."""
    _, far = count_far(chain, *state[:3], targets, information)
    new = _begun(chain, targets, information, options)
    if 2 * count_far(chain, *new[:3], targets, information)[1] > far:
        return state, False
    return new, True


def _cuts(chain: Chain, pose: Pose, lost: BoolArray, fps: float, top_speed: float = 12.0) -> list[int]:
    """Frames at which the take jumps: the body was lost, and a quarter of its points move faster than any person."""
    at = landmarks_of(chain, pose.root, pose.turn, pose.angles)
    frames = np.flatnonzero(lost)
    frames = frames[frames > 0]
    way = np.quantile(np.linalg.norm(at[frames] - at[frames - 1], axis=-1), 0.75, axis=-1)
    return [int(t) for t in frames[way * fps > top_speed]]


def _begun(chain: Chain, targets: FloatArray, information: FloatArray, options: SkeletonFitOptions) -> State:
    """The first frame, without a prediction: the best of several headings."""
    j_count, n = len(chain.parents), len(chain.above)
    angles = np.zeros((j_count, 3))
    angles[chain.open_joint, chain.open_axis] = np.clip(0.0, chain.lower, chain.upper)
    upright = landmarks_of(chain, np.zeros((1, 3)), np.eye(3)[None], angles[None])[0]
    known = information > 0
    source, target = upright[known], targets[known]
    middle, place = source.mean(axis=0), target.mean(axis=0)
    best = kabsch(source - middle, target - place, np.ones(len(source)))
    starts = [best] + [best @ exp_so3(np.array([0, 0, a])) for a in (np.pi / 2, np.pi, -np.pi / 2)]
    solved = []
    for turn in starts:
        state = (place - turn @ middle, turn.copy(), angles.copy())
        settle(chain, *state, targets, information, 0.0, 40)
        solved.append((settle(chain, *state, targets, information, options.student_dof, 20), state))
    root, turn, angles = min(solved, key=lambda s: s[0])[1]
    spread = np.zeros((n, 3))
    spread[:3, 0], spread[3:, 0] = 0.01**2, 0.1**2
    spread[:3, 2], spread[3:, 2] = options.root_velocity**2, options.angular_velocity**2
    return root, turn, angles, np.zeros(n), spread


def take_problem(
    skeleton: Skeleton,
    rigging: Rigging,
    points_world: FloatArray,
    sigma: float,
    fps: float,
    options: SkeletonFitOptions,
) -> Problem:
    targets, information = _known(points_world, sigma)
    rest, prior = _rest(skeleton, options)
    size = 6 + 3 * len(skeleton)
    acceleration = np.full(size, (fps**2 / options.angular_acceleration) ** 2)
    acceleration[:3] = (fps**2 / options.root_acceleration) ** 2
    velocity = np.full(size, (fps / options.angular_velocity) ** 2)
    velocity[:3] = (fps / options.root_velocity) ** 2
    return Problem(
        skeleton=skeleton,
        landmark_joints=rigging.joints,
        landmark_offsets=rigging.offsets,
        targets=targets,
        information=information[..., None, None] * np.eye(3),
        rest=rest,
        prior=prior,
        acceleration=acceleration,
        velocity=velocity,
    )


def _student(square: FloatArray, student_dof: float) -> FloatArray:
    """Weights from squared distances in units of the variance."""
    return np.minimum((student_dof + 3) / (student_dof + square), 1.0) if student_dof > 0 else np.ones_like(square)


def weighed(problem: Problem, pose: Pose, sigma: float, options: SkeletonFitOptions) -> Problem:
    """The problem with robust weights taken at a pose."""
    error = landmark_positions(problem, pose) - problem.targets
    weight = _student(np.sum(error**2, axis=-1) / sigma**2, options.student_dof)
    known = problem.information[..., 0, 0] > 0
    return replace(problem, information=(known * weight / sigma**2)[..., None, None] * np.eye(3))


def _result(
    given: Skeleton, skeleton: Skeleton, chain: Chain, pose: Pose, points_world: FloatArray, fps: float, sigma: float,
    options: SkeletonFitOptions,
) -> SkeletonFit:  # fmt: skip
    rotations = rotations_of(chain, pose.turn, pose.angles)
    motion = Motion(given, fps, pose.root, continuous_quat(quat_from_rotation(rotations)))
    at = landmarks_of(chain, pose.root, pose.turn, pose.angles)
    residual = np.linalg.norm(at - points_world, axis=-1)
    weight = np.nan_to_num(_student(residual**2 / sigma**2, options.student_dof))
    return SkeletonFit(motion, pose.angles, at, residual, weight, sigma)
