"""Recovery of unlabelled points near the expected position of a missing marker: most are that marker."""

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import FloatArray, IndexArray


@dataclass(frozen=True)
class RecoverOptions:
    """When a point gets the label of a missing marker.

    Attributes:
        frames: longest gap across which the marker's path predicts its position.
        reach_m: largest distance from the prediction, metres; it grows by a third per frame of the gap, up to three
            times as far.
        sure: minimum votes over being no marker at which a point gets a label where no path predicts a position.
    """

    frames: int = 15
    reach_m: float = 0.025
    sure: float = 1.5


def recover_points(
    points: FloatArray, label: IndexArray, gain: FloatArray, options: RecoverOptions = RecoverOptions()
) -> IndexArray:
    """Label points that lie where a missing marker is expected.

    Args:
        points: (T, S, 3) metres, NaN where there is no point.
        label: (T, S) labels so far, -1 for none.
        gain: (T, S, A) votes of every point for every label over being no marker.
        options: see `RecoverOptions`.

    Returns:
        (T, S) labels.
    """
    named = np.full((len(points), gain.shape[2], 3), np.nan)
    frame, slot = np.nonzero(label >= 0)
    named[frame, label[frame, slot]] = points[frame, slot]
    place, reach = _predict_missing(named, options)
    out = label.copy()
    loose = (label < 0) & np.isfinite(points[..., 0])
    missing = ~np.isfinite(named[..., 0])
    for t in np.nonzero(loose.any(1) & missing.any(1))[0]:
        who, what = np.nonzero(loose[t])[0], np.nonzero(missing[t])[0]
        away = np.linalg.norm(points[t, who][:, None] - place[t, what], axis=-1)
        near = np.nan_to_num(away / reach[t, what], nan=np.inf)
        # The expected position has the most weight; the network's scores separate neighbouring markers.
        votes = gain[t, who[:, None], what]
        unknown = np.where(np.isfinite(reach[t, what]), -1e3, votes - options.sure)
        score = np.where(near < 1, 6 * (1 - np.minimum(near, 1)) + np.maximum(votes, -4.0), unknown)
        rows, cols = scipy.optimize.linear_sum_assignment(score, maximize=True)
        good = score[rows, cols] > 0
        out[t, who[rows[good]]] = what[cols[good]]
    return out


def _predict_missing(named: FloatArray, options: RecoverOptions) -> tuple[FloatArray, FloatArray]:
    """Expected positions (T, A, 3) of missing markers, linear across short gaps, and their tolerance (T, A), metres.

    NaN where nothing is known.
    """
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
            # A fast marker's path is more curved.
            speed = np.linalg.norm(named[last, a] - named[first, a]) / (last - first)
            wider = min(1 + (gap[i] - 1) / 3, 3.0)
            reach[inside, a] = options.reach_m * wider + 0.5 * min(speed, 0.1)
    return place, reach
