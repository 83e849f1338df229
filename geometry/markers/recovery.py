"""Points that were left without a name, where a marker is missing: most are that marker, seen for a moment."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from muybridge.arrays import FloatArray, IndexArray


@dataclass(frozen=True)
class RecoverOptions:
    """When a point takes the name of a marker that is missing.

    Attributes:
        frames: longest gap across which the marker's path says where it is.
        reach_m: how far from there a point may lie, metres; a third more for every frame that the gap is long, up to
            three times as far.
        sure: votes over being no marker that a point needs for a name where no path says where the marker is.
    """

    frames: int = 15
    reach_m: float = 0.025
    sure: float = 1.5


def recover_points(
    points: FloatArray, label: IndexArray, gain: FloatArray, options: RecoverOptions = RecoverOptions()
) -> IndexArray:
    """Labels (T, S) with names for points that lie where a missing marker must be.

    Args:
        points: (T, S, 3) metres, NaN where nothing is.
        label: (T, S) labels so far, -1 for none.
        gain: (T, S, A) votes of every point for every label over being no marker.
        options: when.
    """
    named = np.full((len(points), gain.shape[2], 3), np.nan)
    frame, slot = np.nonzero(label >= 0)
    named[frame, label[frame, slot]] = points[frame, slot]
    place, reach = _expected(named, options)
    out = label.copy()
    loose = (label < 0) & np.isfinite(points[..., 0])
    missing = ~np.isfinite(named[..., 0])
    for t in np.nonzero(loose.any(1) & missing.any(1))[0]:
        who, what = np.nonzero(loose[t])[0], np.nonzero(missing[t])[0]
        away = np.linalg.norm(points[t, who][:, None] - place[t, what], axis=-1)
        near = np.nan_to_num(away / reach[t, what], nan=np.inf)
        # Where it should be counts most; what the network says keeps neighbours apart.
        said = gain[t, who[:, None], what]
        unknown = np.where(np.isfinite(reach[t, what]), -1e3, said - options.sure)
        score = np.where(near < 1, 6 * (1 - np.minimum(near, 1)) + np.maximum(said, -4.0), unknown)
        rows, cols = linear_sum_assignment(score, maximize=True)
        good = score[rows, cols] > 0
        out[t, who[rows[good]]] = what[cols[good]]
    return out


def _expected(named: FloatArray, options: RecoverOptions) -> tuple[FloatArray, FloatArray]:
    """Where missing markers (T, A, 3) must be, by a straight line across short gaps, and how far off (T, A) they may be
    found; NaN where nothing is known."""
    count, size = named.shape[:2]
    place, reach = np.full(named.shape, np.nan), np.full((count, size), np.nan)
    for a in range(size):
        known = np.nonzero(np.isfinite(named[:, a, 0]))[0]
        if len(known) < 2:
            continue
        gap = np.diff(known) - 1
        for i in np.nonzero((gap > 0) & (gap <= options.frames))[0]:
            first, last = known[i], known[i + 1]
            inside = np.arange(first + 1, last)
            share = ((inside - first) / (last - first))[:, None]
            place[inside, a] = named[first, a] * (1 - share) + named[last, a] * share
            # A fast marker bends its path more.
            speed = np.linalg.norm(named[last, a] - named[first, a]) / (last - first)
            wider = min(1 + (gap[i] - 1) / 3, 3.0)
            reach[inside, a] = options.reach_m * wider + 0.5 * min(speed, 0.1)
    return place, reach
