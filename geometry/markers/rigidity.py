"""Evidence for labels from distances between markers.

Between some markers the distance hardly varies while a person moves (Pan et al. 2023 link each marker to those). Once
most points have a label, these distances are measured on the person, and a wrongly labelled point is not where its
partners predict it.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled_with

# Distances are measured in at least this many frames, spread over the recording, and in at most twice as many.
_MOST_FRAMES = 300


@dataclass(frozen=True)
class RigidityOptions:
    """How distances enter the labelling.

    Attributes:
        links: number of partners of a marker: those whose distance to it varies least.
        weight: weight of a distance that fits, relative to the network's scores.
        rounds: number of times that labels and distances are estimated from each other.
        least_m: smallest standard deviation of a distance, metres.
        frames: number of frames with both markers at which a measured distance has the weight of the prior.
    """

    links: int = 6
    weight: float = 1.0
    rounds: int = 3
    least_m: float = 0.008
    frames: int = 20


@dataclass(frozen=True)
class Rigidity:
    """Distances between A markers.

    Attributes:
        partners: (A, L) the partners of every marker.
        mean_m: (A, L) distance to them, metres.
        sigma_m: (A, L) its standard deviation, metres.
    """

    partners: IndexArray
    mean_m: FloatArray
    sigma_m: FloatArray


def prior_rigidity(distance_m: FloatArray, motion_m: FloatArray, bodies_m: FloatArray, links: int) -> Rigidity:
    """Partners, distances and their spread before the person is known.

    Args:
        distance_m: (A, A) mean distances, metres.
        motion_m: (A, A) their standard deviation by motion, metres.
        bodies_m: (A, A) their standard deviation between bodies, metres.
        links: number of partners.
    """
    spread = motion_m + 1e6 * np.eye(len(motion_m))
    partners = np.argsort(spread, 1, kind="stable")[:, : min(links, len(spread) - 1)]
    rows = np.arange(len(spread))[:, None]
    sigma = np.hypot(motion_m, bodies_m)[rows, partners]
    return Rigidity(partners, distance_m[rows, partners], np.maximum(sigma, 0.01))


def measured_rigidity(points: FloatArray, prior: Rigidity, options: RigidityOptions) -> Rigidity:
    """Distances on the person, from labelled points (T, A, 3); the prior for pairs that are rarely visible.

    Uses medians and quartiles, because a quarter of the labels may be wrong.
    """
    points = points[:: max(1, len(points) // _MOST_FRAMES)]
    at = points[:, :, None] - points[:, prior.partners]
    distance = np.linalg.norm(at, axis=-1)
    known = np.isfinite(distance)
    count = known.sum(0)
    few = count < options.frames
    filled = np.where(known, distance, np.nan)
    filled[:, few] = 0.0
    low, middle, high = np.nanquantile(filled, (0.2, 0.5, 0.8), axis=0)
    sigma = np.maximum(0.6 * (high - low), options.least_m)
    # Scale the prior by the person's size, for pairs that are not visible together.
    size = float(np.median((middle / prior.mean_m)[~few])) if (~few).any() else 1.0
    return Rigidity(prior.partners, np.where(few, prior.mean_m * size, middle),
                    np.where(few, prior.sigma_m, np.minimum(sigma, prior.sigma_m + 0.02)))  # fmt: skip


def distance_scores(points: FloatArray, named: FloatArray, owner: IndexArray, rigidity: Rigidity) -> FloatArray:
    """(T, S, A) how well points fit as markers: from -1 (no partner is where it should be) to 1.

    Args:
        points: (T, S, 3) metres, NaN where there is no point.
        named: (T, A, 3) currently labelled markers, NaN where missing.
        owner: (T, A) slots of the markers; a point is no partner of itself.
        rigidity: the distances.
    """
    out = np.zeros((*points.shape[:2], len(rigidity.partners)))
    _fit(points, named, owner, rigidity.partners, rigidity.mean_m, rigidity.sigma_m, out)
    return out


@compiled_with()
def _fit(
    points: FloatArray,
    named: FloatArray,
    owner: IndexArray,
    partners: IndexArray,
    mean: FloatArray,
    sigma: FloatArray,
    out: FloatArray,
) -> None:
    count, slots = points.shape[:2]
    labels, links = partners.shape
    away = np.empty(labels)
    for t in range(count):
        for s in range(slots):
            if not np.isfinite(points[t, s, 0]):
                continue
            for b in range(labels):
                away[b] = -1.0
                if owner[t, b] >= 0 and owner[t, b] != s:
                    x = points[t, s, 0] - named[t, b, 0]
                    y = points[t, s, 1] - named[t, b, 1]
                    z = points[t, s, 2] - named[t, b, 2]
                    away[b] = np.sqrt(x * x + y * y + z * z)
            for a in range(labels):
                total, number = 0.0, 0.0
                for k in range(links):
                    d = away[partners[a, k]]
                    if d >= 0:
                        off = (d - mean[a, k]) / sigma[a, k]
                        total += 1.0 - min(off * off / 4.5, 2.0)
                        number += 1.0
                # A single partner is weaker evidence than several.
                out[t, s, a] = total / (number + 1.0)
