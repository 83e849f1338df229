"""Corrections of one camera, fitted to the points of the other cameras, and statistics of the errors of a rig.

The numerics of the diagnosis: a robust fit of one camera's pose, focal length or time shift, and the comparison of two
explanations. Errors follow a bivariate Student distribution, so that wrong 2D points influence neither a fit nor the
choice between explanations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.calibration.diagnosis.evidence import Dependence, clustered_covariance
from muybridge.geometry.cameras.camera import Camera, colmap_camera
from muybridge.geometry.numerics.robust import student_cost, student_scale
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.geometry.sync.clocks import parabola

_DOF = 3.0  # of the Student distribution: tails of the errors of 2D networks
_ITERATIONS = 12
_LEAST_GAIN = 1e-7  # nats an observation, of a step that is worth another
_FEWEST_POINTS = 12
_FARTHEST = np.array([0.5, 0.5, 0.5, 2.0, 2.0, 2.0, 1.0])  # bounds of a correction: turn, move, log focal
_STEP = 1e-5  # for numerical derivatives: a share of the distance, and of the focal length


@dataclass(frozen=True)
class Correction:
    """A fitted correction of a camera.

    Attributes:
        camera: the corrected camera.
        turn: (3,) rotation vector about the camera's own axes, radians.
        move: (3,) displacement of its centre in world axes, metres.
        focal: factor on the focal lengths.
        covariance: (7, 7) of turn, move and log focal; zero where not fitted.
    """

    camera: Camera
    turn: FloatArray
    move: FloatArray
    focal: float
    covariance: FloatArray

    @property
    def parameters(self) -> FloatArray:
        """(7,) turn, move and log focal."""
        return np.concatenate([self.turn, self.move, [np.log(self.focal)]])

    @property
    def sd(self) -> FloatArray:
        """(7,) standard deviations of turn, move and log focal."""
        return np.sqrt(np.diag(self.covariance))


def perturb_camera(camera: Camera, parameters: FloatArray) -> Camera:
    """The camera rotated by (3,) radians about its own axes, moved by (3,) metres, and zoomed by exp(log focal)."""
    rotation = exp_so3(parameters[:3]) @ camera.rotation
    center = camera.center_world + parameters[3:6]
    params = list(camera.params)
    for index in colmap_camera(camera).focal_length_idxs():
        params[index] *= float(np.exp(parameters[6]))
    pose = np.column_stack([rotation, -rotation @ center])
    return replace(camera, params=tuple(params), cam_from_world=pose)


def fit_camera(
    camera: Camera,
    points_world: FloatArray,
    points_px: FloatArray,
    sigma: FloatArray,
    free: BoolArray,
    start: Correction | None = None,
    dependence: Dependence | None = None,
) -> Correction | None:
    """Fit a camera's pose or focal length to known points robustly.

    Args:
        camera: initial camera.
        points_world: (N, 3) metres; NaN where unknown.
        points_px: (N, 2) px; NaN where unknown.
        sigma: (N,) relative standard deviation.
        free: (7,) which of turn (3), move (3) and log focal are fitted.
        start: initial correction.
        dependence: how errors of the observations depend on each other; None: they are independent.

    Returns:
        The correction, or None with too few points.
    """
    use = np.isfinite(points_world).all(-1) & np.isfinite(points_px).all(-1) & np.isfinite(sigma)
    use &= np.isfinite(camera.project(points_world)).all(-1)
    world, px, weight0 = points_world[use], points_px[use], 1 / sigma[use]
    if len(world) < _FEWEST_POINTS:
        return None
    trial, scale = np.zeros(7), None
    if start is not None:
        trial = start.parameters
    total, chosen = trial, np.flatnonzero(free)
    independent = Dependence((np.arange(len(use)),), np.zeros((0, len(use), 2)))
    dependence = (dependence or independent).of(use)
    patterns = dependence.patterns * weight0[:, None]
    information, scores = np.eye(len(chosen)), np.zeros((len(world), len(chosen)))
    common = np.zeros((len(patterns), len(chosen)))
    best = np.inf
    for _ in range(_ITERATIONS):
        now = perturb_camera(camera, trial)
        error, jacobian = _linearise(now, world, px, bool(free[6]))
        error, jacobian = error * weight0[:, None], jacobian[..., chosen] * weight0[:, None, None]
        squares = np.where(np.isfinite(error).all(-1), (error**2).sum(-1), 1e12)
        scale = student_scale(squares, scale)
        cost = float(student_cost(squares, scale).mean())
        if cost > best - _LEAST_GAIN:
            break
        best, total = cost, trial
        weight = (_DOF + 2) / (_DOF * scale**2 + squares)
        good = np.isfinite(jacobian).all((1, 2)) & (squares < 1e11)
        jw = jacobian[good] * weight[good, None, None]
        information = np.einsum("nai,naj->ij", jw, jacobian[good])
        scores = np.zeros((len(world), len(chosen)))
        scores[good] = np.einsum("nai,na->ni", jw, error[good])
        common = np.einsum("nai,sna->si", jw, patterns[:, good])
        trial = total.copy()
        trial[chosen] -= np.linalg.solve(information + 1e-9 * np.eye(len(chosen)), scores.sum(axis=0))
        trial = np.clip(trial, -_FARTHEST, _FARTHEST)
    covariance = clustered_covariance(information, scores, dependence.clusters, common)
    return _correction(camera, total, chosen, covariance)


def _correction(camera: Camera, parameters: FloatArray, chosen: IntArray, covariance: FloatArray) -> Correction:
    """The correction of a camera by (7,) parameters, of which the `chosen` have a covariance."""
    whole = np.zeros((7, 7))
    whole[np.ix_(chosen, chosen)] = covariance
    turn, move, focal = parameters[:3].copy(), parameters[3:6].copy(), float(np.exp(parameters[6]))
    return Correction(perturb_camera(camera, parameters), turn, move, focal, whole)


def _linearise(camera: Camera, world: FloatArray, px: FloatArray, zooms: bool) -> tuple[FloatArray, FloatArray]:
    """(N, 2) projected minus observed, px, and its (N, 2, 7) derivative by turn, move and, if asked for, log focal."""
    lens = camera.posed(np.eye(4)[:3])
    rel = (world - camera.center_world) @ camera.rotation.T
    here = lens.project(rel)
    step = _STEP * np.abs(rel[:, 2])
    by_point = np.stack([lens.project(rel + step[:, None] * axis) - here for axis in np.eye(3)], axis=-1)
    by_point /= step[:, None, None]
    out = np.zeros((len(world), 2, 7))
    out[..., :3] = np.cross(rel[:, None], by_point)
    out[..., 3:6] = -by_point @ camera.rotation
    if zooms:
        zoomed = perturb_camera(lens, np.array([0, 0, 0, 0, 0, 0, _STEP]))
        out[..., 6] = (zoomed.project(rel) - here) / _STEP
    return here - px, out


def carried_errors(
    camera: Camera, others: Sequence[Camera], points_world: FloatArray, patterns: FloatArray, weights: FloatArray
) -> FloatArray:
    """Displacement of a camera's predicted points by errors of the other views that the points result from.

    Args:
        camera: the camera of the prediction.
        others: C cameras.
        points_world: (N, 3) metres; NaN where unknown.
        patterns: (C, S, N, 2) px, errors of each view.
        weights: (C, N) of the views, 1/px^2; 0 where not seen.

    Returns:
        (C S, N, 2) px.
    """
    nothing = np.zeros((len(points_world), 2))
    own, *each = (
        np.nan_to_num(-_linearise(one, points_world, nothing, False)[1][..., 3:6]) for one in (camera, *others)
    )
    weighted = [weight[:, None, None] * by_point for weight, by_point in zip(weights, each, strict=True)]
    information = sum((np.swapaxes(w, 1, 2) @ j for w, j in zip(weighted, each, strict=True)), np.zeros((1, 3, 3)))
    gain = own @ np.linalg.inv(
        information + (1e-6 * np.trace(information, axis1=1, axis2=2)[:, None, None] + 1e-12) * np.eye(3)
    )
    moved = [np.einsum("nij,naj,sna->sni", gain, w, p) for w, p in zip(weighted, patterns, strict=True)]
    return np.concatenate(moved)


def fit_shift(
    predicted_px: FloatArray, observed: Callable[[float], tuple[FloatArray, FloatArray]], most: int, about: float = 0.0
) -> float | None:
    """Estimate by how many frames a camera's landmarks are late.

    Only whole frames are tried, and a parabola interpolates between them: landmarks interpolated between frames are
    averages with less noise, which would always seem to fit better.

    Args:
        predicted_px: (K, J, 2) projections of the other cameras' points, px.
        observed: returns (K, J, 2) px and (K, J) relative standard deviations of the camera's landmarks at a given
            delay, frames.
        most: largest distance from `about` that is tried, frames.
        about: initial delay, a whole number of frames.

    Returns:
        The delay, frames, or None with too few points.
    """

    def cost(shift: float, every: int = 1) -> tuple[float, int]:
        px, sigma = observed(shift)
        squares = (((px - predicted_px) / sigma[..., None])[::every] ** 2).sum(-1)
        known = squares[np.isfinite(squares)]
        return (float(student_cost(known, student_scale(known)).mean()) if known.size else np.inf), known.size

    whole = np.arange(-most, most + 1, dtype=float) + about
    tried = [cost(s, max(1, len(predicted_px) // 40)) for s in whole]
    counts = np.array([n for _, n in tried])
    values = np.array([v if n >= max(_FEWEST_POINTS, 0.5 * counts.max()) else np.inf for v, n in tried])
    if not np.isfinite(values).any():
        return None
    best = float(whole[np.argmin(values)])
    near = np.array([cost(best + k)[0] for k in (-2, -1, 0, 1, 2)])
    k = int(np.argmin(near))
    return best + k - 2 + parabola(-near, k)


def frames_per_observation(errors: FloatArray) -> float:
    """Number of frames that count as one independent observation, since errors of a landmark persist over frames.

    The variance of each error's mean over the take, relative to its value for independent frames.

    Args:
        errors: (C, K, J, 2) in standard deviations; NaN where unknown.
    """
    series = np.moveaxis(np.clip(errors, -3, 3), 1, -1).reshape(-1, errors.shape[1])
    count = np.isfinite(series).sum(axis=1)
    series = series[count >= 5]
    if not len(series):
        return 1.0
    count = np.isfinite(series).sum(axis=1)
    known = np.nan_to_num(series)
    mean, power = known.sum(axis=1) / count, (known**2).sum(axis=1) / count
    return float(np.clip((count * mean**2).sum() / max(power.sum(), 1e-12), 1.0, errors.shape[1]))
