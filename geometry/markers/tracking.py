"""Trajectories of unlabelled points: those of a file are checked for jumps, or points are tracked.

A marker's state is its position and velocity under white-noise acceleration (Kalman filter); points are assigned to
predictions within a gate, all at once; a marker that is lost is predicted for a few frames.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True)
class TrackOptions:
    """How points become trajectories.

    Attributes:
        acceleration: standard deviation of a marker's acceleration, m/s^2.
        noise_m: standard deviation of a measurement, metres.
        gate: largest distance between a point and its prediction in standard deviations.
        coast: number of frames for which a lost marker is predicted.
        reach_m: largest distance of a point from its prediction, metres.
        shuffled: share of jumps within a file's columns, or of columns that another one continues, from which on the
            columns are not used as trajectories.
    """

    acceleration: float = 60.0
    noise_m: float = 0.004
    gate: float = 5.0
    coast: int = 10
    reach_m: float = 0.15
    shuffled: float = 0.25


@dataclass(frozen=True)
class Tracks:
    """Trajectories in slots; a slot holds one trajectory after another.

    Attributes:
        points: (T, S, 3) metres, NaN where there is no point.
        track: (T, S) number of the trajectory, -1 where there is no point.
        column: (T, S) column of the file that the point comes from, -1 where there is no point.
        tracked: whether the trajectories were tracked, not taken from the file.
    """

    points: FloatArray
    track: IndexArray
    column: IndexArray
    tracked: bool

    @property
    def count(self) -> int:
        """Number of trajectories."""
        return int(self.track.max(initial=-1)) + 1


def find_tracks(points: FloatArray, fps: float, options: TrackOptions = TrackOptions()) -> Tracks:
    """Trajectories of a file's columns, split at gaps and jumps; or tracked, where its columns are no trajectories.

    Args:
        points: (T, K, 3) metres, NaN where missing.
        fps: frames per second.
        options: see `TrackOptions`.
    """
    jumps = _jumps(points, fps, options)
    seen = np.isfinite(points[..., 0])
    steps = (seen[1:] & seen[:-1]).sum()
    if steps and max(jumps.sum() / steps, _shuffled_share(points)) > options.shuffled:
        return track_points(points, fps, options)
    track = np.full(seen.shape, -1, np.intp)
    number = 0
    for k in range(seen.shape[1]):
        starts = seen[:, k] & ~np.concatenate([[False], seen[:-1, k]])
        starts |= jumps[:, k]
        order = np.cumsum(starts) - 1 + number
        track[seen[:, k], k] = order[seen[:, k]]
        number += int(starts.sum())
    column = np.where(seen, np.arange(seen.shape[1]), -1)
    return Tracks(points, track, column, False)


def _shuffled_share(points: FloatArray, most: int = 150) -> float:
    """Share of steps after which another column's point is nearer; near 1 where points are shuffled in every frame,
    at any frame rate."""
    exchanged = steps = 0
    for t in np.unique(np.linspace(0, max(len(points) - 2, 0), most).astype(int)):
        pair = points[t : t + 2]
        both = np.isfinite(pair[..., 0]).all(0)
        if len(pair) < 2 or both.sum() < 2:
            continue
        off = np.linalg.norm(pair[0][both][:, None] - pair[1][both], axis=-1)
        rows, cols = scipy.optimize.linear_sum_assignment(off)
        exchanged += int(((rows != cols) & (off[rows, rows] > 2 * off[rows, cols] + 0.01)).sum())
        steps += len(rows)
    return exchanged / max(steps, 1)


def _jumps(points: FloatArray, fps: float, options: TrackOptions) -> BoolArray:
    """(T, K) whether a column is far from where its previous motion predicts it."""
    count, columns = points.shape[:2]
    jumps = np.zeros((count, columns), bool)
    filters = _Filters(columns, fps, options)
    # Columns are trusted: a jump is a motion that no marker can make, not one that is merely improbable.
    slack = 0.04 + 4 * options.acceleration / fps**2
    last = np.full(columns, False)
    for t in range(count):
        seen = np.isfinite(points[t, :, 0])
        filters.predict()
        off = np.linalg.norm(np.where(seen[:, None], points[t] - filters.position, 0.0), axis=1)
        known = seen & last
        jumps[t] = known & (off > slack + 0.5 * np.linalg.norm(filters.velocity, axis=1) / fps)
        fresh = seen & (~last | jumps[t])
        filters.start(fresh, points[t])
        filters.update(known & ~jumps[t], points[t])
        last = seen
    return jumps


def track_points(points: FloatArray, fps: float, options: TrackOptions = TrackOptions()) -> Tracks:
    """Track points whose columns have no meaning; arguments as `find_tracks`."""
    count, columns = points.shape[:2]
    slots = 2 * columns + 8
    filters = _Filters(slots, fps, options)
    track = np.full((count, slots), -1, np.intp)
    column = np.full((count, slots), -1, np.intp)
    at = np.full((count, slots, 3), np.nan)
    number = np.full(slots, -1, np.intp)
    missed = np.zeros(slots, np.intp)
    age = np.zeros(slots, np.intp)
    born = 0
    for t in range(count):
        seen = np.nonzero(np.isfinite(points[t, :, 0]))[0]
        filters.predict()
        alive = np.nonzero(number >= 0)[0]
        rows, cols = _assign(filters, alive, points[t, seen], options, missed[alive])
        slot, source = alive[rows], seen[cols]
        hit = np.zeros(slots, bool)
        hit[slot] = True
        there = np.full((slots, 3), np.nan)
        there[slot] = points[t, source]
        filters.update(hit, there)
        at[t, slot], track[t, slot], column[t, slot] = points[t, source], number[slot], source
        missed = np.where(hit, 0, missed + 1)
        age[hit] += 1
        # A trajectory that has just started is not predicted.
        number[(missed > options.coast) | ((missed > 1) & (age < 5))] = -1
        new = np.delete(seen, cols)
        free = np.nonzero(number < 0)[0][: len(new)]
        fresh = np.zeros(slots, bool)
        fresh[free] = True
        there[free] = points[t, new]
        filters.start(fresh, there)
        number[free] = born + np.arange(len(new))
        born += len(new)
        missed[free], age[free] = 0, 1
        at[t, free], track[t, free], column[t, free] = points[t, new], number[free], new
    used = (track >= 0).any(0)
    return Tracks(at[:, used], track[:, used], column[:, used], True)


def _assign(filters: "_Filters", alive: IndexArray, points: FloatArray, options: TrackOptions,
            missed: IndexArray) -> tuple[IndexArray, IndexArray]:  # fmt: skip
    """Pairs of rows of `alive` and of `points` that belong together."""
    if not len(alive) or not len(points):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    off = np.linalg.norm(filters.position[alive][:, None] - points[None], axis=2)
    sigma = np.sqrt(filters.variance[alive, 0, 0] + options.noise_m**2)
    near = (off < options.gate * sigma[:, None]) & (off < options.reach_m)
    # Predictions of lost markers come after markers that were just visible.
    cost = np.where(near, off + 0.01 * np.minimum(missed, 3)[:, None], 10.0)
    rows, cols = scipy.optimize.linear_sum_assignment(cost)
    good = near[rows, cols]
    return rows[good], cols[good]


class _Filters:
    """Kalman filters of position and velocity, one per slot, with the same covariance for every axis."""

    def __init__(self, count: int, fps: float, options: TrackOptions) -> None:
        self.dt, self.options = 1.0 / fps, options
        self.position, self.velocity = np.zeros((count, 3)), np.zeros((count, 3))
        self.variance = np.tile(np.eye(2), (count, 1, 1))
        dt, q = self.dt, options.acceleration**2
        self.move = np.array([[1, dt], [0, 1]])
        self.process = q * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])

    def predict(self) -> None:
        """Predict one frame ahead."""
        self.position += self.velocity * self.dt
        self.variance = self.move @ self.variance @ self.move.T + self.process

    def update(self, which: BoolArray, points: FloatArray) -> None:
        """Apply the measurements `points` (S, 3) of the slots in `which`."""
        v = self.variance[which]
        gain = v[:, :, 0] / (v[:, 0, 0] + self.options.noise_m**2)[:, None]
        off = points[which] - self.position[which]
        self.position[which] += gain[:, :1] * off
        self.velocity[which] += gain[:, 1:] * off
        self.variance[which] = v - gain[:, :, None] * v[:, :1, :]

    def start(self, which: BoolArray, points: FloatArray) -> None:
        """Start trajectories at `points` (S, 3) in the slots in `which`: at rest, standard deviation 2 m/s."""
        self.position[which], self.velocity[which] = points[which], 0.0
        self.variance[which] = np.diag([self.options.noise_m**2, 4.0])
