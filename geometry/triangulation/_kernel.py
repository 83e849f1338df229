"""The compiled core of `muybridge.geometry.triangulation.multiview`: robust points from their rays.

All quantities are in normalised image coordinates (x/z, y/z); the caller handles pixels, lenses and options. Errors are
measured as `u`, the squared distance in the image in units of the 2D point's variance.

The loss is that of a 2D point which is either right (Gaussian of the stated variance) or wrong (anywhere, with a tail
that falls like a Student t of one degree of freedom in two dimensions):

    loss(u) = -2 log(exp(-u / 2) + kappa (1 + u / tail2)^(-3/2))

It is bounded enough that a wrong camera has no influence, and still increases, so that of two solutions the one with
the smaller outliers wins. Since it is concave in `u`, iteratively reweighted least squares descends on it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled, leaf

_BEHIND = 1e6  # u of a point that is not in front of a camera
_MIN_DEPTH = 1e-6
_MAX_ITERATIONS = 60  # rarely more than 10, but many near the end of a second solution


class Limits(NamedTuple):
    """The options in the kernel's units."""

    kappa: float  # of the loss
    tail2: float  # of the loss
    gate_u: float  # an inlier's u is at most this ...
    gate_px2: float  # ... and its squared distance at most this, px^2
    agree_u: float  # u up to which a camera counts as agreeing with a proposal
    min_sin2: float  # minimum squared sine of the widest angle between the rays of inliers
    min_views: int  # minimum number of inliers
    max_pairs: int  # maximum number of pairs that propose


class Rig(NamedTuple):
    """What is the same for all points."""

    poses: FloatArray  # (C, 3, 4) cam_from_world
    centers: FloatArray  # (C, 3)
    px2_per_unit2: FloatArray  # (C,) squared focal lengths
    pairs: IntArray  # (Q, 2) pairs of cameras in the order in which they propose


class Views(NamedTuple):
    """One landmark in one frame, as observed by the cameras."""

    poses: FloatArray  # (C, 3, 4) cam_from_world
    centers: FloatArray  # (C, 3)
    seen: FloatArray  # (C, 2) normalised image coordinates
    info: FloatArray  # (C,) inverse variance, normalised units; zero where the camera has no 2D point
    rays: FloatArray  # (C, 3) directions, of any length
    use: IntArray  # (n,) the cameras that have a 2D point


class Scratch(NamedTuple):
    """Memory that is reused for every point."""

    starts: FloatArray  # (2, 3) the two best proposals, then the points refined from them
    normal: FloatArray  # (3, 3)
    damped: FloatArray  # (3, 3)
    inverse: FloatArray  # (3, 3)
    gradient: FloatArray  # (3,)
    trial: FloatArray  # (3,)


@leaf
def _loss(u: float, limits: Limits) -> float:
    v = 1.0 + u / limits.tail2
    return -2.0 * math.log(math.exp(-0.5 * u) + limits.kappa / (v * math.sqrt(v)))


@leaf
def _weight(u: float, limits: Limits) -> float:
    """d loss / d u: the factor on a camera's equations."""
    v = 1.0 + u / limits.tail2
    right = math.exp(-0.5 * u)
    wrong = limits.kappa / (v * math.sqrt(v))
    return (right + wrong * 3.0 / (limits.tail2 * v)) / (right + wrong)


@leaf
def _error_u(views: Views, c: int, point: FloatArray) -> float:
    """Squared distance of the projection from the 2D point, in variances; `_BEHIND` if the point is behind."""
    p = views.poses[c]
    z = p[2, 0] * point[0] + p[2, 1] * point[1] + p[2, 2] * point[2] + p[2, 3]
    if z <= _MIN_DEPTH:
        return _BEHIND
    x = (p[0, 0] * point[0] + p[0, 1] * point[1] + p[0, 2] * point[2] + p[0, 3]) / z - views.seen[c, 0]
    y = (p[1, 0] * point[0] + p[1, 1] * point[1] + p[1, 2] * point[2] + p[1, 3]) / z - views.seen[c, 1]
    u: float = (x * x + y * y) * views.info[c]
    return u


@leaf
def score_of_point(views: Views, point: FloatArray, limits: Limits) -> tuple[float, int]:
    """Sum of the cameras' losses, and number of cameras that agree."""
    total = 0.0
    agree = 0
    for c in views.use:
        u = _error_u(views, c, point)
        total += _loss(u, limits)
        if u <= limits.agree_u:
            agree += 1
    return total, agree


@leaf
def _midpoint(views: Views, a: int, b: int, min_sin2: float, out: FloatArray) -> bool:
    """The point between two rays, weighted by depth; False if they are parallel or intersect behind a camera."""
    ray_a, ray_b = views.rays[a], views.rays[b]
    center_a, center_b = views.centers[a], views.centers[b]
    aa = ray_a[0] * ray_a[0] + ray_a[1] * ray_a[1] + ray_a[2] * ray_a[2]
    bb = ray_b[0] * ray_b[0] + ray_b[1] * ray_b[1] + ray_b[2] * ray_b[2]
    ab = ray_a[0] * ray_b[0] + ray_a[1] * ray_b[1] + ray_a[2] * ray_b[2]
    det = aa * bb - ab * ab
    if det <= min_sin2 * aa * bb:
        return False
    ra = 0.0
    rb = 0.0
    for k in range(3):
        d = center_b[k] - center_a[k]
        ra += d * ray_a[k]
        rb += d * ray_b[k]
    depth_a = (bb * ra - ab * rb) / det
    depth_b = (ab * ra - aa * rb) / det
    if depth_a <= _MIN_DEPTH or depth_b <= _MIN_DEPTH:
        return False
    # A pixel corresponds to a length that grows with depth: the nearer camera is more precise.
    weight_a = views.info[a] / (depth_a * depth_a)
    weight_b = views.info[b] / (depth_b * depth_b)
    for k in range(3):
        on_a = center_a[k] + depth_a * ray_a[k]
        on_b = center_b[k] + depth_b * ray_b[k]
        out[k] = (weight_a * on_a + weight_b * on_b) / (weight_a + weight_b)
    return True


@leaf
def inverse3(a: FloatArray, out: FloatArray) -> bool:
    """Inverse of a symmetric positive definite 3x3 matrix; False if it is singular."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    c01 = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    det = a[0, 0] * c00 + a[0, 1] * c01 + a[0, 2] * c02
    trace = a[0, 0] + a[1, 1] + a[2, 2]
    if not det > 1e-15 * trace * trace * trace:
        return False
    out[0, 0] = c00 / det
    out[0, 1] = c01 / det
    out[0, 2] = c02 / det
    out[1, 1] = (a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]) / det
    out[1, 2] = (a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]) / det
    out[2, 2] = (a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]) / det
    out[1, 0] = out[0, 1]
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    return True


@leaf
def normal_equations(
    views: Views, point: FloatArray, limits: Limits, normal: FloatArray, gradient: FloatArray
) -> float:
    """Gauss-Newton matrix and gradient at `point`, reweighted by the loss; returns the loss."""
    normal[:], gradient[:] = 0.0, 0.0
    total = 0.0
    for c in views.use:
        p = views.poses[c]
        z = p[2, 0] * point[0] + p[2, 1] * point[1] + p[2, 2] * point[2] + p[2, 3]
        if z <= _MIN_DEPTH:
            total += _loss(_BEHIND, limits)
            continue
        px = (p[0, 0] * point[0] + p[0, 1] * point[1] + p[0, 2] * point[2] + p[0, 3]) / z
        py = (p[1, 0] * point[0] + p[1, 1] * point[1] + p[1, 2] * point[2] + p[1, 3]) / z
        x = px - views.seen[c, 0]
        y = py - views.seen[c, 1]
        u = (x * x + y * y) * views.info[c]
        total += _loss(u, limits)
        w = _weight(u, limits) * views.info[c]
        for k in range(3):
            jx = (p[0, k] - px * p[2, k]) / z
            jy = (p[1, k] - py * p[2, k]) / z
            gradient[k] += w * (jx * x + jy * y)
            for m in range(k + 1):
                value = jx * (p[0, m] - px * p[2, m]) / z + jy * (p[1, m] - py * p[2, m]) / z
                normal[k, m] += w * value
    normal[0, 1] = normal[1, 0]
    normal[0, 2] = normal[2, 0]
    normal[1, 2] = normal[2, 1]
    return total


@leaf
def _refine(views: Views, point: FloatArray, limits: Limits, scratch: Scratch) -> float:
    """Damped Gauss-Newton on the robust loss, in place; returns the loss."""
    normal, damped, inverse = scratch.normal, scratch.damped, scratch.inverse
    gradient, trial = scratch.gradient, scratch.trial
    damping = 1e-6
    best = normal_equations(views, point, limits, normal, gradient)
    for _ in range(_MAX_ITERATIONS):
        for k in range(3):
            for m in range(3):
                damped[k, m] = normal[k, m]
            damped[k, k] += damping * (normal[0, 0] + normal[1, 1] + normal[2, 2])
        if not inverse3(damped, inverse):
            break
        decrease = 0.0
        for k in range(3):
            step = inverse[k, 0] * gradient[0] + inverse[k, 1] * gradient[1] + inverse[k, 2] * gradient[2]
            trial[k] = point[k] - step
            decrease += step * gradient[k]
        # Expected decrease of the loss, in squared sigmas. The last step is taken: rounding may decide which it is.
        if decrease < 1e-6:
            for k in range(3):
                point[k] = trial[k]
            break
        loss, _ = score_of_point(views, trial, limits)
        if loss <= best:
            for k in range(3):
                point[k] = trial[k]
            best = normal_equations(views, point, limits, normal, gradient)
            damping = max(damping * 0.1, 1e-9)
        else:
            damping *= 100.0
            if damping > 1e3:
                break
    return best


@leaf
def _widest_sin2(rays: FloatArray, use: IntArray) -> float:
    """Largest squared sine of the angle between two rays, found in two sweeps (linear in the number of cameras)."""
    first = use[0]
    widest = 0.0
    for _ in range(2):
        farthest = first
        for c in use:
            aa = 0.0
            bb = 0.0
            ab = 0.0
            for k in range(3):
                aa += rays[first, k] * rays[first, k]
                bb += rays[c, k] * rays[c, k]
                ab += rays[first, k] * rays[c, k]
            sin2 = 1.0 - ab * ab / (aa * bb)
            if sin2 > widest:
                widest = sin2
                farthest = c
        first = farthest
    return widest


@leaf
def _two_best_pairs(views: Views, pairs: IntArray, limits: Limits, scratch: Scratch) -> int:
    """Points of the two pairs of cameras with the best scores, into `starts`; returns their number."""
    starts, trial = scratch.starts, scratch.trial
    scores = (np.inf, np.inf)
    tried = 0
    for q in range(pairs.shape[0]):
        a = pairs[q, 0]
        b = pairs[q, 1]
        if views.info[a] <= 0.0 or views.info[b] <= 0.0:
            continue
        if tried >= limits.max_pairs:
            break
        if not _midpoint(views, a, b, limits.min_sin2, trial):
            continue
        tried += 1
        score, agree = score_of_point(views, trial, limits)
        if score < scores[0]:
            for k in range(3):
                starts[1, k], starts[0, k] = starts[0, k], trial[k]
            scores = (score, scores[0])
        elif score < scores[1]:
            for k in range(3):
                starts[1, k] = trial[k]
            scores = (scores[0], score)
        # As in RANSAC: enough pairs to include one of two right cameras with a probability of 0.999.
        share = agree / views.use.size
        if share >= 1.0 or (agree > 2 and tried * math.log(1.0 - share * share) <= -6.9):
            break
    return min(tried, 2)


@leaf
def _two_best_points(views: Views, rig: Rig, limits: Limits, scratch: Scratch) -> tuple[int, float]:
    """Put the best point first and its rival second in `starts`.

    Returns:
        Their number, and the probability of the rival relative to the best, 0 to 1.
    """
    starts = scratch.starts
    found = _two_best_pairs(views, rig.pairs, limits, scratch)
    if found == 0:
        return 0, 0.0
    loss = _refine(views, starts[0], limits, scratch)
    if found == 1 or views.use.size == 2:
        return 1, 0.0
    _, agree = score_of_point(views, starts[0], limits)
    if agree >= 3 and 2 * agree > views.use.size:
        return 1, 0.0  # more cameras agree than the two that can always be made to: no rival
    rival_loss = _refine(views, starts[1], limits, scratch)
    if rival_loss < loss:
        for k in range(3):
            starts[0, k], starts[1, k] = starts[1, k], starts[0, k]
    return 2, math.exp(-0.5 * abs(rival_loss - loss))


@leaf
def _solve_one(
    views: Views, rig: Rig, limits: Limits, scratch: Scratch, covariance: FloatArray, inlier: BoolArray
) -> bool:
    """One point, into `scratch.starts[0]`, with its covariance and inliers; returns False if there is none."""
    found, odds = _two_best_points(views, rig, limits, scratch)
    if found == 0:
        return False
    point, rival = scratch.starts[0], scratch.starts[1]
    count = 0
    chi2 = 0.0
    for c in views.use:
        u = _error_u(views, c, point)
        error_px2 = u / views.info[c] * rig.px2_per_unit2[c]
        inlier[c] = u < _BEHIND and u <= limits.gate_u and error_px2 <= limits.gate_px2
        if inlier[c]:
            chi2 += u * _weight(u, limits)
            views.use[count] = c
            count += 1
    if count < limits.min_views:
        return False
    agreeing = Views(views.poses, views.centers, views.seen, views.info, views.rays, views.use[:count])
    if _widest_sin2(agreeing.rays, agreeing.use) < limits.min_sin2:
        return False
    normal_equations(agreeing, point, limits, scratch.normal, scratch.gradient)
    if not inverse3(scratch.normal, covariance):
        return False
    # The stated variances count as four observations, since the residual of two cameras alone is not informative.
    factor = (4.0 + chi2) / (4.0 + 2.0 * count - 3.0)
    # Of two solutions that fit about equally well, either may be right: add the distance between them.
    doubt = odds / ((1.0 + odds) * (1.0 + odds))
    for k in range(3):
        for m in range(3):
            covariance[k, m] *= factor
            if found == 2:
                covariance[k, m] += doubt * (rival[k] - point[k]) * (rival[m] - point[m])
    return True


@compiled
def solve_points(
    rig: Rig, limits: Limits, seen: FloatArray, info: FloatArray, begin: int, end: int,
    points: FloatArray, covariances: FloatArray, inliers: BoolArray,
) -> None:  # fmt: skip
    """Robust points `begin` to `end`, into the result arrays, which must be filled with NaN and False.

    Args:
        rig: the cameras.
        limits: the options.
        seen: (N, C, 2) normalised image coordinates.
        info: (N, C) inverse variance in normalised units; zero where the camera has no 2D point.
        begin: first point.
        end: one past the last point.
        points: (N, 3) result.
        covariances: (N, 3, 3) result.
        inliers: (N, C) result.
    """
    cameras = rig.poses.shape[0]
    rays = np.empty((cameras, 3))
    use = np.empty(cameras, dtype=np.int64)
    square = np.empty((3, 3, 3))
    scratch = Scratch(np.empty((2, 3)), square[0], square[1], square[2], np.empty(3), np.empty(3))
    covariance = np.empty((3, 3))
    inlier = np.empty(cameras, dtype=np.bool_)
    for i in range(begin, end):
        n = 0
        inlier[:] = False
        for c in range(cameras):
            if info[i, c] > 0.0:
                use[n] = c
                n += 1
                p = rig.poses[c]
                for k in range(3):
                    rays[c, k] = p[0, k] * seen[i, c, 0] + p[1, k] * seen[i, c, 1] + p[2, k]
        if n < limits.min_views:
            continue
        views = Views(rig.poses, rig.centers, seen[i], info[i], rays, use[:n])
        if _solve_one(views, rig, limits, scratch, covariance, inlier):
            for k in range(3):
                points[i, k] = scratch.starts[0, k]
                for m in range(3):
                    covariances[i, k, m] = covariance[k, m]
            for c in range(cameras):
                inliers[i, c] = inlier[c]
