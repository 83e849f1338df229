"""Medians and extents of landmarks, of which some are missing."""

import numpy as np

from muybridge.arrays import FloatArray

_MIN_LANDMARKS = 4


def row_median(values: FloatArray, least: int = _MIN_LANDMARKS) -> FloatArray:
    """Medians over the last axis without its NaNs; NaN with fewer than `least` numbers (or all, if fewer)."""
    count = np.isfinite(values).sum(axis=-1)
    # Sorted, NaN come last. Many times faster than nanmedian.
    ordered = np.sort(np.where(np.isfinite(values), values, np.nan), axis=-1)
    last = np.maximum(count - 1, 0)
    low = np.take_along_axis(ordered, (last // 2)[..., None], axis=-1)[..., 0]
    high = np.take_along_axis(ordered, ((last + 1) // 2)[..., None], axis=-1)[..., 0]
    enough = count >= max(1, min(least, values.shape[-1]))
    return np.where(enough, 0.5 * (low + high), np.nan)


def _box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest coordinates (..., 2) of points (..., J, 2); NaN with fewer than `_MIN_LANDMARKS`."""
    known = np.isfinite(points).all(axis=-1, keepdims=True)
    enough = known.sum(axis=-2) >= min(_MIN_LANDMARKS, points.shape[-2])
    low = np.where(known, points, np.inf).min(axis=-2)
    high = np.where(known, points, -np.inf).max(axis=-2)
    return np.where(enough, low, np.nan), np.where(enough, high, np.nan)


def extent(points: FloatArray) -> FloatArray:
    """(...) longer side of the box round points (..., J, 2); NaN with fewer than `_MIN_LANDMARKS`."""
    low, high = _box(points)
    longer: FloatArray = (high - low).max(axis=-1)
    return longer


CHI2_3_MEDIAN = 2.366  # median of the squared length of a standard normal vector in 3D


def median_known(values: FloatArray) -> FloatArray:
    """(T, J) -> (J,) median of what is finite; NaN where nothing is."""
    ordered = np.sort(values, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[None] // 2, axis=0)[0]
    return np.where(count > 0, middle, np.nan)
