"""Distances between markers that were measured on the person before, in a labelled recording."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.marker_sets import MarkerDistances
from muybridge.geometry.markers.rigidity import Rigidity

# What a marker's place differs by from one recording to the next, where it was not put on anew; and by how much more
# a distance measured in the new recording may differ, where it was.
_SLIP_M, _PLACED_M = 0.004, 0.03
# Motions differ from those of the recording before: these shares of the spread over all motions and of the distance
# are expected as well. Markers of one segment are close; those far apart have joints between them.
_OTHER_MOTION, _FAR = 0.25, 0.05
_FEWEST_FRAMES = 10
# Weight of distances of the person, relative to distances that the labelling measures itself.
KNOWN_WEIGHT = 2.0


def known_rigidity(
    known: MarkerDistances, distance_m: FloatArray, motion_m: FloatArray, bodies_m: FloatArray, links: int
) -> Rigidity:
    """Partners of every marker by what is known of the person, and by the table of all people where nothing is.

    Args:
        known: of A markers.
        distance_m: (A, A) mean distances over all people, metres.
        motion_m: (A, A) their standard deviation by motion, metres.
        bodies_m: (A, A) their standard deviation between bodies, metres.
        links: number of partners.
    """
    there = np.isfinite(known.mean_m)
    mean = np.where(there, np.nan_to_num(known.mean_m), distance_m)
    spread = np.sqrt(np.nan_to_num(known.sigma_m) ** 2 + _SLIP_M**2 + (_OTHER_MOTION * motion_m) ** 2
                     + (_FAR * mean) ** 2)  # fmt: skip
    sigma = np.where(there, spread, np.maximum(np.hypot(motion_m, bodies_m), 0.01))
    partners = np.argsort(sigma + 1e6 * np.eye(len(sigma)), 1, kind="stable")[:, : min(links, len(sigma) - 1)]
    rows = np.arange(len(sigma))[:, None]
    return Rigidity(partners, mean[rows, partners], sigma[rows, partners])


def near_known(measured: Rigidity, known: Rigidity) -> Rigidity:
    """Measured distances where they are near what is known, else what is known: a distance measured with wrong labels
    must not confirm them."""
    near = np.abs(measured.mean_m - known.mean_m) <= np.maximum(_PLACED_M, 2 * known.sigma_m)
    return Rigidity(known.partners, np.where(near, measured.mean_m, known.mean_m),
                    np.where(near, measured.sigma_m, known.sigma_m))  # fmt: skip


def measure_distances(points: FloatArray, links: int = 12) -> MarkerDistances:
    """The distances of every marker of a labelled recording to those that it moves with most.

    Args:
        points: (T, M, 3) metres, NaN where missing.
        links: number of distances kept for each marker; a distance that either of two keeps is kept.
    """
    count = points.shape[1]
    mean, sigma = np.full((count, count), np.nan), np.full((count, count), np.nan)
    for a in range(count):
        apart = np.linalg.norm(points - points[:, a, None], axis=-1)
        enough = np.isfinite(apart).sum(0) >= min(_FEWEST_FRAMES, len(points))
        enough[a] = False
        if enough.any():
            low, middle, high = np.nanquantile(apart[:, enough], (0.1, 0.5, 0.9), axis=0)
            mean[a, enough], sigma[a, enough] = middle, (high - low) / 2.56
    moves = np.hypot(sigma, _FAR * mean)
    order = np.argsort(np.where(np.isfinite(moves), moves, np.inf), 1, kind="stable")[:, :links]
    keep = np.zeros((count, count), bool)
    np.put_along_axis(keep, order, True, 1)
    keep |= keep.T
    return MarkerDistances(np.where(keep, mean, np.nan), np.where(keep, sigma, np.nan))


def open_to_any(scores: FloatArray) -> FloatArray:
    """Scores (T, S, A + 1) by which a point that the network takes for no marker may as well be any of them, so that
    distances decide: markers of a set that was learned may stand beside their body points, or on none.

    Args:
        scores: logarithms, the last column for none.
    """
    out = scores.copy()
    out[..., :-1] = np.maximum(scores[..., :-1], scores[..., -1:] - np.log(scores.shape[-1]))
    return out
