"""Where a steered figure is wanted: as a stick asks for a velocity, or along a path."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.motion.matching.springs import Spring

_STANDING = 0.1  # metres per second below which a velocity has no direction
_NEAR_END = 0.05  # metres


@dataclass(frozen=True, eq=False)
class Wanted:
    """A trajectory.

    Attributes:
        places: (H, 2) metres in the world, at the horizons.
        yaw: (H,) radians from the X axis towards Y, where the body should face.
        changed: whether the goal has changed so much that a search should not wait.
    """

    places: FloatArray
    yaw: FloatArray
    changed: bool = False


class Goal(Protocol):
    """What steers a figure."""

    def start(self) -> tuple[FloatArray, float]:
        """Where the figure starts: (2,) metres, and radians where it faces."""

    def wanted(self, seconds: float, place: FloatArray, yaw: float, horizons: FloatArray) -> Wanted | None:
        """The trajectory that is wanted of a figure, by where it is and faces; None where it has arrived.

        Args:
            seconds: since the start; never less than in the call before.
            place: (2,) metres.
            yaw: radians.
            horizons: (H,) seconds ahead.
        """


class Stick:
    """A velocity that is asked for, which a critically damped spring carries the figure to; it faces where it goes.

    Args:
        velocity: of the seconds since the start: (2,) metres per second in the world.
        halflife: seconds in which half of a change of velocity is done.
        turn_halflife: seconds in which half of a turn is done.
    """

    def __init__(
        self, velocity: Callable[[float], FloatArray], halflife: float = 0.25, turn_halflife: float = 0.25
    ) -> None:
        self.velocity, self.halflife, self.turn_halflife = velocity, halflife, turn_halflife
        first = np.asarray(velocity(0.0), dtype=np.float64)
        self._moved = Spring(first, np.zeros(2))
        self._facing = Spring(np.asarray(_direction(first, 0.0)), np.zeros(()))
        self._seconds, self._goal, self._facing_goal = 0.0, first, float(self._facing.value)

    def start(self) -> tuple[FloatArray, float]:
        """At the origin, facing where it goes."""
        return np.zeros(2), self._facing_goal

    def wanted(self, seconds: float, place: FloatArray, yaw: float, horizons: FloatArray) -> Wanted | None:
        """See `Goal`; it never arrives."""
        passed, self._seconds = seconds - self._seconds, seconds
        self._moved = self._moved.after(self._goal, passed, self.halflife)
        self._facing = self._facing.after(np.asarray(self._facing_goal), passed, self.turn_halflife)
        goal = np.asarray(self.velocity(seconds), dtype=np.float64)
        changed = float(np.linalg.norm(goal - self._goal)) > _STANDING
        self._goal = goal
        toward = _direction(goal, self._facing_goal)
        # The shorter way round, from where the figure faces now.
        self._facing_goal = yaw + float(_wrapped(toward - yaw))
        self._facing = Spring(yaw + _wrapped(self._facing.value - yaw), self._facing.rate)
        places = place + self._moved.sums(goal, horizons, self.halflife).T
        turned = self._facing.values(np.asarray(self._facing_goal), horizons, self.turn_halflife)
        return Wanted(places, turned, changed)


class Path:
    """A path over the ground, at a speed; the figure faces along it.

    Args:
        points: (K, 2) metres.
        speed: metres per second.

    Raises:
        MuybridgeError: the path has no length or is not finite, or the speed is not above zero.
    """

    def __init__(self, points: FloatArray, speed: float = 1.2) -> None:
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise MuybridgeError("a path needs two finite numbers a point, x and y in metres")
        if not 0 < speed < np.inf:
            raise MuybridgeError(f"the speed must be above zero, not {speed:g} m/s")
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        kept = np.concatenate([[True], steps > 1e-6]) if len(points) else np.zeros(0, np.bool_)
        if kept.sum() < 2:
            raise MuybridgeError("a path needs at least two points that differ")
        self.points, self.speed = points[kept], speed
        self.along = np.concatenate([[0.0], np.cumsum(steps[kept[1:]])])
        self._done = 0.0

    @property
    def length(self) -> float:
        """Metres."""
        return float(self.along[-1])

    def at(self, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(H, 2) places and (H,) radians of the path's direction after ways (H,) in metres."""
        along = np.clip(along, 0.0, self.length)
        places = np.stack([np.interp(along, self.along, column) for column in self.points.T], axis=1)
        # The direction over a stretch, so that corners are rounded.
        ends = [np.clip(along + side, 0.0, self.length) for side in (-0.15, 0.15)]
        way = np.diff([np.stack([np.interp(e, self.along, c) for c in self.points.T], axis=1) for e in ends], axis=0)[0]
        return places, np.arctan2(way[:, 1], way[:, 0])

    def start(self) -> tuple[FloatArray, float]:
        """At the path's start, facing along it."""
        places, yaw = self.at(np.zeros(1))
        return places[0], float(yaw[0])

    def wanted(self, seconds: float, place: FloatArray, yaw: float, horizons: FloatArray) -> Wanted | None:
        """See `Goal`: from the point of the path that is nearest to the figure, and no farther back than before."""
        ahead = np.minimum(self._done + np.linspace(0.0, max(1.0, self.speed), 101), self.length)
        gaps = np.linalg.norm(self.at(ahead)[0] - place, axis=1)
        self._done = float(ahead[int(np.argmin(gaps))])
        if self._done >= self.length - _NEAR_END:
            return None
        places, turned = self.at(self._done + self.speed * horizons)
        return Wanted(places, turned)

    def distance(self, places: FloatArray) -> FloatArray:
        """(T,) metres from places (T, 2) to the nearest point of the path."""
        a, way = self.points[:-1], np.diff(self.points, axis=0)
        share = ((places[:, None] - a) * way).sum(axis=-1) / (way**2).sum(axis=-1)
        nearest = a + np.clip(share, 0.0, 1.0)[..., None] * way
        return np.asarray(np.linalg.norm(places[:, None] - nearest, axis=-1).min(axis=1))


def _direction(velocity: FloatArray, otherwise: float) -> float:
    return float(np.arctan2(velocity[1], velocity[0])) if np.linalg.norm(velocity) > _STANDING else otherwise


def _wrapped(angle: FloatArray | float) -> FloatArray:
    """Radians from -pi to pi."""
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
