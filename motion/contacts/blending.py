"""Corrections that are known in some frames, carried smoothly into the others."""

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from muybridge.arrays import FloatArray

_HOLD = 1e6  # weight of known frames against bending


def blend(values: FloatArray, weight: FloatArray, fps: float, seconds: float) -> FloatArray:
    """The smoothest course through values that are known, which goes to zero away from them.

    Least squares of what is known, and of the rest's size and its first and second differences.

    Args:
        values: (T, K) what is known; passed over elsewhere.
        weight: (T,) 1 where it is known, 0 where not, and between where it counts in part.
        fps: frames per second.
        seconds: over which a correction fades, about.
    """
    frames = len(values)
    if frames < 3 or not weight.any():
        return np.where(weight[:, None] > 0, values, 0.0)
    reach = max(seconds * fps, 1.0) / 2
    stiff = reach**4
    bands = np.zeros((3, frames))
    # Critically damped: |x|^2 + 2 n^2 |x'|^2 + n^4 |x''|^2, whose courses decay without swinging over.
    for size, difference in ((2 * reach**2, (-1.0, 1.0)), (stiff, (1.0, -2.0, 1.0))):
        count = frames - len(difference) + 1
        for k, one in enumerate(difference):
            for j, other in enumerate(difference[k:], start=k):
                bands[2 - (j - k), j : count + j] += size * one * other
    hold = weight * _HOLD * stiff
    bands[2] += hold + (1.0 - weight)
    return np.asarray(solveh_banded(bands, hold[:, None] * np.where(weight[:, None] > 0, values, 0.0)))


def smooth_bound(least: FloatArray, frames: float) -> FloatArray:
    """(T,) a smooth course that is nowhere below `least` (T,), which is not negative."""
    width = max(round(frames), 1)
    high = maximum_filter1d(least, 2 * width + 1, mode="nearest")
    return np.asarray(gaussian_filter1d(high, width / 3, truncate=3.0, mode="nearest"))
