"""What distances between markers say about their names.

Between some markers the distance hardly varies while a person moves (Pan et al. 2023 link each marker to those). Once
most points have a name, these distances are measured on the person at hand, and a point that is called wrongly stands
out: it is nowhere near where its partners say.
"""

from dataclasses import dataclass

import numba
import numpy as np

from muybridge.arrays import FloatArray, IndexArray

# Distances are measured in this many frames, spread over the recording, up to twice as many.
_MOST_FRAMES = 300


@dataclass(frozen=True)
class RigidityOptions:
    """How distances count.

    Attributes:
        links: partners of a marker: those whose distance to it varies least.
        weight: how much a distance that fits counts beside the network's scores.
        rounds: how often names and distances are found anew from one another.
        least_m: smallest standard deviation of a distance, metres.
        frames: how many frames with both markers it takes to trust a distance measured on the person.
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
    """What is known before the person is: partners, distances and their spread by motion and between bodies, all
    (A, A)."""
    spread = motion_m + 1e6 * np.eye(len(motion_m))
    partners = np.argsort(spread, 1, kind="stable")[:, : min(links, len(spread) - 1)]
    rows = np.arange(len(spread))[:, None]
    sigma = np.hypot(motion_m, bodies_m)[rows, partners]
    return Rigidity(partners, distance_m[rows, partners], np.maximum(sigma, 0.01))


def measured_rigidity(points: FloatArray, prior: Rigidity, options: RigidityOptions) -> Rigidity:
    """Distances on the person at hand, from named points (T, A, 3); the prior where a pair was hardly seen.

    Medians and quartiles: a quarter of the names may be wrong.
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
    # The size of the person, for pairs that were not seen together.
    size = float(np.median((middle / prior.mean_m)[~few])) if (~few).any() else 1.0
    return Rigidity(prior.partners, np.where(few, prior.mean_m * size, middle),
                    np.where(few, prior.sigma_m, np.minimum(sigma, prior.sigma_m + 0.02)))  # fmt: skip


def distance_scores(points: FloatArray, named: FloatArray, owner: IndexArray, rigidity: Rigidity) -> FloatArray:
    """(T, S, A) how well points fit as markers: from -1 (no partner is where it should be) to 1.

    Args:
        points: (T, S, 3) metres, NaN where nothing is.
        named: (T, A, 3) the markers as named now, NaN where unnamed.
        owner: (T, A) slots they come from; a point is no partner of itself.
        rigidity: the distances.
    """
    out = np.zeros((*points.shape[:2], len(rigidity.partners)))
    _fit(points, named, owner, rigidity.partners, rigidity.mean_m, rigidity.sigma_m, out)
    return out


@numba.njit(cache=True)
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
                # One partner alone says less than several.
                out[t, s, a] = total / (number + 1.0)
