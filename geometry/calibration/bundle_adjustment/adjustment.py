"""Bundle adjustment of cameras, points and rigid boards, with what is known of their uncertainty.

One robust Levenberg-Marquardt (`solver`) over everything that is free: per camera the focal lengths, principal point,
distortion and pose; world points; and bodies, rigid sets of known points (a calibration board) with a pose per
frame. The reduced system's inverse gives the standard deviations. Each camera's parameter kinds can be held alone and
each observation has its own standard deviation. docs/development/bundle-adjustment.md says how this compares with
pycolmap's adjuster and with pyceres.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.moment_covariance import moment_covariance
from muybridge.geometry.calibration.bundle_adjustment.problem import AdjustProblem, AdjustResult, FreeCamera, LensPrior
from muybridge.geometry.calibration.bundle_adjustment.reprojection import Linearised, ReprojectionSystem, State
from muybridge.geometry.calibration.bundle_adjustment.solver import Damping, minimise, reduce
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

__all__ = ["AdjustProblem", "AdjustResult", "FreeCamera", "LensPrior", "adjust"]

_GIVEN_DEGREES = 4.0
_DAMPING = Damping(start=1e-4, down=10.0, up=10.0, lowest=1e-12, tolerance=1e-9, iterations=50)
_NO_DAMPING = 1e-10  # of the covariances: as little as keeps a point that is hardly seen from spoiling the rest


def adjust(problem: AdjustProblem) -> AdjustResult:
    """Adjust everything that is free so that the (robust) reprojection errors become smallest.

    Raises:
        ValueError: arrays that do not fit together, a lens model without derivatives (`ADJUSTABLE_MODELS`).
    """
    system = ReprojectionSystem(problem)
    schedule = replace(_DAMPING, iterations=problem.max_iterations)
    state, _, done = minimise(system.start(), system.cost, system.linearised, system.stepped, schedule)
    return _result(system, state, done)


def _result(system: ReprojectionSystem, state: State, done: int) -> AdjustResult:
    problem = system.problem
    error = system.evaluate(state, False)[0]
    weights = system.weigh(error)[1]
    r2 = ((error / problem.sigma_px[:, None]) ** 2).sum(axis=1)
    loose = np.asarray(problem.points_free)[system.used[~system.is_body]].sum()
    degrees = 2 * weights.sum() - system.free.sum() - 3 * loose - 6 * system.is_body.sum()
    degrees += sum(np.linalg.matrix_rank(p.information) for _, p in system.priors)
    # The given precision counts like a few observations, for problems with hardly more of them than unknowns.
    squares = np.nansum(weights * r2) + _GIVEN_DEGREES
    noise = float(np.sqrt(squares / (max(degrees, 0.0) + _GIVEN_DEGREES)))
    linearised = system.linearised(state)
    covariance = noise**2 * _covariance(system, state, linearised)
    if system.is_body.all() and system.free.any():
        free = np.ix_(system.free, system.free)
        covariance[free] = moment_covariance(system, state, covariance[free])
    variance = np.maximum(np.diag(covariance), 0.0)
    variance_of = np.ones_like(state.swayed)
    for v in linearised.swayed:
        variance_of[v.camera, v.body] = np.einsum("vrr->vr", np.linalg.inv(v.inner))
    cameras = []
    for c, camera in enumerate(problem.cameras):
        pose = np.column_stack([state.rotations[c], -state.rotations[c] @ state.centers[c]])
        cameras.append(replace(camera, params=tuple(state.params[c]), cam_from_world=_orthonormal(camera, pose)))
    ends = system.offsets[1:]
    return AdjustResult(
        CameraGroup(tuple(cameras)), state.points, state.bodies, error, weights, noise,
        np.sqrt(variance[system.offsets[:-1]]),
        np.sqrt(np.stack([variance[e - 3 : e].sum() for e in ends])), done,
        tuple(covariance[a:e, a:e] for a, e in zip(system.offsets[:-1], ends, strict=True)),
        *((None, None) if problem.sway is None else (state.swayed, variance_of)),
    )  # fmt: skip


def _orthonormal(camera: Camera, pose: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd(pose[:, :3])
    return np.column_stack([u @ vt, pose[:, 3]])


def _covariance(system: ReprojectionSystem, s: State, linearised: Linearised) -> FloatArray:
    """(total, total) of all camera parameters, zero where held; what is free as a whole is taken out."""
    out = np.zeros((system.offsets[-1],) * 2)
    if not system.free.any():
        return out
    reduced = reduce(linearised.equations, _NO_DAMPING).matrix
    root = np.sqrt(np.maximum(np.diag(reduced), 1e-30))
    scaled = reduced / root / root[:, None]
    modes = system.gauge(s) * root[:, None]
    moving = np.linalg.norm(modes, axis=0) > 0
    modes /= np.maximum(np.linalg.norm(modes, axis=0), 1e-30)
    loose = moving & (np.einsum("gk,gh,hk->k", modes, scaled, modes) < 1e-7)
    if loose.any():
        q, _ = np.linalg.qr(modes[:, loose])
        inverse = np.linalg.pinv(scaled + q @ q.T, hermitian=True) - q @ q.T
    else:
        inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True)
    inverse = inverse / root / root[:, None]
    if loose.any():  # seen relative to all cameras together, not to the scaled axes above
        g = system.gauge(s)[:, loose]
        away = np.eye(len(g)) - g @ np.linalg.pinv(g)
        inverse = away @ inverse @ away.T
    out[np.ix_(system.free, system.free)] = inverse
    return out
