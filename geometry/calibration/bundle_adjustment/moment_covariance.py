"""Covariance of cameras that were adjusted to a moved board, from how much each of its moments pulls.

Errors of corners in one picture are alike: blur, light, a bent board and a lens that the model describes roughly move
neighbouring corners together, so that a hundred corners say much less than a hundred independent ones. What is
independent are the moments. Leaving each of them out in turn (a jackknife, linearised; Bell and McCaffrey, "Bias
reduction in standard errors for linear regression with multi-stage samples", 2002) shows how much the cameras depend on
it, whatever its errors are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.reprojection import ReprojectionSystem, State
from muybridge.geometry.calibration.bundle_adjustment.solver import reduce

_NO_DAMPING = 1e-10
# Share of a moment that stays when it is left out, for those without which a camera would be loose.
_KEPT = 0.02


def moment_covariance(system: ReprojectionSystem, state: State) -> FloatArray:
    """(G, G) of the free unknowns of all cameras, in the order of `ReprojectionSystem.free`.

    Args:
        system: an adjustment whose observations are all on bodies, a body being a moment.
        state: as adjusted.
    """
    parts = [_of_moment(system, state, body) for body in np.unique(system.problem.body)]
    known = _of_priors(system)
    total = sum(matrix for matrix, _ in parts) + known
    root = np.sqrt(np.maximum(np.diag(total), 1e-30))
    scaled, prior = total / root / root[:, None], known / root / root[:, None]
    pulls = []
    for matrix, gradient in parts:
        left = scaled - (1 - _KEPT) * matrix / root / root[:, None]
        pulls.append(np.linalg.pinv(left, rcond=1e-12, hermitian=True) @ (gradient / root))
    moved = np.stack(pulls)
    inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True)
    spread = (1 - 1 / len(moved)) * moved.T @ moved + inverse @ prior @ inverse
    return np.asarray(spread / root / root[:, None])


def _of_moment(system: ReprojectionSystem, state: State, body: int) -> tuple[FloatArray, FloatArray]:
    """The reduced equations of one moment alone: (G, G) and (G,)."""
    p = system.problem
    rows = p.body == body
    part = replace(
        p, camera=p.camera[rows], point=p.point[rows], pixels=p.pixels[rows], sigma_px=p.sigma_px[rows],
        body=np.asarray(p.body)[rows], priors=(),
    )  # fmt: skip
    reduced = reduce(ReprojectionSystem(part).linearised(state).equations, _NO_DAMPING)
    return reduced.matrix, reduced.gradient


def _of_priors(system: ReprojectionSystem) -> FloatArray:
    """(G, G) information of the lens priors."""
    out = np.zeros((system.offsets[-1],) * 2)
    for c, prior in system.priors:
        at = slice(system.offsets[c], system.offsets[c] + len(prior.mean))
        out[at, at] += prior.information
    return np.asarray(out[np.ix_(system.free, system.free)])
