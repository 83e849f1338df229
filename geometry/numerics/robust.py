"""Robust statistics: medians and extents of landmarks, some of which are missing, and Student's t distribution."""

import numpy as np

from muybridge.arrays import FloatArray

MAD_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""
RAYLEIGH_MEDIAN = 1.1774
"""Median length of a 2D standard normal vector."""
CHI2_3_MEDIAN = 2.366
"""Median squared length of a 3D standard normal vector."""

_MIN_LANDMARKS = 4


def row_median(values: FloatArray, least: int = _MIN_LANDMARKS) -> FloatArray:
    """Medians over the last axis, ignoring NaN; NaN with fewer than `least` values (at most all of them)."""
    count = np.isfinite(values).sum(axis=-1)
    # NaN are sorted last; many times faster than nanmedian.
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=-1)
    last = np.maximum(count - 1, 0)
    low = np.take_along_axis(ordered, (last // 2)[..., None], axis=-1)[..., 0]
    high = np.take_along_axis(ordered, ((last + 1) // 2)[..., None], axis=-1)[..., 0]
    enough = count >= max(1, min(least, values.shape[-1]))
    return np.where(enough, 0.5 * (low + high), np.nan)


def median_known(values: FloatArray) -> FloatArray:
    """(T, J) to (J,) lower medians of the finite values; NaN where there are none."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    return np.where(count > 0, middle, np.nan)


def extent(points: FloatArray) -> FloatArray:
    """(...) longer side of the bounding box of points (..., J, D); NaN with fewer than `_MIN_LANDMARKS` points."""
    low, high = _box(points)
    longer: FloatArray = (high - low).max(axis=-1)
    return longer


def _box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates (..., D) of points (..., J, D); NaN with fewer than `_MIN_LANDMARKS` points."""
    known = np.isfinite(points).all(axis=-1, keepdims=True)
    enough = known.sum(axis=-2) >= min(_MIN_LANDMARKS, points.shape[-2])
    low = np.where(known, points, np.inf).min(axis=-2)
    high = np.where(known, points, -np.inf).max(axis=-2)
    return np.where(enough, low, np.nan), np.where(enough, high, np.nan)


def student_weight(squares: FloatArray, dof: float, dimensions: int) -> FloatArray:
    """Weights of iteratively reweighted least squares under a multivariate Student distribution.

    Args:
        squares: squared Mahalanobis distances.
        dof: degrees of freedom; fewer make the tails heavier.
        dimensions: of each observation.
    """
    return np.asarray((dof + dimensions) / (dof + squares))


def student_scale(squares: FloatArray, start: float | None = None, dof: float = 3.0) -> float:
    """Maximum-likelihood scale of a bivariate Student distribution.

    Args:
        squares: (N,) squared lengths.
        start: initial scale.
        dof: degrees of freedom.
    """
    if not squares.size:
        return float("nan")
    scale2 = float(np.median(squares)) / 2 if start is None else start**2
    scale2 = max(scale2, 1e-12)
    for _ in range(50):
        new = max(float((student_weight(squares / scale2, dof, 2) * squares).mean()) / 2, 1e-12)
        done = abs(new - scale2) < 1e-3 * scale2
        scale2 = new
        if done:
            break
    return float(np.sqrt(scale2))


def student_cost(squares: FloatArray, scale: float, dof: float = 3.0) -> FloatArray:
    """Negative log-likelihood, up to a constant, of squared lengths under a bivariate Student distribution."""
    return np.asarray(2 * np.log(scale) + 0.5 * (dof + 2) * np.log1p(squares / (dof * scale**2)))
