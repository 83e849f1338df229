"""Motions one behind the other, joined where they are most alike."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.joins.join_places import JoinPlace, check_long_enough, find_joins
from muybridge.motion.blending.joins.planting import Feet, Stance, find_feet, stance_across
from muybridge.motion.blending.joins.transitions import JoinOptions, transition
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.footskate import contact_spans, measure_footskate

_PLACES = 4  # that are tried where the transition would be violent
_CALM = 0.8  # of the motions' own peak acceleration, that a transition may reach
_BESIDE_S = 0.6  # before and behind a transition and its contacts, that planting its feet may change
_LONGEST_S = 10.0  # before and behind a transition, in which its contacts are looked at
_CHANGED = 0.02  # of the motions' own peak acceleration, by which a joint must accelerate more than in its motion


@dataclass(frozen=True, eq=False)
class Joined:
    """Motions joined to one.

    Attributes:
        motion: all of it.
        places: of the joins, in the order of the motions.
        frames: of `motion`, at which the joins are.
        seconds: that each transition lasts.
        contacts: of the feet that were planted; None where none were.
        transitions: (T,) frames about the joins. Contacts that have one of them were planted, the others are as they
            were.
        notes: what was assumed or could not be done, one sentence each.
    """

    motion: Motion
    places: tuple[JoinPlace, ...]
    frames: tuple[int, ...]
    seconds: tuple[float, ...]
    contacts: Contacts | None = None
    transitions: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    notes: tuple[str, ...] = ()

    def drift(self) -> float:
        """Metres: the farthest that two places of one heel or ball are apart in one contact that was planted."""
        if self.contacts is None:
            return 0.0
        places = feet_of_motion(self.motion).places
        largest = 0.0
        for foot, point in np.ndindex(2, 2):
            for a, b in contact_spans(self.contacts.contact[:, foot, point]):
                if self.transitions[a:b].any():
                    one = np.ones(b - a, np.bool_)
                    largest = max(largest, measure_footskate(places[a:b, foot, point], one, self.motion.fps).extent)
        return largest


def join_motions(
    motions: Sequence[Motion], names: Sequence[str], options: JoinOptions | None = None,
    at: Sequence[tuple[float | None, float | None]] = (),
) -> Joined:  # fmt: skip
    """Join motions, each to the next one where they are most alike.

    Args:
        motions: at least two, of one skeleton and one frame rate (`same_skeleton`), Z up.
        names: of the motions, for messages.
        options: how.
        at: of each join, seconds from the beginning of the one motion and of the next where it must be; None is free,
            and joins without an entry are.

    Raises:
        MuybridgeError: a motion has fewer than three frames, a time is outside of its motion, or there is nothing to
            fade over.
    """
    options = options or JoinOptions()
    if len(motions) < 2:
        raise MuybridgeError("a join needs at least two motions")
    check_long_enough(motions, names)
    feet, notes = find_feet(motions) if options.plant else (None, [])
    none = Stance(np.zeros((len(motions[0]), 2, 2), np.bool_), np.zeros((len(motions[0]), 2)))
    state = _Played(motions[0], motions[0], 0, none if feet is None else feet.stance(0, motions[0]))
    places: list[JoinPlace] = []
    frames: list[int] = []
    lasting: list[float] = []
    about = np.zeros(len(motions[0]), np.bool_)
    planted = None
    for k, motion in enumerate(motions[1:]):
        trial = _best_join(state, motion, feet, k + 1, options, at[k] if k < len(at) else (None, None))
        leave = state.begins + trial.place.leave
        if frames and leave <= frames[-1]:
            raise MuybridgeError(f"{names[k]} would be left before it has begun to play: join it later on")
        places.append(trial.place)
        frames.append(leave)
        lasting.append(trial.seconds)
        out, here = trial.motion, _about(leave, trial.seconds, options, len(trial.motion), motion.fps)
        if feet is not None:
            out, planted = feet.plant(out, trial.stance, here, trial.seconds)
        about = np.concatenate([about[: leave + 1], np.zeros(len(out) - leave - 1, np.bool_)]) | here
        state = _Played(out, trial.place.placed(motion), leave - trial.place.enter, trial.stance)
    return Joined(state.whole, tuple(places), tuple(frames), tuple(lasting), planted, about, tuple(notes))


def peak_acceleration(motion: Motion) -> float:
    """Metres per second squared: the largest of any joint in any frame."""
    bends = np.diff(motion.joint_positions_world(), 2, axis=0)
    return float(np.linalg.norm(bends, axis=-1).max(initial=0.0)) * motion.fps**2


def _about(join: int, seconds: float, options: JoinOptions, count: int, fps: float) -> BoolArray:
    """(T,) the frames of a transition: those whose contacts are planted."""
    out = np.zeros(count, np.bool_)
    frames = round(seconds * fps)
    before = 0 if options.how == "inertial" else frames // 2
    out[max(join - before - 1, 0) : join + frames - before + 2] = True
    return out


@dataclass(frozen=True, eq=False)
class _Played:
    """What has been joined so far: all of it; its last motion alone, where it is; where that one's first frame is, or
    would be, in the whole; and how its feet stand."""

    whole: Motion
    last: Motion
    begins: int
    stance: Stance


@dataclass(frozen=True, eq=False)
class _Trial:
    """One join that may be made."""

    motion: Motion
    stance: Stance
    place: JoinPlace
    seconds: float
    peak: float


def _best_join(
    played: _Played, motion: Motion, feet: Feet | None, number: int, options: JoinOptions,
    at: tuple[float | None, float | None],
) -> _Trial:  # fmt: skip
    """The join at the best place to the motion of this number; of several durations, the first with an acceleration
    that the motions have too. If none has, other places are tried."""
    free = len(options.durations) > 1
    contacts = None if feet is None else (feet.contacts[number - 1], feet.contacts[number])
    places = find_joins(played.last, motion, options.overlap, options.measure, feet=feet, contacts=contacts, at=at,
                        margin=options.margin(motion.fps), count=_PLACES if free else 1)  # fmt: skip
    sources = (_accelerations(played.whole), _accelerations(motion)) if free else None
    own = max(peak_acceleration(played.last), peak_acceleration(motion)) if free else 0.0
    stance = None if feet is None else feet.stance(number, motion)
    best: _Trial | None = None
    for place in places:
        for seconds in options.durations:
            trial = _made(played, motion, feet, stance, options, place, seconds)
            if sources is not None:
                trial = _measured(trial, feet, options, (played.begins + place.leave, place.enter), sources, own,
                                  np.inf if best is None else best.peak)  # fmt: skip
            if best is None or trial.peak < best.peak:
                best = trial
            if best.peak <= _CALM * own:
                return best
            if trial.seconds < seconds:
                break
    assert best is not None
    return best


def _made(
    played: _Played, motion: Motion, feet: Feet | None, stance: Stance | None, options: JoinOptions, place: JoinPlace,
    seconds: float,
) -> _Trial:  # fmt: skip
    """One join, its feet not planted yet; `stance` is that of the motion that follows."""
    whole, leave, placed = played.whole, played.begins + place.leave, place.placed(motion)
    if leave < 1:
        raise MuybridgeError("a motion would be left before it has begun to play: join it later on")
    out, lasts = transition(whole, placed, leave, place.enter, options, seconds)
    across = Stance(np.zeros((len(out), 2, 2), np.bool_), np.zeros((len(out), 2)))
    if feet is not None and stance is not None:
        across = stance_across(feet, (whole, placed, out), (played.stance, stance), leave, place.enter)
    return _Trial(out, across, place, lasts, 0.0)


def _measured(
    trial: _Trial, feet: Feet | None, options: JoinOptions, at: tuple[int, int],
    sources: tuple[FloatArray, FloatArray], own: float, best: float,
) -> _Trial:  # fmt: skip
    """The trial with how violent it is once feet are planted; they are not where it is worse than `best` already.

    Args:
        trial: the join.
        feet: None where they are not planted.
        options: how.
        at: frames of what was played and of the motion that follows, at the join.
        sources: (T, J) m/s^2 of what was played and of the motion that follows.
        own: m/s^2, the peak of both motions.
        best: m/s^2 of the best trial so far.
    """
    count, fps = len(trial.motion), trial.motion.fps
    where = _about(at[0], trial.seconds, options, count, fps)
    piece = _piece(trial.stance, where, fps)
    made = trial.motion.select(piece)
    source = np.concatenate([sources[0][: at[0]], sources[1][at[1] :]])[piece]
    peak = _violence(made, source, own, piece, count)
    if feet is not None and peak < best:
        made, _ = feet.plant(made, trial.stance.select(piece), where[piece], trial.seconds)
        peak = _violence(made, source, own, piece, count)
    return replace(trial, peak=peak)


def _piece(stance: Stance, where: BoolArray, fps: float) -> slice:
    """The frames about a transition that planting its contacts may change."""
    at, beside, longest = np.flatnonzero(where), round(_BESIDE_S * fps), round(_LONGEST_S * fps)
    first, stop = int(at[0]), int(at[-1]) + 1
    for foot in range(2):
        for a, b in contact_spans(np.asarray(stance.contact[:, foot].any(-1))):
            if where[a:b].any():
                first, stop = min(first, a), max(stop, b)
    first, stop = max(first, int(at[0]) - longest), min(stop, int(at[-1]) + longest)
    return slice(max(first - 2 * beside, 0), min(stop + 2 * beside, len(where)))


def _violence(made: Motion, source: FloatArray, own: float, piece: slice, count: int) -> float:
    """m/s^2, the peak acceleration of a piece of a joined motion of `count` frames, of the joints and frames in which
    it is more than in the `source` (T, J) that plays there."""
    beside = round(_BESIDE_S * made.fps)  # what is there at the piece's ends goes on differently in the whole
    rows = slice(beside if piece.start else 0, len(made) - (beside if piece.stop < count else 0))
    now = _accelerations(made)
    more = (now > own) | (now > source + _CHANGED * own)
    return float(np.where(more, now, 0.0)[rows].max(initial=0.0))


def _accelerations(motion: Motion) -> FloatArray:
    """(T, J) m/s^2, zero in the first and the last frame."""
    bends = np.diff(motion.joint_positions_world(), 2, axis=0)
    return np.pad(np.linalg.norm(bends, axis=-1) * motion.fps**2, ((1, 1), (0, 0)))
