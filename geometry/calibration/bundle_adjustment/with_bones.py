"""Bundle adjustment over cameras and people: reprojection, and bones that keep their lengths.

Unknown are the cameras' poses (and, where wanted, a factor on each focal length), every landmark in every
frame, and one length for each bone. Landmarks of one frame hang together by the bones and no two frames do,
so the normal equations are reduced frame by frame (Schur complement) to those of the cameras and lengths.
Levenberg-Marquardt with Cauchy's loss; residuals are in standard deviations.

A pose is stored as rotation `R` and centre `c`, point in camera `y = R (x - c)`; increments are
`R <- exp(w) R`, `c <- c + dc`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import exp_so3, log_so3

_MIN_DEPTH = 1e-3
_POSE = 6
_PER_CAMERA = 7  # the pose and the logarithm of the focal factor


@dataclass(frozen=True)
class AdjustProblem:
    """What was seen, and how sure it is.

    Attributes:
        seen: (C, T, K, 2) undistorted normalised image coordinates; anything where `sigma_px` is not finite.
        focal_px: (C,) px per unit of `seen`.
        sigma_px: (C, T, K) standard deviation of each coordinate; NaN where nothing was seen.
        bones: (B, 2) indices into K.
        bone_sigma: (B,) in the unit of the start: how constant a length is in time.
        focal_sigma: standard deviation of the logarithm of a focal length about `focal_px`; 0 to hold it.
        pose_sigma: standard deviations of rotation (rad) and centre (m) about the start; None for no prior.
        prior_worth: how many frames count as one: errors are alike in neighbouring frames, so priors are weighed
            as if they had been seen in so many.
        loss_sigma: where Cauchy's loss bends, in standard deviations.
        bone_stiffness: (B,) lengths at the start over `bone_sigma`; `adjust` sets it.
    """

    seen: FloatArray
    focal_px: FloatArray
    sigma_px: FloatArray
    bones: IndexArray
    bone_sigma: FloatArray
    focal_sigma: float = 0.0
    pose_sigma: tuple[float, float] | None = None
    prior_worth: float = 1.0
    loss_sigma: float = 2.0
    bone_stiffness: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class AdjustState:
    """The unknowns.

    Attributes:
        rotations: (C, 3, 3) camera from world.
        centers: (C, 3).
        log_focal: (C,) logarithm of the factor on `focal_px`.
        points: (T, K, 3); NaN where unknown.
        lengths: (B,).
    """

    rotations: FloatArray
    centers: FloatArray
    log_focal: FloatArray
    points: FloatArray
    lengths: FloatArray


@dataclass(frozen=True)
class Adjusted:
    """A finished adjustment.

    Attributes:
        state: the unknowns.
        cost: half the sum of the losses.
        residual_px: (C, T, K) length of the reprojection error; NaN where nothing was seen.
        error_px: (C, T, K, 2) the same as vectors.
        covariance: (7C, 7C) of rotation (rad), centre, log focal of each camera, the gauge (where the whole
            lies, and its size) taken out so that the cameras as a whole neither move nor grow.
    """

    state: AdjustState
    cost: float
    residual_px: FloatArray
    error_px: FloatArray
    covariance: FloatArray


@dataclass
class _Normal:
    """Normal equations: of the frames' points (f), of everything else (g), and the residuals' weights."""

    hff: FloatArray  # (T, 3K, 3K)
    hfg: FloatArray  # (T, 3K, G)
    hgg: FloatArray  # (G, G)
    bf: FloatArray  # (T, 3K)
    bg: FloatArray  # (G,)
    jx: FloatArray  # (C, T, K, 2, 3), weighted by the square root of the loss' weight
    jg: FloatArray  # (C, T, K, 2, 7)
    residual: FloatArray  # (C, T, K, 2)


def usable_views(problem: AdjustProblem) -> BoolArray:
    """(T, K) whether two cameras or more see a landmark."""
    return np.asarray(np.isfinite(problem.sigma_px).sum(axis=0) >= 2)


def adjust(problem: AdjustProblem, start: AdjustState, iterations: int = 40, tolerance: float = 1e-5) -> Adjusted:
    """The most probable cameras and points.

    Args:
        problem: what was seen.
        start: where to begin; points that are NaN take no part.
        iterations: most of them.
        tolerance: relative decrease of the cost at which to stop.
    """
    known = np.isfinite(start.points).all(axis=-1) & usable_views(problem)
    problem = replace(
        problem,
        sigma_px=np.where(known[None], problem.sigma_px, np.nan),
        bone_stiffness=start.lengths / problem.bone_sigma,
    )
    start = replace(start, lengths=np.where(start.lengths > 0, start.lengths, 1.0))
    state = replace(start, points=np.where(known[..., None], start.points, 0.0))
    cost, damping = _cost(problem, state, state, known), 1e-3
    for _ in range(iterations):
        normal = _normal(problem, state, start, known)
        accepted = False
        for _ in range(8):
            trial = _stepped(state, normal, damping, known, problem)
            trial_cost = _cost(problem, trial, start, known)
            if trial_cost < cost:
                accepted = True
                break
            damping *= 6.0
        if not accepted:
            break
        gain = (cost - trial_cost) / cost
        state, cost, damping = trial, trial_cost, max(damping / 5.0, 1e-9)
        if gain < tolerance:
            break
    normal = _normal(problem, state, start, known)
    error = _reprojection(problem, state)[0]
    residual = np.linalg.norm(error, axis=-1)
    covariance = _covariance(problem, state, normal)
    points = np.where(known[..., None], state.points, np.nan)
    return Adjusted(replace(state, points=points), cost, residual, error, covariance)


def _reprojection(problem: AdjustProblem, state: AdjustState) -> tuple[FloatArray, FloatArray]:
    """(C, T, K, 2) error in px, NaN where not seen or behind the camera; (C, T, K, 3) points in camera axes."""
    y = np.einsum("cij,ctkj->ctki", state.rotations, state.points[None] - state.centers[:, None, None])
    z = np.where(y[..., 2:] > _MIN_DEPTH, y[..., 2:], np.nan)
    scale = np.exp(state.log_focal)[:, None, None, None]
    error = problem.focal_px[:, None, None, None] * (scale * y[..., :2] / z - problem.seen)
    return np.where(np.isfinite(problem.sigma_px)[..., None], error, np.nan), y


def _bones(problem: AdjustProblem, state: AdjustState, known: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(T, B) residuals in sigmas, (T, B, 3) derivative by the first end, (T, B) whether both ends are known.

    Lengths are compared as logarithms, so that the whole cannot gain by shrinking.
    """
    first, second = problem.bones[:, 0], problem.bones[:, 1]
    vector = state.points[:, first] - state.points[:, second]
    length = np.linalg.norm(vector, axis=-1)
    both = (known[:, first] & known[:, second] & (length > 1e-9)).astype(np.float64)
    length = np.where(both > 0, length, 1.0)
    stiffness = problem.bone_stiffness
    residual = stiffness * np.log(length / state.lengths) * both
    return residual, (stiffness * both / length**2)[..., None] * vector, both


def _cost(problem: AdjustProblem, state: AdjustState, start: AdjustState, known: BoolArray) -> float:
    k2 = problem.loss_sigma**2
    error, y = _reprojection(problem, state)
    seen = np.isfinite(problem.sigma_px)
    if (y[..., 2][seen] <= _MIN_DEPTH).all():
        return np.inf
    r2 = ((error / problem.sigma_px[..., None]) ** 2).sum(axis=-1)[seen]
    # A point behind a camera costs what an error of the whole image does.
    r2 = np.where(np.isfinite(r2), r2, 1e6)
    total = k2 * np.log1p(r2 / k2).sum()
    bone, _, _ = _bones(problem, state, known)
    total += k2 * np.log1p(bone**2 / k2).sum()
    prior, _ = _prior(problem, state, start)
    return float(0.5 * (total + (prior**2).sum()))


def _prior(problem: AdjustProblem, state: AdjustState, start: AdjustState) -> tuple[FloatArray, FloatArray]:
    """(C, 7) residuals of the priors on the cameras, and (7,) one over their standard deviations."""
    inverse = np.zeros(_PER_CAMERA)
    if problem.pose_sigma is not None:
        inverse[:3], inverse[3:6] = 1 / problem.pose_sigma[0], 1 / problem.pose_sigma[1]
    if problem.focal_sigma > 0:
        inverse[6] = 1 / problem.focal_sigma
    inverse *= np.sqrt(problem.prior_worth)
    turned = log_so3(state.rotations @ np.swapaxes(start.rotations, 1, 2))
    off = np.concatenate([turned, state.centers - start.centers, state.log_focal[:, None]], axis=1)
    return off * inverse, inverse


def _normal(problem: AdjustProblem, state: AdjustState, start: AdjustState, known: BoolArray) -> _Normal:
    """Normal equations at a state, losses turned into weights."""
    cameras, frames, count = problem.sigma_px.shape
    size = _PER_CAMERA * cameras + len(problem.bones)
    jx, jg, residual = _jacobians(problem, state)
    hff = np.zeros((frames, count, 3, count, 3))
    index = np.arange(count)
    hff[:, index, :, index, :] = np.moveaxis(np.einsum("ctkra,ctkrb->tkab", jx, jx), 1, 0)
    hfg = np.zeros((frames, count, 3, size))
    cross = np.einsum("ctkra,ctkrg->tkacg", jx, jg)
    hfg[..., : _PER_CAMERA * cameras] = cross.reshape(frames, count, 3, -1)
    hgg = np.zeros((size, size))
    bg = np.zeros(size)
    own = np.einsum("ctkra,ctkrb->cab", jg, jg)
    prior, inverse = _prior(problem, state, start)
    for c in range(cameras):
        at = slice(_PER_CAMERA * c, _PER_CAMERA * (c + 1))
        hgg[at, at] = own[c] + np.diag(inverse**2)
        bg[at] = prior[c] * inverse
    bg[: _PER_CAMERA * cameras] += np.einsum("ctkra,ctkr->ca", jg, residual).ravel()
    bf = np.einsum("ctkra,ctkr->tka", jx, residual)
    _add_bones(problem, state, known, hff, hfg, hgg, bf, bg)
    flat = 3 * count
    return _Normal(
        hff.reshape(frames, flat, flat), hfg.reshape(frames, flat, size), hgg, bf.reshape(frames, flat), bg,
        jx, jg, residual,
    )  # fmt: skip


def _jacobians(problem: AdjustProblem, state: AdjustState) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the weighted reprojection errors by points and by cameras, and the errors; zero where not seen."""
    error, y = _reprojection(problem, state)
    good = np.asarray(np.isfinite(error).all(axis=-1))
    r2 = ((error / problem.sigma_px[..., None]) ** 2).sum(axis=-1)
    weight = np.where(good, 1 / np.sqrt(1 + np.where(good, r2, 0.0) / problem.loss_sigma**2), 0.0)
    weight = weight / np.where(good, problem.sigma_px, 1.0)
    z = np.where(good, y[..., 2], 1.0)
    focal = problem.focal_px * np.exp(state.log_focal)
    gain = weight * focal[:, None, None] / z
    px, py = y[..., 0] / z, y[..., 1] / z
    by_y = np.zeros((*good.shape, 2, 3))
    by_y[..., 0, 0] = by_y[..., 1, 1] = gain
    by_y[..., 0, 2], by_y[..., 1, 2] = -gain * px, -gain * py
    jx = np.einsum("ctkra,cab->ctkrb", by_y, state.rotations)
    jg = np.empty((*good.shape, 2, _PER_CAMERA))
    # w x y: the columns of -[y]x
    jg[..., 0] = by_y[..., 2] * y[..., None, 1] - by_y[..., 1] * y[..., None, 2]
    jg[..., 1] = by_y[..., 0] * y[..., None, 2] - by_y[..., 2] * y[..., None, 0]
    jg[..., 2] = by_y[..., 1] * y[..., None, 0] - by_y[..., 0] * y[..., None, 1]
    jg[..., 3:6] = -jx
    free = 1.0 if problem.focal_sigma > 0 else 0.0
    jg[..., 6] = free * (weight * focal[:, None, None])[..., None] * np.stack([px, py], axis=-1)
    jg[~good] = 0.0
    return jx, jg, np.where(good[..., None], error, 0.0) * weight[..., None]


def _add_bones(
    problem: AdjustProblem,
    state: AdjustState,
    known: BoolArray,
    hff: FloatArray,
    hfg: FloatArray,
    hgg: FloatArray,
    bf: FloatArray,
    bg: FloatArray,
) -> None:
    """Add the bones' terms to the normal equations, in place."""
    residual, slope, both = _bones(problem, state, known)
    weight = both / (1 + residual**2 / problem.loss_sigma**2)
    pull = weight * residual
    stiffness = problem.bone_stiffness
    offset = hgg.shape[0] - len(problem.bones)
    for b, (i, j) in enumerate(problem.bones):
        u, w, k = slope[:, b], weight[:, b], stiffness[b]
        block = w[:, None, None] * u[:, :, None] * u[:, None, :]
        hff[:, i, :, i, :] += block
        hff[:, j, :, j, :] += block
        hff[:, i, :, j, :] -= block
        hff[:, j, :, i, :] -= block
        hfg[:, i, :, offset + b] -= k * w[:, None] * u
        hfg[:, j, :, offset + b] += k * w[:, None] * u
        bf[:, i] += pull[:, b, None] * u
        bf[:, j] -= pull[:, b, None] * u
        hgg[offset + b, offset + b] += k * k * w.sum()
        bg[offset + b] -= k * pull[:, b].sum()


def _stepped(
    state: AdjustState, normal: _Normal, damping: float, known: BoolArray, problem: AdjustProblem
) -> AdjustState:
    """One damped Gauss-Newton step."""
    cameras = len(state.centers)
    hff = _damped_frames(normal.hff, damping)
    solved = np.linalg.solve(hff, np.concatenate([normal.hfg, normal.bf[..., None]], axis=-1))
    reduced = normal.hgg + np.diag(damping * np.diag(normal.hgg) + 1e-9)
    reduced = reduced - np.einsum("tfg,tfh->gh", normal.hfg, solved[..., :-1])
    right = normal.bg - np.einsum("tfg,tf->g", normal.hfg, solved[..., -1])
    step_g = -np.linalg.solve(reduced, right)
    step_f = -(solved[..., -1] + solved[..., :-1] @ step_g)
    of_camera = step_g[: _PER_CAMERA * cameras].reshape(cameras, _PER_CAMERA)
    return AdjustState(
        rotations=exp_so3(of_camera[:, :3]) @ state.rotations,
        centers=state.centers + of_camera[:, 3:6],
        log_focal=state.log_focal + (of_camera[:, 6] if problem.focal_sigma > 0 else 0.0),
        points=state.points + np.where(known[..., None], step_f.reshape(state.points.shape), 0.0),
        lengths=state.lengths * np.exp(step_g[_PER_CAMERA * cameras :]),
    )


def _damped_frames(hff: FloatArray, damping: float) -> FloatArray:
    """The frames' blocks with a damped diagonal; unknown points get a one so that they stay put."""
    diagonal = np.einsum("tff->tf", hff)
    out = hff.copy()
    extra = damping * diagonal + np.where(diagonal > 0, 1e-9 * np.maximum(diagonal, 1.0), 1.0)
    np.einsum("tff->tf", out)[...] += extra
    return out


def _covariance(problem: AdjustProblem, state: AdjustState, normal: _Normal) -> FloatArray:
    """(7C, 7C) of the cameras, by how the landmarks and the stretches of the take pull (a sandwich).

    A landmark that the 2D network places a little off does so in every frame, and neighbouring frames err
    alike, so errors are neither independent between frames nor between landmarks: their pulls on the cameras
    are summed by landmark and by stretch of time first, and squared then (two-way clustering; Cameron,
    Gelbach, Miller, "Robust inference with multiway clustering", 2011; without its subtracted term, which
    only makes it larger).
    """
    cameras = len(state.centers)
    size = _PER_CAMERA * cameras
    hff = _damped_frames(normal.hff, 1e-9)
    gain = np.linalg.solve(hff, normal.hfg)
    reduced = normal.hgg - np.einsum("tfg,tfh->gh", normal.hfg, gain)
    held = _gauge(state, problem)
    strength = np.trace(reduced) / len(reduced)
    reduced = reduced + strength * held @ held.T + 1e-12 * strength * np.eye(len(reduced))
    if problem.focal_sigma <= 0:
        at = np.arange(6, size, _PER_CAMERA)
        reduced[at, at] += strength
    inverse = np.linalg.inv(reduced)
    # Each observation's pull on the reduced system, (T, K, G).
    frames, count = problem.sigma_px.shape[1:]
    by_point = np.einsum("ctkra,ctkr->tka", normal.jx, normal.residual)
    pull = -np.einsum("tka,tkag->tkg", by_point, gain.reshape(frames, count, 3, -1))
    pull[..., :size] += np.einsum("ctkra,ctkr->tkca", normal.jg, normal.residual).reshape(frames, count, -1)
    stretches = np.array_split(np.arange(frames), min(10, frames))
    total = np.zeros_like(reduced)
    for groups in (pull.sum(axis=0), np.stack([pull[s].sum(axis=(0, 1)) for s in stretches])):
        if len(groups) > 1:
            centered = groups - groups.mean(axis=0)
            total += centered.T @ centered * len(groups) / (len(groups) - 1)
    # What was given beforehand is off by its own standard deviation once, however many frames it is weighed as.
    weighed = np.tile(_prior(problem, state, state)[1], cameras) ** 2
    total[np.arange(size), np.arange(size)] += (problem.prior_worth - 1) * weighed
    bend = _bend(problem, normal)
    spread = inverse @ total @ inverse / bend**2 + inverse / bend
    return np.asarray(spread[:size, :size])


def _bend(problem: AdjustProblem, normal: _Normal) -> float:
    """The loss' curvature over its weight, on average: weights alone pretend that outliers hold the cameras."""
    seen = np.abs(normal.jx).sum(axis=(-1, -2)) > 0
    weighted = (normal.residual**2).sum(axis=-1)[seen]  # w r^2 with w = 1 / (1 + r^2 / k^2)
    share = np.clip(weighted / problem.loss_sigma**2, 0.0, 1 - 1e-9)  # r^2 / (k^2 + r^2)
    weight = 1 - share
    radial = weight**2 * (1 - share / weight)
    return float(np.clip((radial + weight).mean() / 2 / weight.mean(), 0.2, 1.0))


def _gauge(state: AdjustState, problem: AdjustProblem) -> FloatArray:
    """(G, 7) directions, of unit length, that move, turn and scale all cameras together."""
    cameras = len(state.centers)
    out = np.zeros((_PER_CAMERA * cameras + len(problem.bones), 7))
    middle = state.centers.mean(axis=0)
    for c in range(cameras):
        at = _PER_CAMERA * c
        for axis in range(3):
            omega = np.eye(3)[axis]
            out[at + 3 + axis, axis] = 1.0
            out[at : at + 3, 3 + axis] = -state.rotations[c] @ omega
            out[at + 3 : at + 6, 3 + axis] = np.cross(omega, state.centers[c] - middle)
        out[at + 3 : at + 6, 6] = state.centers[c] - middle
    out[_PER_CAMERA * cameras :, 6] = 0.0  # the cameras alone say what the size is
    return np.asarray(out / np.linalg.norm(out, axis=0))
