"""Covariance of cameras that were adjusted to a moved board, from how much each of its moments pulls.

Errors of corners in one picture are alike: blur, light, a bent board and a lens that the model describes roughly move
neighbouring corners together, so that a hundred corners say much less than a hundred independent ones. What is
independent are the moments. Leaving each of them out in turn (a jackknife, linearised; Bell and McCaffrey, "Bias
reduction in standard errors for linear regression with multi-stage samples", 2002) shows how much the cameras depend on
it, whatever its errors are.

A few moments tell that only roughly. It is therefore mixed with the covariance that independent errors would give,
scaled as a whole to the size that the moments show: that has the shape of the one and the size of the other.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.calibration.bundle_adjustment.reprojection import ReprojectionSystem, State
from muybridge.geometry.calibration.bundle_adjustment.solver import reduce

_NO_DAMPING = 1e-10
# Share of a moment that stays when it is left out, for those without which a camera would be loose.
_KEPT = 0.02
_FEWEST_MOMENTS = 3


def moment_covariance(system: ReprojectionSystem, state: State, independent: FloatArray) -> FloatArray:
    """(G, G) of the free unknowns of all cameras, in the order of `ReprojectionSystem.free`.

    Args:
        system: an adjustment whose observations are all on bodies, a body being a moment.
        state: as adjusted.
        independent: (G, G) what it would be if all errors were independent.
    """
    bodies = np.unique(np.asarray(system.problem.body))
    if len(bodies) < _FEWEST_MOMENTS:
        return independent
    left_out = _jackknife(system, state, bodies)
    root = np.sqrt(np.maximum(np.diag(independent), 1e-300))
    values, vectors = np.linalg.eigh(independent / root / root[:, None])
    known = values > 1e-9 * values.max()
    white = (vectors[:, known] / np.sqrt(values[known])).T / root
    # Never below what independent errors give: a few moments may agree by chance.
    size = max(float(np.einsum("ka,ab,kb->k", white, left_out, white).mean()), 1.0)
    unknowns = max(int(system.free[a:b].sum()) for a, b in pairwise(system.offsets))
    share = unknowns / (unknowns + len(bodies))
    return np.asarray(share * size * independent + (1 - share) * left_out)


def _jackknife(system: ReprojectionSystem, state: State, bodies: IntArray) -> FloatArray:
    """(G, G) by leaving each moment out, and by what is known of the lenses beforehand."""
    parts = [_of_moment(system, state, int(body)) for body in bodies]
    known = _of_priors(system)
    total = np.sum([matrix for matrix, _ in parts], axis=0) + known
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
