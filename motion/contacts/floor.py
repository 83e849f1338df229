"""The floor that feet stand on, found from where they rest."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.motion.contacts.feet import FootPoints

_GRID_M = 0.002
_SPREAD_M = 0.008  # standard deviation of the kernel of densities of heights
_SHIFTS = 30  # of a mean-shift search for the top of such a density
_LEAST_PEAK = 0.3  # of the highest density that a lower one must have to count as the floor
_NEAR_M = 0.025  # from such a density that heights count
_SAME_M = 0.035  # heights of both feet over the same floor differ by no more than this
_HEEL_M = 0.06  # and those of heel and ball
_SLOW = 0.25  # share of a take's frames that are slow at least
_STEEPEST = 0.15  # slope


@dataclass(frozen=True)
class Floor:
    """A plane.

    Attributes:
        height: metres, where it crosses the vertical through the origin.
        normal: (3,) unit length, up.
    """

    height: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def heights(self, points: FloatArray) -> FloatArray:
        """(...) metres of points (..., 3) over it, along its normal."""
        return np.asarray((points - [0.0, 0.0, self.height]) @ np.array(self.normal))

    def onto(self, points: FloatArray, clearance: FloatArray | float = 0.0) -> FloatArray:
        """(..., 3) points moved along the vertical to be `clearance` over it."""
        out = np.array(points, dtype=np.float64)
        out[..., 2] += (clearance - self.heights(out)) / self.normal[2]
        return out


def find_floor(feet: FootPoints, speed: FloatArray, slope: bool = False) -> tuple[Floor, FloatArray]:
    """The floor, and (2, 2) metres by which heels and balls are over it where they stand.

    Each point rests at the lowest height at which it is often slow; heights of one floor agree. The lower of the balls
    is put onto the floor.

    Args:
        feet: the points.
        speed: (T, 2, 2) metres per second.
        slope: whether the floor may slope.
    """
    slow = _slow_frames(speed, feet.size)
    flat = Floor()
    rest = _resting_heights(feet, flat, slow)
    if not slope or not np.isfinite(rest).all():
        return _put(flat, rest)
    for turn in range(5):  # at first by all slow frames, then by those near the floor
        near = slow & (np.abs(flat.heights(feet.places) - rest) < _NEAR_M * feet.size)
        near = near if turn else slow
        gradient = _gradient(feet.places, rest, near)
        normal = np.array([-gradient[0], -gradient[1], 1.0])
        x, y, z = (normal / np.linalg.norm(normal)).tolist()
        flat = Floor(0.0, (x, y, z))
        rest = _resting_heights(feet, flat, slow)
    return _put(flat, rest)


def _put(flat: Floor, rest: FloatArray) -> tuple[Floor, FloatArray]:
    known = rest[np.isfinite(rest)]
    height = float(known.min()) if len(known) else 0.0
    clearance = np.where(np.isfinite(rest), rest - height, 0.0)
    return Floor(height / flat.normal[2], flat.normal), np.asarray(clearance)


def _slow_frames(speed: FloatArray, size: float) -> BoolArray:
    """(T, 2, 2) frames in which a point is slow: for a foot that stands, or among its slowest."""
    known = np.where(np.isfinite(speed), speed, np.inf)
    least = np.quantile(known, _SLOW, axis=0) if len(known) else 0.0
    return np.asarray((known < 0.2 * size) | ((known <= least) & np.isfinite(known)))


def _resting_heights(feet: FootPoints, flat: Floor, slow: BoolArray) -> FloatArray:
    """(2, 2) metres: of heel and ball of both feet; what is far from the other foot's never stands."""
    heights, out = flat.heights(feet.places), np.full((2, 2), np.nan)
    for k in range(2):
        for p in range(2):
            out[k, p] = _lowest_often(heights[slow[:, k, p], k, p], feet.size)
    ball = np.nanmin(out[:, 1]) if np.isfinite(out[:, 1]).any() else np.nan
    for p in range(2):
        least = np.nanmin(out[:, p]) if np.isfinite(out[:, p]).any() else ball
        if p == 0 and abs(least - ball) > _HEEL_M * feet.size:
            least = ball  # the heels never come down, or the balls never do
        out[:, p] = np.where(np.abs(out[:, p] - least) < _SAME_M * feet.size, out[:, p], least)
    return out


def _lowest_often(heights: FloatArray, size: float) -> float:
    """The lowest height that is common; NaN if there are no heights."""
    heights = heights[np.isfinite(heights)]
    if not len(heights):
        return float("nan")
    # Cells of the world, not of this take: a frame more or less moves none of them.
    low = float(np.floor(heights.min() / _GRID_M)) * _GRID_M
    grid = np.zeros(int(min((heights.max() - low) / _GRID_M, 2000)) + 20)
    np.add.at(grid, np.minimum(((heights - low) / _GRID_M).astype(int) + 8, len(grid) - 1), 1.0)
    density = gaussian_filter1d(grid, _SPREAD_M * size / _GRID_M, mode="constant")
    peak = (density >= np.roll(density, 1)) & (density >= np.roll(density, -1)) & (density > 0)
    peak &= density >= _LEAST_PEAK * density.max()
    at = low + (int(np.argmax(peak)) - 8 + 0.5) * _GRID_M
    # To the top of the density itself, then the mean about it: both change little with a frame more or less.
    for width in (*[_SPREAD_M] * _SHIFTS, _NEAR_M / 2):
        weight = np.exp(-0.5 * ((heights - at) / (width * size)) ** 2)
        at = float(weight @ heights / weight.sum()) if weight.sum() > 1e-9 else at
    return float(at)


def _gradient(places: FloatArray, rest: FloatArray, near: BoolArray) -> FloatArray:
    """(2,) slope of the floor along x and y, drawn to level where the points do not span it."""
    rows = places[near]
    if len(rows) < 8:
        return np.zeros(2)
    height = rows[:, 2] - np.broadcast_to(rest, near.shape)[near]
    flat = rows[:, :2] - rows[:, :2].mean(0)
    normal = flat.T @ flat + np.eye(2) * 0.02 * len(rows)  # as a prior: 5 cm of noise over 1 m
    return np.clip(np.linalg.solve(normal, flat.T @ (height - height.mean())), -_STEEPEST, _STEEPEST)
