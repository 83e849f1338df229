"""The compiled core of `muybridge.geometry.triangulation`: one robust point from its rays, many times over.

Everything here works on normalised image coordinates (x/z, y/z); pixels, lenses and options are the caller's
business. Errors are measured as `u`, the squared distance on the image in units of the 2D point's variance.

The loss is that of a 2D point which is either right (Gaussian of the stated variance) or wrong (anywhere,
with a tail that falls like a Student t of one degree of freedom in two dimensions):

    loss(u) = -2 log(exp(-u / 2) + kappa (1 + u / tail2)^(-3/2))

It is bounded enough that a wrong camera does not pull, and yet grows, so that of two explanations the one
with the smaller outliers wins. Being concave in `u`, iteratively reweighted least squares descends on it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_BEHIND = 1e6  # u of a point that is not in front of a camera
_MIN_DEPTH = 1e-6
_STATUS_FEW, _STATUS_NARROW, _STATUS_DISAGREE, STATUS_OK = 0, 1, 2, 3


@njit(cache=True, nogil=True, error_model="numpy")
def _loss(u: float, kappa: float, tail2: float) -> float:
    v = 1.0 + u / tail2
    return -2.0 * math.log(math.exp(-0.5 * u) + kappa / (v * math.sqrt(v)))


@njit(cache=True, nogil=True, error_model="numpy")
def _weight(u: float, kappa: float, tail2: float) -> float:
    """d loss / d u: the factor by which a camera's equations are scaled."""
    v = 1.0 + u / tail2
    right = math.exp(-0.5 * u)
    wrong = kappa / (v * math.sqrt(v))
    return (right + wrong * 3.0 / (tail2 * v)) / (right + wrong)


@njit(cache=True, nogil=True, error_model="numpy")
def _image_error2(pose: Array, point: Array, seen: Array) -> float:
    """Squared distance of the projection to the 2D point, normalised units; negative if behind."""
    z = pose[2, 0] * point[0] + pose[2, 1] * point[1] + pose[2, 2] * point[2] + pose[2, 3]
    if z <= _MIN_DEPTH:
        return -1.0
    x = (pose[0, 0] * point[0] + pose[0, 1] * point[1] + pose[0, 2] * point[2] + pose[0, 3]) / z - seen[0]
    y = (pose[1, 0] * point[0] + pose[1, 1] * point[1] + pose[1, 2] * point[2] + pose[1, 3]) / z - seen[1]
    return x * x + y * y


@njit(cache=True, nogil=True, error_model="numpy")
def _score(
    poses: Array,
    seen: Array,
    info: Array,
    use: IntArray,
    n: int,
    point: Array,
    kappa: float,
    tail2: float,
    agree_u: float,
) -> tuple[float, int]:
    """Sum of the losses over the first `n` cameras of `use`, and how many of them agree."""
    total = 0.0
    agree = 0
    for i in range(n):
        c = use[i]
        e2 = _image_error2(poses[c], point, seen[c])
        u = _BEHIND if e2 < 0.0 else e2 * info[c]
        total += _loss(u, kappa, tail2)
        if u <= agree_u:
            agree += 1
    return total, agree


@njit(cache=True, nogil=True, error_model="numpy")
def _midpoint(
    center_a: Array,
    ray_a: Array,
    info_a: float,
    center_b: Array,
    ray_b: Array,
    info_b: float,
    min_sin2: float,
    out: Array,
) -> bool:
    """The point nearest to two rays, nearer to the surer one; False if they are parallel or meet behind."""
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
    # A pixel is a length that grows with depth: the nearer camera knows the place better.
    weight_a = info_a / (depth_a * depth_a)
    weight_b = info_b / (depth_b * depth_b)
    for k in range(3):
        on_a = center_a[k] + depth_a * ray_a[k]
        on_b = center_b[k] + depth_b * ray_b[k]
        out[k] = (weight_a * on_a + weight_b * on_b) / (weight_a + weight_b)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _inverse3(a: Array, out: Array) -> bool:
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


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(
    poses: Array,
    seen: Array,
    info: Array,
    use: IntArray,
    n: int,
    point: Array,
    kappa: float,
    tail2: float,
    normal: Array,
    gradient: Array,
) -> float:
    """Gauss-Newton's matrix and gradient at `point`, reweighted by the loss; returns the loss."""
    normal[:] = 0.0
    gradient[:] = 0.0
    total = 0.0
    for i in range(n):
        c = use[i]
        p = poses[c]
        z = p[2, 0] * point[0] + p[2, 1] * point[1] + p[2, 2] * point[2] + p[2, 3]
        if z <= _MIN_DEPTH:
            total += _loss(_BEHIND, kappa, tail2)
            continue
        px = (p[0, 0] * point[0] + p[0, 1] * point[1] + p[0, 2] * point[2] + p[0, 3]) / z
        py = (p[1, 0] * point[0] + p[1, 1] * point[1] + p[1, 2] * point[2] + p[1, 3]) / z
        x = px - seen[c, 0]
        y = py - seen[c, 1]
        u = (x * x + y * y) * info[c]
        total += _loss(u, kappa, tail2)
        w = _weight(u, kappa, tail2) * info[c]
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


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(
    poses: Array,
    seen: Array,
    info: Array,
    use: IntArray,
    n: int,
    point: Array,
    kappa: float,
    tail2: float,
    iterations: int,
    work: Array,
) -> float:
    """Damped Gauss-Newton on the robust loss, in place; returns the loss. `work` is (4, 3, 3) scratch."""
    normal, damped, inverse = work[0], work[1], work[2]
    gradient, trial, step = work[3, 0], work[3, 1], work[3, 2]
    damping = 1e-6
    best = _normal_equations(poses, seen, info, use, n, point, kappa, tail2, normal, gradient)
    for _ in range(iterations):
        for k in range(3):
            for m in range(3):
                damped[k, m] = normal[k, m]
            damped[k, k] += damping * (normal[0, 0] + normal[1, 1] + normal[2, 2])
        if not _inverse3(damped, inverse):
            break
        decrease = 0.0
        for k in range(3):
            step[k] = inverse[k, 0] * gradient[0] + inverse[k, 1] * gradient[1] + inverse[k, 2] * gradient[2]
            trial[k] = point[k] - step[k]
            decrease += step[k] * gradient[k]
        # The expected fall of the loss, in squared sigmas: below this, the point no longer moves visibly.
        if decrease < 1e-4:
            break
        loss, _ = _score(poses, seen, info, use, n, trial, kappa, tail2, 0.0)
        if loss <= best:
            for k in range(3):
                point[k] = trial[k]
            best = _normal_equations(poses, seen, info, use, n, point, kappa, tail2, normal, gradient)
            damping = max(damping * 0.1, 1e-9)
        else:
            damping *= 100.0
            if damping > 1e3:
                break
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _widest_sin2(rays: Array, use: IntArray, n: int) -> float:
    """Largest squared sine of the angle between two rays (found in two sweeps, so linear in cameras)."""
    first = use[0]
    widest = 0.0
    for _ in range(2):
        farthest = first
        for i in range(n):
            c = use[i]
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


@njit(cache=True, nogil=True, error_model="numpy")
def _two_best_pairs(
    poses: Array,
    centers: Array,
    seen: Array,
    info: Array,
    rays: Array,
    use: IntArray,
    n: int,
    pairs: IntArray,
    max_pairs: int,
    kappa: float,
    tail2: float,
    agree_u: float,
    min_sin2: float,
    starts: Array,
    trial: Array,
) -> int:
    """Points of the two pairs of cameras that all cameras like best, into `starts`; returns how many."""
    scores = (np.inf, np.inf)
    tried = 0
    found = 0
    for q in range(pairs.shape[0]):
        a = pairs[q, 0]
        b = pairs[q, 1]
        if info[a] <= 0.0 or info[b] <= 0.0:
            continue
        if tried >= max_pairs:
            break
        if not _midpoint(centers[a], rays[a], info[a], centers[b], rays[b], info[b], min_sin2, trial):
            continue
        tried += 1
        score, agree = _score(poses, seen, info, use, n, trial, kappa, tail2, agree_u)
        if score < scores[0]:
            starts[1, :] = starts[0]
            starts[0, :] = trial
            scores = (score, scores[0])
            found = min(found + 1, 2)
        elif score < scores[1]:
            starts[1, :] = trial
            scores = (scores[0], score)
            found = 2
        # As in RANSAC: enough pairs that one of two right cameras was among them, 999 times in 1,000.
        share = agree / n
        if share >= 1.0 or (agree > 2 and tried * math.log(1.0 - share * share) <= -6.9):
            break
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _solve_one(
    poses: Array,
    centers: Array,
    seen: Array,
    info: Array,
    rays: Array,
    use: IntArray,
    n: int,
    pairs: IntArray,
    limits: Array,
    starts: Array,
    work: Array,
    point: Array,
    covariance: Array,
    inlier: BoolArray,
) -> int:
    """One point from its `n` cameras; returns a status. `point`, `covariance`, `inlier` are filled if OK."""
    kappa, tail2, gate_u, gate_e2 = limits[0], limits[1], limits[2], limits[3]
    min_sin2, min_views, max_pairs, agree_u = limits[4], int(limits[5]), int(limits[6]), limits[7]
    found = _two_best_pairs(
        poses,
        centers,
        seen,
        info,
        rays,
        use,
        n,
        pairs,
        max_pairs,
        kappa,
        tail2,
        agree_u,
        min_sin2,
        starts,
        work[3, 1],
    )
    if found == 0:
        return _STATUS_NARROW
    best, rival = 0, -1
    loss = _refine(poses, seen, info, use, n, starts[0], kappa, tail2, 20, work)
    rival_loss = np.inf
    if found == 2 and n > 2:
        _, agree = _score(poses, seen, info, use, n, starts[0], kappa, tail2, agree_u)
        if agree < n:
            rival_loss = _refine(poses, seen, info, use, n, starts[1], kappa, tail2, 20, work)
            rival = 1
            if rival_loss < loss:
                best, rival = 1, 0
                loss, rival_loss = rival_loss, loss
    for k in range(3):
        point[k] = starts[best, k]
    views = 0
    chi2 = 0.0
    for i in range(n):
        c = use[i]
        e2 = _image_error2(poses[c], point, seen[c])
        u = e2 * info[c]
        inlier[c] = e2 >= 0.0 and u <= gate_u and e2 <= gate_e2 * limits[8 + c]
        if inlier[c]:
            chi2 += u * _weight(u, kappa, tail2)
            use[views] = c
            views += 1
    if views < min_views:
        return _STATUS_DISAGREE
    if _widest_sin2(rays, use, views) < min_sin2:
        return _STATUS_NARROW
    _normal_equations(poses, seen, info, use, views, point, kappa, tail2, work[0], work[3, 0])
    if not _inverse3(work[0], covariance):
        return _STATUS_NARROW
    # The stated variances count as four observations: with two cameras the residual alone says little.
    factor = (4.0 + chi2) / (4.0 + 2.0 * views - 3.0)
    # Two explanations that are about as good: the point may just as well be at the other one.
    odds = 0.0
    if rival >= 0:
        odds = math.exp(-0.5 * (rival_loss - loss))
    doubt = odds / ((1.0 + odds) * (1.0 + odds))
    for k in range(3):
        for m in range(3):
            covariance[k, m] *= factor
            if rival >= 0:
                covariance[k, m] += doubt * (starts[rival, k] - point[k]) * (starts[rival, m] - point[m])
    return STATUS_OK


@njit(cache=True, nogil=True, error_model="numpy")
def solve_points(
    poses: Array,
    centers: Array,
    seen: Array,
    info: Array,
    pairs: IntArray,
    limits: Array,
    begin: int,
    end: int,
    points: Array,
    covariances: Array,
    inliers: BoolArray,
    statuses: IntArray,
) -> None:
    """Robust points `begin` to `end`, into the arrays of results, which come filled with NaN and False.

    Args:
        poses: (C, 3, 4) cam_from_world.
        centers: (C, 3) camera centres.
        seen: (N, C, 2) normalised image coordinates.
        info: (N, C) one over the variance in normalised units; zero where the camera has no 2D point.
        pairs: (Q, 2) camera pairs in the order in which they are tried.
        limits: (8 + C,) kappa, tail2, gate on u, gate in px^2, squared sine of the least ray angle, least
            number of cameras, most pairs tried, u up to which a camera counts as agreeing, then for every
            camera one over its squared focal length.
        begin: first point.
        end: one past the last point.
        points: (N, 3) result.
        covariances: (N, 3, 3) result.
        inliers: (N, C) result.
        statuses: (N,) result.
    """
    cameras = poses.shape[0]
    rays = np.empty((cameras, 3))
    use = np.empty(cameras, dtype=np.int64)
    starts = np.empty((2, 3))
    work = np.empty((4, 3, 3))
    point = np.empty(3)
    covariance = np.empty((3, 3))
    inlier = np.empty(cameras, dtype=np.bool_)
    for i in range(begin, end):
        n = 0
        for c in range(cameras):
            inlier[c] = False
            if info[i, c] > 0.0:
                use[n] = c
                n += 1
                for k in range(3):
                    rays[c, k] = (
                        poses[c, 0, k] * seen[i, c, 0] + poses[c, 1, k] * seen[i, c, 1] + poses[c, 2, k]
                    )
        if n < 2 or n < limits[5]:
            statuses[i] = _STATUS_FEW
            continue
        statuses[i] = _solve_one(
            poses,
            centers,
            seen[i],
            info[i],
            rays,
            use,
            n,
            pairs,
            limits,
            starts,
            work,
            point,
            covariance,
            inlier,
        )
        if statuses[i] == STATUS_OK:
            points[i, :] = point
            covariances[i, :, :] = covariance
            inliers[i, :] = inlier
