"""One interface to all methods of inverse kinematics."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import LinearConstraint

from muybridge.arrays import FloatArray
from muybridge.geometry.ik.ccd_fabrik import cyclic_descent, fabrik, make_nodes
from muybridge.geometry.ik.jacobian import DAMPED, NULL_SPACE, PSEUDO_INVERSE, TRANSPOSE, follow_jacobian
from muybridge.geometry.ik.nonlinear import solve_nonlinear
from muybridge.geometry.ik.pose_prior import PosePrior, solve_with_prior
from muybridge.geometry.ik.tree import Goal, KinematicTree, errors, goal_arrays

_JACOBIAN = {"transpose": TRANSPOSE, "pseudo_inverse": PSEUDO_INVERSE, "damped": DAMPED, "null_space": NULL_SPACE}
METHODS = (*_JACOBIAN, "ccd", "fabrik", "nonlinear", "gmm_prior")
_FORMER_NAMES = {"programme": "nonlinear", "examples": "gmm_prior"}


@dataclass(frozen=True)
class IkOptions:
    """How inverse kinematics is solved.

    Attributes:
        iterations: at most; steps, sweeps or quasi-Newton iterations.
        position_tolerance: metres. orientation_tolerance: radians.
        damping: largest damping, in the Jacobian's unit, at a singularity.
        singular: smallest singular value below which damping sets in.
        step: metres, how far a goal is allowed to be in one step of the Jacobian methods.
        gain: of every joint's secondary goal, toward the preferred angle (`null_space`).
        gains: (N,) the same joint by joint, times `gain`; None: all one.
        patience: steps without progress until another start is tried. seed: of that.
        restarts: of `nonlinear`, from perturbed starts.
    """

    iterations: int = 300
    position_tolerance: float = 1e-4
    orientation_tolerance: float = 1e-3
    damping: float = 0.1
    singular: float = 0.1
    step: float = 0.4
    gain: float = 0.05
    gains: FloatArray | None = None
    patience: int = 8
    seed: int = 1
    restarts: int = 5


@dataclass(frozen=True, eq=False)
class IkResult:
    """A pose, and how well it meets the goals.

    Attributes:
        theta: (N,) radians, within the limits.
        position_error: (E,) metres, 0 where no position was asked for.
        orientation_error: (E,) radians.
        iterations: taken.
        success: whether every error is within its tolerance.
    """

    theta: FloatArray
    position_error: FloatArray
    orientation_error: FloatArray
    iterations: int
    success: bool


def solve_ik(
    tree: KinematicTree, goals: Sequence[Goal], start: FloatArray | None = None, method: str = "damped",
    options: IkOptions | None = None, constraint: LinearConstraint | None = None, prior: PosePrior | None = None,
) -> IkResult:  # fmt: skip
    """Angles that bring the effectors where they should be.

    Args:
        tree: chain or tree.
        goals: one per effector; out of reach, the least sum of squares is looked for.
        start: (N,) radians, clipped to the limits; the preferred angles if None.
        method: one of METHODS.
        options: see IkOptions.
        constraint: linear equations and inequalities between angles; `nonlinear` only.
        prior: of likely poses; `gmm_prior` needs it.

    Returns:
        An IkResult. No method ever leaves the limits.

    Raises:
        ValueError: an unknown method, or what the method does not take or lacks.
    """
    options = options or IkOptions()
    if method in _FORMER_NAMES:
        new = _FORMER_NAMES[method]
        warnings.warn(f"the method {method!r} is now called {new!r}", DeprecationWarning, stacklevel=2)
        method = new
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}: choose one of {', '.join(METHODS)}")
    if constraint is not None and method != "nonlinear":
        raise ValueError(f"{method!r} takes no constraint between angles: only 'nonlinear' does")
    if (prior is None) != (method != "gmm_prior"):
        raise ValueError("a prior goes with the method 'gmm_prior', and only with it")
    targets, links = goal_arrays(tree, goals), tree.links
    theta = tree.clipped(tree.preferred if start is None else start)
    near, straight = options.position_tolerance, options.orientation_tolerance
    if method in _JACOBIAN:
        gains = options.gain * (np.ones(len(tree)) if options.gains is None else np.asarray(options.gains))
        theta, count = follow_jacobian(
            links, targets, theta, _JACOBIAN[method], options.iterations, near, straight, options.damping,
            options.singular, options.step, np.asarray(tree.preferred, dtype=np.float64), gains, options.patience,
            options.seed,
        )  # fmt: skip
    elif method == "ccd":
        theta, count = cyclic_descent(
            links, targets, theta, options.iterations, near, straight, options.patience, options.seed
        )
    elif method == "fabrik":
        theta, count = fabrik(
            links, make_nodes(tree), targets, theta, options.iterations, near, straight, options.patience, options.seed
        )
    elif method == "nonlinear":
        theta, count = _from_several_starts(tree, goals, theta, options, constraint)
    else:
        assert prior is not None
        theta, count = solve_with_prior(tree, targets, theta, prior, options.iterations, near, straight)
    return _judged(tree, goals, theta, count, options)


def _judged(tree: KinematicTree, goals: Sequence[Goal], theta: FloatArray, count: int, options: IkOptions) -> IkResult:
    place, turn = np.zeros(len(goals)), np.zeros(len(goals))
    errors(tree.links, goal_arrays(tree, goals), theta, place, turn)
    good = place.max() <= options.position_tolerance and turn.max() <= options.orientation_tolerance
    return IkResult(theta, place, turn, int(count), bool(good))


def _from_several_starts(
    tree: KinematicTree,
    goals: Sequence[Goal],
    theta: FloatArray,
    options: IkOptions,
    constraint: LinearConstraint | None,
) -> tuple[FloatArray, int]:
    """The best of several starts, since a quasi-Newton method ends in local minima."""
    rng = np.random.default_rng(options.seed)
    targets = goal_arrays(tree, goals)
    tolerance = 0.01 * min(options.position_tolerance, options.orientation_tolerance)
    best, least, total = theta, np.inf, 0
    place, turn = np.zeros(len(goals)), np.zeros(len(goals))
    for k in range(options.restarts + 1):
        reach = np.minimum(tree.upper - tree.lower, 2 * np.pi)
        start = tree.clipped(
            theta + min(0.1 * 2.0 ** (k - 1), 1.0) * (k > 0) * reach * rng.uniform(-0.5, 0.5, len(tree))
        )
        found, count = solve_nonlinear(tree, targets, start, options.iterations, tolerance, constraint)
        total += count
        value = errors(tree.links, targets, found, place, turn)
        if value < least:
            best, least = found, value
        if place.max() <= options.position_tolerance and turn.max() <= options.orientation_tolerance:
            break
    return best, total
