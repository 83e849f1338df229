"""Inverse kinematics with a prior learned from motion: of all poses that meet the goals, a likely one.

The prior is a mixture of Gaussians over the joint angles. A pose is found by Gauss-Newton on the goals and the prior
together; the goals' standard deviation shrinks from step to step, so that they are met in the end and the prior
decides what they leave open.

Source of the idea: K. Grochow, S. L. Martin, A. Hertzmann, Z. Popovic, "Style-based inverse kinematics", 2004, with a
Gaussian process latent variable model; a mixture of full Gaussians is as smooth, needs no example at run time and is
evaluated in microseconds.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.ik.jacobian import equations, good_enough, rows_of
from muybridge.geometry.ik.tree import GoalArrays, KinematicTree, Links, errors
from muybridge.geometry.numerics._numba import compiled


@dataclass(frozen=True, eq=False)
class PosePrior:
    """A mixture of `K` Gaussians over `N` angles.

    Attributes:
        names: (N,) of the tree's hinges.
        means: (K, N) radians.
        precisions: (K, N, N) inverse covariances.
        log_scale: (K,) logarithm of each component's weight and normalisation.
    """

    names: tuple[str, ...]
    means: FloatArray
    precisions: FloatArray
    log_scale: FloatArray

    def log_density(self, theta: FloatArray) -> FloatArray:
        """(T, N) radians -> (T,)."""
        off = theta[:, None] - self.means
        return np.asarray(
            scipy.special.logsumexp(
                self.log_scale - 0.5 * np.einsum("tkn,knm,tkm->tk", off, self.precisions, off), axis=1
            )
        )

    def for_tree(self, tree: KinematicTree, free_spread: float = 0.5) -> "PosePrior":
        """The prior of a tree's hinges, matched by name: others are left out, unknown ones are free about their
        preferred angle.

        Raises:
            ValueError: the tree has no hinge that the prior knows.
        """
        here = [(i, self.names.index(n)) for i, n in enumerate(tree.names) if n in self.names]
        if not here:
            raise ValueError(
                f"none of the tree's hinges is known to the prior; it knows {', '.join(self.names[:6])}..."
            )
        mine, of_prior = np.array(here, dtype=np.intp).T
        k, n = len(self.means), len(tree)
        means, precisions = np.tile(tree.preferred, (k, 1)), np.tile(np.eye(n) / free_spread**2, (k, 1, 1))
        scales = np.empty(k)
        means[:, mine] = self.means[:, of_prior]
        for c in range(k):
            covariance = np.linalg.inv(self.precisions[c])[np.ix_(of_prior, of_prior)]
            precisions[c][np.ix_(mine, mine)] = np.linalg.inv(covariance)
            # What is left out is integrated out: the normalisation is that of what stays.
            whole = np.linalg.slogdet(self.precisions[c])[1]
            scales[c] = self.log_scale[c] - 0.5 * whole - 0.5 * np.linalg.slogdet(covariance)[1]
        return PosePrior(tree.names, means, precisions, scales)


def fit_prior(
    names: tuple[str, ...], theta: FloatArray, components: int = 12, floor: float = 0.05, seed: int = 0
) -> PosePrior:
    """A prior from examples, by expectation maximisation from k-means.

    Args:
        names: (N,) of the hinges.
        theta: (T, N) radians, poses well apart in time.
        components: of the mixture.
        floor: radians, added in square to every variance: examples never cover everything.
        seed: of the first centres.
    """
    rng = np.random.default_rng(seed)
    means = theta[rng.choice(len(theta), components, replace=False)]
    for _ in range(20):
        nearest = np.argmin(np.sum((theta[:, None] - means) ** 2, axis=-1), axis=1)
        means = np.stack(
            [theta[nearest == k].mean(axis=0) if (nearest == k).any() else means[k] for k in range(components)]
        )
    share = np.eye(components)[nearest]
    n = theta.shape[1]
    prior = None
    for _ in range(30):
        mass = share.sum(axis=0) + 1e-6
        means = share.T @ theta / mass[:, None]
        off = theta - means[:, None]
        covariance = np.swapaxes(off, 1, 2) @ (off * share.T[..., None]) / mass[:, None, None]
        covariance += np.eye(n) * floor**2
        precisions = np.linalg.inv(covariance)
        scale = np.log(mass / mass.sum()) - 0.5 * np.linalg.slogdet(covariance)[1]
        prior = PosePrior(names, means, precisions, scale)
        log = scale - 0.5 * np.sum((off @ precisions) * off, axis=2).T
        share = np.exp(log - scipy.special.logsumexp(log, axis=1, keepdims=True))
    assert prior is not None
    return prior


def save_prior(path: Path, prior: PosePrior) -> None:
    """Write a prior; single precision is enough."""
    np.savez_compressed(
        path, names=np.array(prior.names), means=prior.means.astype(np.float32),
        factors=np.linalg.cholesky(prior.precisions).astype(np.float32), log_scale=prior.log_scale,
    )  # fmt: skip


def load_prior(path: Path | None = None) -> PosePrior:
    """Read a prior; the project's own if None: of poses of the procedural motion generator, for `BODY`'s hinges."""
    with np.load(path or Path(__file__).with_name("pose_prior.npz")) as data:
        factors = data["factors"].astype(np.float64)
        names = tuple(str(n) for n in data["names"])
        precisions = factors @ np.swapaxes(factors, -1, -2)
        return PosePrior(names, data["means"].astype(np.float64), precisions, data["log_scale"])


@compiled
def likely_step(
    jacobian: FloatArray,
    wanted: FloatArray,
    theta: FloatArray,
    mean: FloatArray,
    precision: FloatArray,
    sigma: float,
    links: Links,
) -> FloatArray:
    """(N,) new angles: one Gauss-Newton step on goals and prior; angles pressed against a limit are held."""
    n = len(theta)
    matrix = jacobian.T @ jacobian / sigma**2 + precision
    slope = jacobian.T @ wanted / sigma**2 - precision @ (theta - mean)
    held = np.zeros(n, dtype=np.bool_)
    for j in range(n):
        held[j] = (theta[j] <= links.lower[j] and slope[j] < 0) or (theta[j] >= links.upper[j] and slope[j] > 0)
    out = theta.copy()
    for _ in range(4):
        some, right = matrix.copy(), slope.copy()
        for j in range(n):
            if held[j]:
                some[j, :], some[:, j] = 0.0, 0.0
                some[j, j], right[j] = 1.0, 0.0
        step = np.linalg.solve(some, right)
        largest = np.max(np.abs(step))
        if largest > 0.6:
            step *= 0.6 / largest
        over = False
        for j in range(n):
            out[j] = theta[j] + step[j]
            if out[j] < links.lower[j] or out[j] > links.upper[j]:
                out[j] = min(max(out[j], links.lower[j]), links.upper[j])
                if not held[j] and abs(out[j] - theta[j]) < 1e-12:
                    held[j] = over = True
        if not over:
            break
    return out


@compiled
def descend(
    links: Links, targets: GoalArrays, theta: FloatArray, mean: FloatArray, precision: FloatArray, iterations: int,
    near: float, straight: float, first_sigma: float,
) -> tuple[FloatArray, int, float]:  # fmt: skip
    """From one start with one component: angles, steps and the cost, goals at their last standard deviation."""
    e_count, m = len(targets.joint), rows_of(targets)
    jacobian, wanted = np.zeros((m, len(theta))), np.zeros(m)
    place, turn = np.zeros(e_count), np.zeros(e_count)
    sigma, value = first_sigma, errors(links, targets, theta, place, turn)
    best, least = theta.copy(), value
    for k in range(iterations):
        equations(links, targets, theta, 1.0, jacobian, wanted)
        theta = likely_step(jacobian, wanted, theta, mean, precision, sigma, links)
        value = errors(links, targets, theta, place, turn)
        if value < least:
            best, least = theta.copy(), value
        if good_enough(place, turn, near, straight):
            return theta, k + 1, float((theta - mean) @ precision @ (theta - mean))
        sigma = max(0.7 * sigma, 2e-5)
    return best, iterations, float(least / 1e-6 + (best - mean) @ precision @ (best - mean))


def solve_with_prior(
    tree: KinematicTree,
    targets: GoalArrays,
    theta: FloatArray,
    prior: PosePrior,
    iterations: int,
    near: float,
    straight: float,
) -> tuple[FloatArray, int]:
    """Angles and steps. Every component of the mixture is tried from its mean; the likeliest pose that meets the goals
    is taken, or the nearest to it."""
    prior = prior if prior.names == tree.names else prior.for_tree(tree)
    best, least, total = theta, np.inf, 0
    order: IndexArray = np.argsort(-prior.log_scale)
    for k in order:
        start = tree.clipped(prior.means[k])
        found, count, cost = descend(
            tree.links, targets, start, prior.means[k], prior.precisions[k], min(iterations, 60), near, straight, 0.1
        )
        total += count
        cost -= 2 * float(prior.log_scale[k])
        if cost < least:
            best, least = found, cost
    return best, total
