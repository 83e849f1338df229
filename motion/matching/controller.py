"""A figure that is steered: the wanted trajectory and the figure's pose are searched for, and the best frame goes on.

Clavet 2016, "Motion Matching and The Road to Next-Gen Animation" (GDC).
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import placed
from muybridge.motion.matching.database import MatchDatabase, joined
from muybridge.motion.matching.features import trajectory_features
from muybridge.motion.matching.goals import Goal, Wanted
from muybridge.motion.matching.transitions import Transition

_LOOK_BACK = 3  # frames of which a transition takes velocities and accelerations
_TICK = 0.05  # seconds from look to look at the goal
_NEAR = 0.2  # seconds around the frame that plays, in which no better one is looked for


@dataclass(frozen=True)
class SteerOptions:
    """How a figure is steered.

    Attributes:
        search_every: seconds between searches.
        blend: seconds over which a transition's difference dies away.
        transition_cost: squared scaled distance by which another frame must be better than going on.
        turning: radians per second by which the figure is turned at most beyond what its clip does.
    """

    search_every: float = 0.15
    blend: float = 0.3
    transition_cost: float = 0.5
    turning: float = 0.5

    def __post_init__(self) -> None:
        for name, least in (("search_every", 0.0), ("blend", 0.0), ("transition_cost", -1e-300), ("turning", -1e-300)):
            if not least < getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be {'above zero' if least == 0 else 'zero or more'}, "
                                 f"not {getattr(self, name):g}")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Steered:
    """What a steered figure did.

    Attributes:
        motion: (T frames).
        frames: (T,) of the database that played.
        places: (T, 2) metres, of its facing frame.
        yaw: (T,) radians where it faced.
        searches: how often was searched.
        jumps: (jumps,) frames of the motion at which another frame of the database went on.
        arrived: whether the goal was reached.
    """

    motion: Motion
    frames: IndexArray
    places: FloatArray
    yaw: FloatArray
    searches: int
    jumps: IndexArray
    arrived: bool


def steer(database: MatchDatabase, goal: Goal, seconds: float, options: SteerOptions | None = None) -> Steered:
    """Let a figure follow a goal.

    Args:
        database: of what is known.
        goal: what steers it.
        seconds: after which it ends, if it has not arrived.
        options: how it is steered.
    """
    figure = _Figure(database, goal, options or SteerOptions())
    arrived = False
    while figure.seconds < seconds:
        wanted = goal.wanted(figure.seconds, figure.place, figure.yaw, figure.horizons)
        if wanted is None:
            arrived = True
            break
        if figure.is_due(wanted):
            figure.choose(wanted)
        figure.go_on(wanted)
    return figure.result(seconds, arrived)


class _Figure:
    """The state of a figure: which frame plays, where it is, and what is left of the last transition."""

    def __init__(self, database: MatchDatabase, goal: Goal, options: SteerOptions) -> None:
        self.database, self.options = database, options
        self.horizons = np.array(database.options.horizons)
        self.place, self.yaw = goal.start()
        wanted = goal.wanted(0.0, self.place, self.yaw, self.horizons)
        self.frame = self._first(wanted)
        self.transition: Transition | None = None
        self.since = 0.0
        self.searches, self.since_search = 0, np.inf
        self.jumps: list[int] = []
        self.played = [self._placed(np.array([self.frame]), np.array([self.turn]), self.place[None])]
        self.frames, self.places, self.yaws = [np.array([self.frame])], [self.place[None]], [np.array([self.yaw])]
        self.count = 1

    @property
    def turn(self) -> float:
        """Radians from the database to the world, of the frame that plays."""
        return float(self.yaw - self.database.path.yaw[self.frame])

    @property
    def seconds(self) -> float:
        return (self.count - 1) / self.database.fps

    def _first(self, wanted: Wanted | None) -> int:
        """The frame whose trajectory is nearest to the wanted one, whatever its pose."""
        allowed = np.flatnonzero(self.database.searchable)
        if wanted is None:
            return int(allowed[0])
        columns = self.database.options.trajectory
        gaps = self.database.scaled[allowed, columns] - self._query(wanted, int(allowed[0]))[columns]
        return int(allowed[int(np.argmin((gaps**2).sum(axis=1)))])

    def _query(self, wanted: Wanted, frame: int) -> Float32Array:
        """(F,) scaled: the wanted trajectory with the pose of a frame."""
        features = self.database.features[frame].copy()
        features[self.database.options.trajectory] = trajectory_features(self.place, np.asarray(self.yaw),
                                                                         wanted.places, wanted.yaw)  # fmt: skip
        return self.database.scaling.apply(features)

    def is_due(self, wanted: Wanted) -> bool:
        """Whether it is time to search: since the last search, since the goal has changed, or since the clip ends."""
        due = self.since_search > self.options.search_every - 0.5 / self.database.fps
        return due or wanted.changed or self._left() < self._tick()

    def choose(self, wanted: Wanted) -> None:
        """Search, and go on with another frame where it is better than the one that plays."""
        database, frame = self.database, self.frame
        query = self._query(wanted, frame)
        left, bound = self._left(), np.inf
        if left >= self._tick():
            bound = float(((database.scaled[frame] - query) ** 2).sum()) - self.options.transition_cost
        near = round(_NEAR * database.fps)
        self.searches, self.since_search = self.searches + 1, 0.0
        found, _ = database.tree.search(query, bound, (frame - near, frame + near + 1)) if bound > 0 else (None, 0.0)
        if found is None and left < 1:  # nothing else is there: the only clip is as short as what may not be found
            found, _ = database.tree.search(query)
        if found is not None:
            self._jump(found)

    def _tick(self) -> int:
        """Frames from look to look at the goal."""
        return max(1, round(min(_TICK, self.options.search_every) * self.database.fps))

    def _left(self) -> int:
        """Frames that may still be played on to."""
        return int(self.database.ends[self.frame]) - self.frame - 1

    def _jump(self, frame: int) -> None:
        old = joined(self.played[-_LOOK_BACK:])
        old = old.select(slice(max(0, len(old) - _LOOK_BACK), None))
        turn = float(self.yaw - self.database.path.yaw[frame])
        frames = np.arange(frame - len(old) + 1, frame + 1)
        shifts = self.place + _turned(self.database.path.places[frames] - self.database.path.places[frame], turn)
        new = self._placed(frames, np.full(len(frames), turn), shifts)
        self.transition, self.since, self.frame = Transition.between(old, new), 0.0, frame
        self.jumps.append(self.count - 1)

    def go_on(self, wanted: Wanted) -> None:
        """Play the frames until the goal is looked at again."""
        database, fps = self.database, self.database.fps
        count = min(self._tick(), self._left())
        steps = np.arange(1, count + 1)
        frames = self.frame + steps
        turns: FloatArray = np.asarray(self.turn + self._turning(wanted) * steps / fps, dtype=np.float64)
        ways = np.diff(database.path.places[self.frame : self.frame + count + 1], axis=0)
        places: FloatArray = self.place + _turned(ways, turns).cumsum(axis=0)
        motion = self._placed(frames, turns, places)
        if self.transition is not None:
            motion = self.transition.apply(motion, self.since + steps / fps, self.options.blend)
        self.since += count / fps
        self.since_search += count / fps
        self.played.append(motion)
        self.frames.append(frames)
        self.places.append(places)
        self.yaws.append(turns + database.path.yaw[frames])
        self.count += count
        self.frame, self.place, self.yaw = int(frames[-1]), places[-1], float(self.yaws[-1][-1])

    def _turning(self, wanted: Wanted) -> float:
        """Radians per second by which the figure is turned to where it should face at the first horizon."""
        k, horizon = len(self.horizons), float(self.horizons[0])
        cosine, sine = self.database.features[self.frame, 2 * k : 2 * k + 2]
        missing = np.angle(np.exp(1j * (wanted.yaw[0] - self.yaw - np.arctan2(sine, cosine))))
        return float(np.clip(missing / horizon, -self.options.turning, self.options.turning))

    def _placed(self, frames: IndexArray, turns: FloatArray, places: FloatArray) -> Motion:
        """Frames of the database with their facing frames at places (T, 2), turned by (T,)."""
        shift = places - _turned(self.database.path.places[frames], turns)
        return placed(self.database.motion.select(frames), turns, np.column_stack([shift, np.zeros(len(frames))]))

    def result(self, seconds: float, arrived: bool) -> Steered:
        """What was done in so many seconds."""
        kept = slice(0, min(self.count, round(seconds * self.database.fps) + 1))
        motion = joined(self.played)
        motion = Motion(motion.skeleton, motion.fps, motion.root_positions_world, continuous_quat(motion.quat_wxyz),
                        motion.translations)  # fmt: skip
        jumps = np.array([j for j in self.jumps if j < kept.stop], dtype=np.intp)
        return Steered(motion.select(kept), np.concatenate(self.frames)[kept], np.concatenate(self.places)[kept],
                       np.concatenate(self.yaws)[kept], self.searches, jumps, arrived)  # fmt: skip


def _turned(vectors: FloatArray, turn: FloatArray | float) -> FloatArray:
    """(..., 2) turned by (...) radians counter-clockwise."""
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * vectors[..., 0] - s * vectors[..., 1], s * vectors[..., 0] + c * vectors[..., 1]], axis=-1)
