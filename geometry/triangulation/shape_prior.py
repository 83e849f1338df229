"""A statistical model of one person's landmarks, learned from the take, and points that it improves.

A landmark that many cameras see needs no prior. Where people occlude each other, two views remain, which cannot reveal
a gross error, or one, which gives no depth. The body is known from the rest of the take: in its own frame, its
landmarks x lie near a mean shape plus a few modes of motion of this person,

    x = c + R (mean + B a + e),   a ~ t(1),   e_j ~ t(tau_j),

and the remaining deviation tau states how well the other landmarks predict one: poorly for a wrist, which moves freely,
well for a hip. B and tau are estimated from the covariance of consecutive frames, which is free of noise that is
independent between frames. Every frame is then fitted to the pixels themselves with the robust weights of the
triangulation, so that single views contribute as well. Both priors are Student's t, and where three cameras agree on a
point the fit starts there: a pose that occurs only once in the take is improbable, but not rejected.

Source: D. Rubin, D. Thayer, "EM algorithms for ML factor analysis", Psychometrika 47, 1982 (the model).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.robust import MAD_SIGMA, row_median
from muybridge.geometry.numerics.rotations import kabsch
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation._kernel import Limits
from muybridge.geometry.triangulation.multiview import TriangulateOptions, Triangulation, limits_of, views_of

# Minimum number of frames and landmarks from which a body is learned.
_LEAST_FRAMES, _LEAST_LANDMARKS = 30, 8
# A landmark that two cameras see in fewer frames than this, or in less than this share of the frames in which the body
# is learned, is not learned: its model would place it with certainty where it was last seen. Its deviation from the
# prediction is set to `_FREE`, metres.
_LEAST_SHOWN, _SHARE_SHOWN, _FREE = 15, 0.1, 0.3
_CHUNK = 256
# Factor by which a mode's eigenvalue has to exceed the mean eigenvalue of noise in products of independent samples.
_NOISE_EDGE = 4.0


@dataclass(frozen=True)
class PosePriorOptions:
    """Options of the shape prior.

    Attributes:
        enabled: whether the prior is used at all.
        most_ways: maximum number of modes of motion.
        least_tau: smallest deviation of a landmark from its prediction, metres.
        rounds: number of times the body is learned and fitted.
        steps: Gauss-Newton steps per frame.
        one_view: largest distance, in frames, from a frame with two views at which a single view is used.
        enough: landmarks seen by at least this many cameras keep their triangulated point, or its absence.
    """

    enabled: bool = True
    most_ways: int = 12
    least_tau: float = 0.004
    rounds: int = 2
    steps: int = 4
    one_view: int = 30
    enough: int = 3


@dataclass(frozen=True)
class PosePrior:
    """The body of a take: `mean` (J, 3) metres, modes `ways` (J, 3, K) scaled to unit variance, `tau` (J,) metres."""

    mean: FloatArray
    ways: FloatArray
    tau: FloatArray


@dataclass
class _Poses:
    """The pose in every frame: R (T, 3, 3), c (T, 3) metres, a (T, K)."""

    rotation: FloatArray
    center: FloatArray
    share: FloatArray


def apply_pose_prior(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    landmarks: LandmarkSet,
    fps: float,
    found: Triangulation,
    triangulate: TriangulateOptions | None = None,
    options: PosePriorOptions | None = None,
) -> Triangulation:
    """Refine triangulated points with the shape prior of the person.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person; NaN where missing.
        variance_px2: (C, T, J) px^2.
        landmarks: the J landmarks.
        fps: frames per second.
        found: the triangulation of these points.
        triangulate: the options of that triangulation.
        options: see `PosePriorOptions`.

    Returns:
        As `found`, with points that only one camera sees where two cameras saw the person shortly before or after, for
        landmarks that the take shows often enough. Unchanged where the take is too short, or too little of the person
        is visible, to learn a body from.
    """
    options = options or PosePriorOptions()
    triangulate = triangulate or TriangulateOptions()
    known = np.isfinite(found.points_world).all(-1)
    count = known.shape[1]
    full = known.sum(1) >= max(6, 0.5 * count)
    if not options.enabled or full.sum() < _LEAST_FRAMES or count < _LEAST_LANDMARKS:
        return found
    points = Points3D(landmarks, found.points_world, found.covariance_world, found.residual_px, found.inlier, fps)
    start = smooth_points(points, SmoothOptions(max_gap=np.inf, extrapolate=True)).points_world
    start = np.where(np.isfinite(start), start, np.nanmedian(start, axis=1, keepdims=True))
    if not np.isfinite(start).all():
        return found
    sight = _sight_of(cameras, points_px, variance_px2, found, triangulate)
    reliable = np.where((found.inlier.sum(0) >= 3)[..., None], found.points_world, np.nan)
    learned = _learnable(found.points_world, full)
    poses: _Poses | None = None
    result = start
    for _ in range(options.rounds):
        prior, poses = learn_prior(found.points_world, found.covariance_world, start, full, learned, poses, options)
        result, covariance, inlier = _fit_frames(prior, poses, sight, reliable, options.steps)
    keep = _worth_keeping(inlier, full, learned, options)
    result = np.where(keep[..., None], result, np.nan)
    settled = np.isfinite(np.asarray(variance_px2)).sum(0) >= options.enough
    result = np.where(settled[..., None], found.points_world, result)
    covariance = np.where(settled[..., None, None], found.covariance_world, covariance)
    inlier = np.where(settled[..., None], np.moveaxis(found.inlier, 0, -1), inlier)
    keep |= settled
    residual = np.linalg.norm(cameras.project(result) - np.asarray(points_px, dtype=np.float64), axis=-1)
    residual[~np.isfinite(np.asarray(variance_px2, dtype=np.float64))] = np.nan
    return replace(
        found, points_world=result, covariance_world=np.where(keep[..., None, None], covariance, np.nan),
        residual_px=residual, inlier=np.moveaxis(inlier, -1, 0) & keep,
    )  # fmt: skip


def _learnable(raw: FloatArray, full: BoolArray) -> BoolArray:
    """(J,) landmarks that the take shows often enough to learn where they are on the body."""
    shown = np.isfinite(raw[full]).all(-1).sum(0)
    return np.asarray(shown >= max(_LEAST_SHOWN, _SHARE_SHOWN * full.sum()))


def _worth_keeping(inlier: BoolArray, full: BoolArray, learned: BoolArray, options: PosePriorOptions) -> BoolArray:
    """(T, J) points that two cameras agree on, or one camera near frames in which the whole person is known."""
    frames = np.arange(len(full))
    at = np.flatnonzero(full)
    following = np.minimum(np.searchsorted(at, frames), len(at) - 1)
    before = np.maximum(following - 1, 0)
    away = np.minimum(np.abs(at[following] - frames), np.abs(at[before] - frames))
    counted = inlier.sum(-1)
    someone = (counted > 0).sum(1) >= 4
    one = (counted >= 1) & (away <= options.one_view)[:, None] & someone[:, None] & learned
    return np.asarray((counted >= 2) | one)


@dataclass(frozen=True)
class _Sight:
    """The 2D points: poses (C, 3, 4), seen (T, J, C, 2) normalised, info (T, J, C), zero where there is no point."""

    poses: FloatArray
    seen: FloatArray
    info: FloatArray
    limits: Limits

    def part(self, rows: slice) -> _Sight:
        return replace(self, seen=self.seen[rows], info=self.info[rows])


def _sight_of(
    cameras: CameraGroup, points_px: ArrayLike, variance_px2: ArrayLike, found: Triangulation,
    triangulate: TriangulateOptions,
) -> _Sight:  # fmt: skip
    views, info = views_of(cameras, points_px, variance_px2, found, triangulate)
    shape = (*found.points_world.shape[:2], len(cameras))
    return _Sight(cameras.cam_from_world, views.seen.reshape(*shape, 2), info.reshape(shape),
                  limits_of(views, triangulate))  # fmt: skip


def learn_prior(
    raw: FloatArray, covariance: FloatArray, smooth: FloatArray, full: BoolArray, learned: BoolArray,
    poses: _Poses | None, options: PosePriorOptions,
) -> tuple[PosePrior, _Poses]:  # fmt: skip
    """Learn the body that a take shows.

    Args:
        raw: (T, J, 3) points of the single frames, metres, NaN where unknown.
        covariance: (T, J, 3, 3) of `raw`, square metres.
        smooth: (T, J, 3) the points smoothed over time, without gaps.
        full: (T,) frames in which enough landmarks are known to learn from.
        learned: (J,) landmarks to learn; the others are left free.
        poses: pose in every frame, if it is known better than from `smooth`.
        options: see `PosePriorOptions`.

    Returns:
        The body and its pose in each frame, with all mode coefficients zero.
    """
    noise2 = np.trace(covariance, axis1=-2, axis2=-1) / 3
    usual = np.nan_to_num(row_median(np.where(full[:, None], noise2, np.nan).T, 1), nan=1e-3)
    off = np.linalg.norm(raw - smooth, axis=-1)
    fine = np.isfinite(off) & (off < 4 * np.sqrt(3 * np.maximum(noise2, usual)))
    points = np.where(fine[..., None], raw, smooth)
    tau = np.full(raw.shape[1], 0.03)
    mean = _centre(smooth[np.flatnonzero(full)[0]])
    rotation, center = (poses.rotation, poses.center) if poses else _align(mean, smooth, 1 / (tau**2 + usual))
    own = raw
    for k in range(1 if poses else 4):
        if k:
            rotation, center = _align(mean, smooth, 1 / (tau**2 + usual))
        own = np.einsum("tba,tjb->tja", rotation, points - center[:, None])
        mean = own[full].mean(axis=0)
        tau = np.maximum(MAD_SIGMA * np.median(np.linalg.norm(own[full] - mean, axis=-1), axis=0) / 1.54, 0.005)
    ways, tau = _ways(np.where(learned[:, None], own - mean, 0.0), full, usual, options)
    tau[~learned] = _FREE
    return PosePrior(mean, ways, tau), _Poses(rotation, center, np.zeros((len(raw), ways.shape[-1])))


def _ways(
    off: FloatArray, full: BoolArray, noise2: FloatArray, options: PosePriorOptions
) -> tuple[FloatArray, FloatArray]:
    """(J, 3, K) modes and (J,) remaining deviation, from the deviations (T, J, 3) of consecutive frames."""
    frames, landmarks = off.shape[:2]
    pairs = np.flatnonzero(full[1:] & full[:-1])
    flat = off.reshape(frames, -1)
    spread = np.sqrt(np.median(flat[full] ** 2, axis=0)) * MAD_SIGMA
    flat = np.clip(flat, -5 * spread - 0.01, 5 * spread + 0.01)
    shared = flat[pairs].T @ flat[pairs + 1] / max(len(pairs), 1)
    shared = 0.5 * (shared + shared.T)
    values, vectors = np.linalg.eigh(shared)
    edge = _NOISE_EDGE * float(np.mean(noise2)) * np.sqrt(flat.shape[1] / max(len(pairs), 1))
    chosen = np.flatnonzero(values > edge)[::-1][: options.most_ways]
    ways = vectors[:, chosen] * np.sqrt(values[chosen])
    left = np.diag(shared) - np.sum(ways**2, axis=1)
    tau2 = left.reshape(landmarks, 3).mean(1) + noise2 * np.sqrt(2 / (3 * max(len(pairs), 1)))
    return ways.reshape(landmarks, 3, -1), np.sqrt(np.maximum(tau2, options.least_tau**2))


def _centre(points: FloatArray) -> FloatArray:
    return np.asarray(points - points.mean(axis=-2, keepdims=True))


def _align(mean: FloatArray, points: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, 3, 3) and places (T, 3) that bring `mean` (J, 3) onto points (T, J, 3) (Kabsch 1976)."""
    share = weight / weight.sum()
    middle, centers = share @ mean, np.einsum("j,tja->ta", share, points)
    rotation = kabsch(mean - middle, points - centers[:, None], share)
    return rotation, centers - np.einsum("tab,b->ta", rotation, middle)


def _fit_frames(
    prior: PosePrior, poses: _Poses, sight: _Sight, reliable: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Points (T, J, 3), covariance (T, J, 3, 3) and inliers (T, J, C); updates `poses` in place."""
    parts = []
    for begin in range(0, len(poses.center), _CHUNK):
        rows = slice(begin, begin + _CHUNK)
        piece = _Poses(poses.rotation[rows], poses.center[rows], poses.share[rows])
        parts.append(_fit_chunk(prior, piece, sight.part(rows), reliable[rows], steps))
        poses.rotation[rows], poses.center[rows], poses.share[rows] = piece.rotation, piece.center, piece.share
    points, covariance, inlier = (np.concatenate(p) for p in zip(*parts, strict=True))
    return points, covariance, inlier


# Standard deviation of the initial pose: metres and radians.
_START = np.array([0.2, 0.2, 0.2, 0.3, 0.3, 0.3])


def _fit_chunk(
    prior: PosePrior, poses: _Poses, sight: _Sight, reliable: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray, BoolArray]:
    ways = prior.ways.shape[-1]
    eye = np.eye(3)
    started = poses.center.copy()
    points: FloatArray = np.empty(0)
    spread: FloatArray
    spread = alone = design = tau2 = weight = np.empty(0)
    for k in range(steps):
        shape = np.einsum("tab,jb->tja", poses.rotation, prior.mean)
        shape += np.einsum("tab,jbk,tk->tja", poses.rotation, prior.ways, poses.share)
        on_body = poses.center[:, None] + shape
        points = points if k else np.asarray(np.where(np.isfinite(reliable), reliable, on_body), dtype=np.float64)
        tau2 = (prior.tau**2 * _wider(np.sum((points - on_body) ** 2, axis=-1) / prior.tau**2, 3))[..., None, None]
        precision = np.concatenate([np.tile(_START**-2.0, (len(shape), 1)), 1 / _wider(poses.share**2, 1)], axis=1)
        # A prediction is not the point itself: in the first step its uncertainty is added to that of the pixels.
        doubt = prior.tau * (np.isnan(reliable[..., 0]) & (k == 0))
        weight, info, pull = _evidence(points, sight, doubt)
        soften = _inverse(eye + tau2 * info)
        worth, wanted = soften @ info, np.einsum("tjab,tjb->tja", soften, pull)
        design = np.empty((*shape.shape, 6 + ways))
        design[..., :3] = eye
        design[..., 3:6] = _minus_cross(shape)
        design[..., 6:] = np.einsum("tab,jbk->tjak", poses.rotation, prior.ways)
        flat = design.reshape(len(shape), -1, 6 + ways)
        weighted = (worth @ design).reshape(flat.shape)
        normal = np.swapaxes(flat, 1, 2) @ weighted + precision[:, :, None] * np.eye(6 + ways)
        missing = wanted - np.einsum("tjab,tjb->tja", worth, on_body)
        gradient = np.einsum("tnk,tn->tk", flat, missing.reshape(len(shape), -1))
        gradient[:, :3] += (started - poses.center) * precision[:, :3]
        gradient[:, 6:] -= poses.share * precision[:, 6:]
        spread = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        step = np.einsum("tkl,tl->tk", spread, gradient)
        poses.center, poses.share = poses.center + step[:, :3], poses.share + step[:, 6:]
        poses.rotation = _turns(step[:, 3:6]) @ poses.rotation
        body = on_body + np.einsum("tjak,tk->tja", design, step)
        alone = tau2 * soften
        points = np.einsum("tjab,tjb->tja", alone, pull + body / tau2[..., 0])
    share = alone / tau2
    through = share @ design
    covariance = alone + through @ spread[:, None] @ np.swapaxes(through, -1, -2)
    return points, covariance, weight > 0.5


def _wider(off2: FloatArray, dimensions: int, student_dof: float = 4.0) -> FloatArray:
    """Factor by which Student's t widens a variance at a squared deviation of `off2` variances."""
    return np.maximum((student_dof + off2) / (student_dof + dimensions), 1.0)


def _evidence(points: FloatArray, sight: _Sight, tau: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Evidence of the pixels near points (T, J, 3).

    Returns weights (T, J, C), information (T, J, 3, 3), and the information times the observed point (T, J, 3).
    """
    turned = np.einsum("cab,tjb->tjca", sight.poses[:, :, :3], points) + sight.poses[:, :, 3]
    depth = np.where(turned[..., 2] > 0.05, turned[..., 2], np.inf)
    view = turned[..., :2] / depth[..., None]
    off = np.nan_to_num(sight.seen - view)
    info = np.where(np.isfinite(depth), sight.info, 0.0)
    doubt = tau[..., None] ** 2 / depth**2
    u = np.sum(off**2, axis=-1) * info / (1 + doubt * info)
    weight = _weight(u, sight.limits) * (info > 0)
    slope = sight.poses[:, :2, :3] - view[..., None] * sight.poses[:, 2:3, :3]
    slope = slope / depth[..., None, None]
    worth = (weight * info)[..., None, None] * slope
    total = np.einsum("tjcia,tjcib->tjab", worth, slope)
    pull = np.einsum("tjcia,tjci->tja", worth, off) + np.einsum("tjab,tjb->tja", total, points)
    return weight, total, pull


def _inverse(a: FloatArray) -> FloatArray:
    """Inverse of symmetric positive definite (..., 3, 3) matrices, several times faster than numpy's."""
    first = np.cross(a[..., 1, :], a[..., 2, :])
    second = np.cross(a[..., 2, :], a[..., 0, :])
    third = np.cross(a[..., 0, :], a[..., 1, :])
    scale = np.sum(a[..., 0, :] * first, axis=-1)
    return np.asarray(np.stack([first, second, third], axis=-1) / scale[..., None, None])


def _weight(u: FloatArray, limits: Limits) -> FloatArray:
    """The derivative of the triangulation's robust loss."""
    v = 1 + u / limits.tail2
    right = np.exp(-0.5 * u)
    wrong = limits.kappa / v**1.5
    return np.asarray((right + wrong * 3 / (limits.tail2 * v)) / (right + wrong))


def _minus_cross(points: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices that map a small rotation vector to the displacement of points (..., 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, z, -y, -z, zero, x, y, -x, zero]
    return np.stack(rows, axis=-1).reshape(*x.shape, 3, 3)


def _turns(vector: FloatArray) -> FloatArray:
    """(T, 3, 3) rotations by vectors (T, 3) (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[:, None, None]
    cross = -_minus_cross(vector)
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.where(angle > 1e-8, np.sin(angle) / angle, 1.0)
        second = np.where(angle > 1e-8, (1 - np.cos(angle)) / angle**2, 0.5)
    return np.eye(3) + first * cross + second * (cross @ cross)
