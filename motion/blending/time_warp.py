"""Which frames of two motions belong together: a time warp, limited in slope, smooth and always forward.

Kovar and Gleicher 2003, "Flexible Automatic Motion Blending with Registration Curves", section 3.1: the cheapest way
through the grid of distances, then a spline through it that increases strictly in both motions.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import lsq_linear

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.blending._path_kernel import cheapest_path

_DEGREE = 2
_ROUGH = 1e-3  # weight of the spline's second differences against its distance to the path


@dataclass(frozen=True, eq=False)
class TimeWarp:
    """Frames that belong together, as curves over a common parameter.

    With frames i and j that belong together, the parameter is u = (i + j) / 2, and a spline gives i - j over u.

    Attributes:
        start: the first u.
        end: the last u.
        lag: u -> i - j.
    """

    start: float
    end: float
    lag: BSpline

    def frames(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The frames of the first and of the second motion that belong together at each u."""
        u = np.clip(u, self.start, self.end)
        half = 0.5 * np.asarray(self.lag(u))
        return u + half, u - half


def warp_path(distances: FloatArray, free: float = 0.0, slope: int = 3) -> IntArray:
    """The way through a grid of distances on which the sum of the distances is least.

    Args:
        distances: (T, S) of each frame of one motion to each of another, not negative.
        free: share of either motion that may be left out at an end, where its frames have no counterpart; each frame
            that is left out costs the median of all distances. Zero leads from the first to the last frames of both.
        slope: so many frames of one motion at most belong to one of the other.

    Returns:
        (K, 2) pairs of frames.

    Raises:
        ValueError: one motion has more than `slope` times as many frames as the other can go along with.
    """
    count = int(free * min(distances.shape))
    way = cheapest_path(np.ascontiguousarray(distances), float(np.median(distances)), count, max(slope - 1, 1))
    if not len(way):
        raise ValueError(f"no way with slopes of at most {slope} leads through {distances.shape[0]} by "
                         f"{distances.shape[1]} frames")  # fmt: skip
    return np.asarray(way)


def fit_warp(way: IntArray | FloatArray, knot_frames: float, slope: float = 3.0) -> TimeWarp:
    """A smooth time warp along a way.

    Args:
        way: (K, 2) pairs of frames.
        knot_frames: frames between the knots of the spline, about.
        slope: the most frames of one motion that go by for one of the other: the bound of the warp's slope.
    """
    u, lag = 0.5 * way.sum(axis=1), (way[:, 0] - way[:, 1]).astype(np.float64)
    start, end = float(u[0]), float(max(u[-1], u[0] + 1e-6))
    pieces = max(round((end - start) / knot_frames), 1)
    step = (end - start) / pieces
    knots = start + step * np.arange(-_DEGREE, pieces + _DEGREE + 1)
    basis = BSpline.design_matrix(np.clip(u, start, end), knots, _DEGREE).toarray()
    count = basis.shape[1]
    # In the first coefficient and the steps to the next ones, a bound of the slope is a bound of each step: the slope
    # of a uniform spline of degree two lies between steps.
    sums = np.tril(np.ones((count, count)))
    bend = np.diff(np.eye(count), 2, axis=0) @ sums
    matrix = np.concatenate([basis @ sums, np.sqrt(_ROUGH * len(u)) * bend])
    most = 2 * (slope - 1) / (slope + 1) * step
    bounds = np.full(count, most)
    bounds[0] = np.inf
    found = lsq_linear(matrix, np.append(lag, np.zeros(len(bend))), (-bounds, bounds))
    return TimeWarp(start, end, BSpline(knots, sums @ found.x, _DEGREE, extrapolate=True))
