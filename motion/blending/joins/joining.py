"""Motions one behind the other, joined where they are most alike."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.joins.join_places import JoinPlace, check_long_enough, find_joins
from muybridge.motion.blending.joins.planting import Feet, contacts_across, find_feet
from muybridge.motion.blending.joins.transitions import JoinOptions, transition
from muybridge.motion.contacts.feet import feet_of_motion
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.footskate import contact_spans, measure_footskate

_PLACES = 4  # that are tried where the transition would be violent
_CALM = 0.8  # of the motions' own peak acceleration, that a transition may reach
_BESIDE_S = 0.6  # before and behind a transition, that planting its feet may change


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
    standing = np.zeros((len(motions[0]), 2, 2), np.bool_) if feet is None else feet.contacts[0].contact
    state = _Played(motions[0], motions[0], 0, standing)
    places: list[JoinPlace] = []
    frames: list[int] = []
    lasting: list[float] = []
    for k, motion in enumerate(motions[1:]):
        trial = _best_join(state, motion, feet, k + 1, options, at[k] if k < len(at) else (None, None))
        leave = state.begins + trial.place.leave
        if frames and leave <= frames[-1]:
            raise MuybridgeError(f"{names[k]} would be left before it has begun to play: join it later on")
        places.append(trial.place)
        frames.append(leave)
        lasting.append(trial.seconds)
        state = _Played(trial.motion, trial.place.placed(motion), leave - trial.place.enter, trial.standing)
    out, planted = state.whole, None
    about = _about(frames, lasting, options, len(out), out.fps)
    if feet is not None:
        out, planted = feet.plant(out, state.standing, about)
    return Joined(out, tuple(places), tuple(frames), tuple(lasting), planted, about, tuple(notes))


def peak_acceleration(motion: Motion) -> float:
    """Metres per second squared: the largest of any joint in any frame."""
    bends = np.diff(motion.joint_positions_world(), 2, axis=0)
    return float(np.linalg.norm(bends, axis=-1).max(initial=0.0)) * motion.fps**2


def _about(joins: Sequence[int], lasting: Sequence[float], options: JoinOptions, count: int, fps: float) -> BoolArray:
    """(T,) the frames of transitions: those whose contacts are planted."""
    out = np.zeros(count, np.bool_)
    for join, seconds in zip(joins, lasting, strict=True):
        frames = round(seconds * fps)
        before = 0 if options.how == "inertial" else frames // 2
        out[max(join - before - 1, 0) : join + frames - before + 2] = True
    return out


@dataclass(frozen=True, eq=False)
class _Played:
    """What has been joined so far: all of it; its last motion alone, where it is; where that one's first frame is, or
    would be, in the whole; and (T, 2, 2) which feet stand."""

    whole: Motion
    last: Motion
    begins: int
    standing: BoolArray


@dataclass(frozen=True, eq=False)
class _Trial:
    """One join that may be made."""

    motion: Motion
    standing: BoolArray
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
    limit = _CALM * max(peak_acceleration(played.last), peak_acceleration(motion)) if free else 0.0
    best: _Trial | None = None
    for place in places:
        for seconds in options.durations:
            trial = _try(played, motion, feet, number, options, place, seconds, measured=free)
            if best is None or trial.peak < best.peak:
                best = trial
            if best.peak <= limit:
                return best
            if trial.seconds < seconds:
                break
    assert best is not None
    return best


def _try(
    played: _Played, motion: Motion, feet: Feet | None, number: int, options: JoinOptions, place: JoinPlace,
    seconds: float, measured: bool,
) -> _Trial:  # fmt: skip
    """One join, and the peak of its acceleration about the transition, its feet planted, where that is measured."""
    whole, leave, placed = played.whole, played.begins + place.leave, place.placed(motion)
    if leave < 1:
        raise MuybridgeError("a motion would be left before it has begun to play: join it later on")
    out, lasts = transition(whole, placed, leave, place.enter, options, seconds)
    standing = np.zeros((len(out), 2, 2), np.bool_)
    if feet is not None:
        both = played.standing, feet.contacts[number].contact
        standing = contacts_across(feet, (whole, placed, out), both, leave, place.enter)
    if not measured:
        return _Trial(out, standing, place, lasts, 0.0)
    beside = round(_BESIDE_S * motion.fps)
    first, stop = max(leave - 2 * beside, 0), leave + round(lasts * motion.fps) + 2 * beside
    piece = out.select(slice(first, stop))
    if feet is not None:
        where = _about([leave - first], [lasts], options, len(piece), piece.fps)
        piece, _ = feet.plant(piece, standing[first:stop], where)
    begin = max(leave - beside - first, 0)
    return _Trial(out, standing, place, lasts, peak_acceleration(piece.select(slice(begin, stop - first - beside))))
