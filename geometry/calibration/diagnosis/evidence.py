"""How certain a fault is: standard deviations and significance under errors that persist over frames and landmarks.

A 2D network repeats its errors: consecutive frames of a landmark share them, and in a short take its bias in a view
does not change at all. So neither frames nor 2D points are independent observations, but the tracks of different
landmarks nearly are. Estimates have covariances clustered by landmark and by stretches of time (Liang and Zeger,
"Longitudinal data analysis using generalized linear models", 1986), to which the variance of errors is added that a
view's landmarks share. The gain of an explanation is compared with its variation between landmarks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics.robust import extent, row_median, student_cost, student_scale, student_weight

_STRETCH = 12.0  # frames after which errors of 2D networks are nearly independent
_FEWEST_STRETCHES = 4
_FEWEST_LANDMARKS = 10
_PIECES, _FEWEST_PIECES = 8, 6
# Standard deviations of what all landmarks of a view share: displacement over the person's size, and scale.
_COMMON, _COMMON_SCALE = 0.004, 0.006
_DOF = 3.0  # of the Student distribution, as in `robust`


@dataclass(frozen=True)
class Dependence:
    """How the errors of N observations depend on each other.

    Attributes:
        clusters: ways of clustering, each (N,); observations of one cluster depend on each other.
        patterns: (S, N, 2) px, errors of one standard deviation that all observations share.
    """

    clusters: tuple[IntArray, ...]
    patterns: FloatArray

    def of(self, use: IntArray | BoolArray) -> Dependence:
        """That of some of the observations."""
        return Dependence(tuple(way[use] for way in self.clusters), self.patterns[:, use])


def dependence_of(frames: FloatArray, points_px: FloatArray, carried: FloatArray | None = None) -> Dependence:
    """Dependence of the (K J) 2D points (K, J, 2) of a person in frames (K,), in the order of the flat array.

    Errors of one landmark depend on each other, and those of one stretch of time. A network may also place all of a
    view's landmarks a little to one side, or see the person a little too large.

    Args:
        frames: (K,) frames.
        points_px: (K, J, 2) px.
        carried: (S, K J, 2) px, the same errors of the other views, which displace the predicted points.
    """
    count = points_px.shape[1]
    landmark = np.tile(np.arange(count), len(frames))
    stretch = np.repeat(np.floor((frames - frames.min(initial=0.0)) / _STRETCH).astype(np.intp), count)
    patterns = view_patterns(points_px).reshape(3, -1, 2)
    return Dependence((landmark, stretch), patterns if carried is None else np.concatenate([patterns, carried]))


def view_patterns(points_px: FloatArray) -> FloatArray:
    """(3, K, J, 2) px, errors of one standard deviation that a view's points (K, J, 2) share: along x, y, and scale."""
    sizes = extent(points_px)
    size = float(np.median(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else 0.0
    middle = np.stack([row_median(points_px[..., axis]) for axis in (0, 1)], axis=-1)[:, None]
    patterns = np.empty((3, *points_px.shape))
    patterns[0], patterns[1] = _COMMON * size * np.array([1.0, 0.0]), _COMMON * size * np.array([0.0, 1.0])
    patterns[2] = np.nan_to_num(_COMMON_SCALE * (points_px - middle))
    return patterns


def clustered_covariance(
    information: FloatArray, scores: FloatArray, clusters: tuple[IntArray, ...], common: FloatArray | None = None
) -> FloatArray:
    """Covariance of an M-estimate whose observations depend on each other within clusters.

    Args:
        information: (P, P) Gauss-Newton normal matrix.
        scores: (N, P) each observation's contribution to the gradient.
        clusters: ways of clustering, each (N,); their covariances add up.
        common: (S, P) change of the gradient by errors of one standard deviation that all observations share.
    """
    inverse = np.linalg.pinv(information)
    size = len(information)
    middle = np.zeros((size, size))
    for k, way in enumerate(clusters):
        _, index = np.unique(way, return_inverse=True)
        count = int(index.max()) + 1 if index.size else 0
        if count < (2 if k == 0 else _FEWEST_STRETCHES):
            continue
        sums = np.zeros((count, size))
        np.add.at(sums, index, scores)
        # Residuals at the optimum are too small by their leverage; the jackknife divides by its complement.
        middle += sums.T @ sums / max(1 - size / (2 * count), 0.2) ** 2
    if common is not None:
        middle += common.T @ common
    return np.asarray(inverse @ middle @ inverse)


def gain_scores(before: FloatArray, after: FloatArray) -> tuple[float, float]:
    """Significance of a decrease of errors, over landmarks and over time: mean gains in standard errors.

    Each landmark counts once, with all its frames and cameras, because their errors depend on each other (Vuong,
    "Likelihood ratio tests for model selection and non-nested hypotheses", 1989, with clusters); and each stretch of
    the take, with all its landmarks, because they err together where a network takes left for right. The quotient of
    few clusters has Student's distribution; what is returned is the Gaussian deviate of the same probability.

    Args:
        before: (C, K, J, 2) in relative standard deviations; NaN where unknown.
        after: the same.

    Returns:
        The score over landmarks, and that over `_PIECES` stretches of the take; 0 where one or two carry the gain.
    """
    costs = []
    for errors in (before, after):
        squares = (errors**2).sum(-1)
        costs.append(student_cost(squares, student_scale(squares[np.isfinite(squares)])))
    gain = costs[0] - costs[1]
    landmarks = [gain[:, :, j] for j in range(gain.shape[2])]
    stretches = [gain[:, rows] for rows in np.array_split(np.arange(gain.shape[1]), _PIECES)]
    return _mean_score(landmarks, _FEWEST_LANDMARKS), _mean_score(stretches, _FEWEST_PIECES)


def _mean_score(gains: list[FloatArray], fewest: int) -> float:
    """Mean of the clusters' mean gains over its standard error, as a Gaussian deviate.

    It is 0 with too few clusters, or where the best two are all that gains.
    """
    known = [gain[np.isfinite(gain)] for gain in gains]
    each = np.sort([gain.mean() for gain in known if gain.size >= 5])
    if len(each) < fewest or each[:-2].sum() <= 0:
        return 0.0
    quotient = each.mean() / max(each.std(ddof=1) / np.sqrt(len(each)), 1e-12)
    return float(np.sign(quotient)) * _deviate(float(scipy.special.stdtr(len(each) - 1, -abs(quotient))))


def size_score(size: float, sd: float, clusters: int) -> float:
    """Certainty of a size whose standard deviation is itself estimated from few clusters.

    Returns:
        The quotient, as the Gaussian deviate of the same probability.
    """
    if clusters < 2 or not np.isfinite(sd):
        return 0.0
    return _deviate(float(scipy.special.stdtr(clusters - 1, -abs(size) / max(sd, 1e-12))))


def _deviate(tail: float) -> float:
    """Gaussian deviate that is exceeded with a probability, which is taken as 1e-260 where it is less."""
    # Not scipy.stats, whose import takes longer than those of most commands together.
    return -float(scipy.special.ndtri(max(tail, 1e-260)))


def least_score(chance: float, tried: int) -> float:
    """The score that one of `tried` explanations exceeds with a probability of `chance` where none is true."""
    return -float(scipy.special.ndtri(chance / max(tried, 1)))


def without_bias(errors: FloatArray) -> FloatArray:
    """Errors (C, K, J, 2) without the median of each landmark in each camera."""
    known = np.isfinite(errors)
    ordered = np.sort(np.where(known, errors, np.inf), axis=1)
    middle = np.maximum(known.sum(axis=1, keepdims=True) - 1, 0) // 2
    return np.asarray(errors - np.take_along_axis(ordered, middle, axis=1))


def shift_sd(errors: FloatArray, observed: FloatArray, predicted: FloatArray, dependence: Dependence) -> float:
    """Standard deviation of a time shift, frames; infinite where nothing moves.

    The smaller one of two estimates: without the constant error of each landmark, and with it, where the errors that
    all landmarks share count as well. Somebody who walks straight ahead is displaced by a constant. The motion of the
    other cameras' points is the instrument for the observed motion: its errors are others', so that noise is not taken
    for motion.

    Args:
        errors: (K, J, 2) observed minus predicted, standard deviations.
        observed: (K, J, 2) motion of the observed points, standard deviations a frame.
        predicted: (K, J, 2) motion of the predicted points, the same.
        dependence: of the (K J) observations; its patterns in standard deviations.
    """
    use: BoolArray = np.isfinite(np.concatenate([errors, observed, predicted], axis=-1)).all(axis=-1)
    if use.sum() < 2 * _FEWEST_LANDMARKS:
        return float("inf")
    some = dependence.of(use.ravel())
    whole = _shift_sd(errors[use], observed[use], predicted[use], some.clusters, some.patterns)
    centred = _centred(errors, use), _centred(observed, use), _centred(predicted, use)
    return min(_shift_sd(*centred, some.clusters, None), whole)


def _shift_sd(
    error: FloatArray,
    seen: FloatArray,
    expected: FloatArray,
    clusters: tuple[IntArray, ...],
    patterns: FloatArray | None,
) -> float:
    """Standard deviation of a time shift by errors and motions (N, 2), and (S, N, 2) errors that all share."""
    squares = (error**2).sum(-1)
    scale = student_scale(squares)
    weight = student_weight(squares / scale**2, _DOF, 2)[:, None]
    information = float((weight * expected * seen).sum())
    if information <= 0:
        return float("inf")
    scores = (weight * expected * error).sum(-1)[:, None]
    common = None if patterns is None else np.einsum("na,sna->s", weight * expected, patterns)[:, None]
    covariance = clustered_covariance(np.array([[information]]), scores, clusters, common)
    return float(np.sqrt(covariance[0, 0]))


def _centred(values: FloatArray, use: BoolArray) -> FloatArray:
    """(N, 2) the used values (K, J, 2), less the median of each landmark."""
    known = np.where(use[..., None], values, np.nan)
    return np.asarray(without_bias(known[None])[0][use])
