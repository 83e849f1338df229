"""The labelling settled as a whole: which way is up, which names move, what a group such as the head looks like."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import MarkerDistances, MarkerSet
from muybridge.geometry.markers.groups import groups_of, head_posture
from muybridge.geometry.markers.tracking import Tracks
from muybridge.geometry.markers.voting import assign_labels, join_pieces, vote
from muybridge.geometry.markers.whole import Bodies, Judge, WholeOptions, find_columns, known_bodies
from muybridge.infer.networks.labelling import LabelNetwork

# What another axis than Z and Y upwards must be better by, and another than the file states, per marker.
_UNUSUAL, _AGAINST = 4.0, 2.5
# Standard deviation of distances that were measured on the person on another day, metres.
_MEASURED_M = 0.015
# Quality of the better and of the other of two people relative to that of one person made of both.
_WHOLE, _HALF = 0.85, 0.5
_FRAMES = 24
# What may be up, the usual first.
_AXES = tuple(itertools.product((2, 1, 0), (1.0, -1.0)))


@dataclass(frozen=True)
class Settled:
    """A labelling that is settled.

    Attributes:
        label: (T, S) labels, -1 for none.
        judge: of it.
        chosen: (A,) column of `judge` that each marker has, -1 for none.
        margin: (A,) by how much the order of a group is better than the best in which the marker has another place;
            infinite for markers of no group.
        changed: (T, S) whether the label of a slot is another one than before.
    """

    label: IndexArray
    judge: Judge
    chosen: IndexArray
    margin: FloatArray
    changed: BoolArray


def bodies_of(network: LabelNetwork, markers: MarkerSet, options: WholeOptions,
              known: MarkerDistances | None = None) -> Bodies:  # fmt: skip
    """What the network's metadata say about the distances of a set, and what was measured on the person before."""
    out = known_bodies(*network.card.between(markers.surface_indices), markers.names, options)
    if known is None:
        return out
    there = np.isfinite(known.mean_m)
    return replace(out, distance_m=np.where(there, known.mean_m, out.distance_m),
                   sigma_m=np.where(there, _MEASURED_M, out.sigma_m))  # fmt: skip


def settle(label: IndexArray, scores: FloatArray, tracks: Tracks, turn: FloatArray, markers: MarkerSet, bodies: Bodies,
           options: WholeOptions, present: FloatArray | None = None) -> Settled:  # fmt: skip
    """Move names to where the whole is better.

    Args:
        label: (T, S) labels so far, -1 for none.
        scores: (T, S, A + 1) log probabilities; NaN where there is no point.
        tracks: trajectories.
        turn: (3, 3) to Z up.
        markers: the set.
        bodies: its distances.
        options: see `WholeOptions`.
        present: (A,) what every name found is worth, in place of that of the options.
    """
    whole = join_pieces(tracks.track, tracks.column, tracks.tracked)
    judge = Judge(find_columns(tracks.points, whole, label, scores, options, present), bodies, options)
    chosen, margin = settle_groups(judge, judge.improve(judge.start), turn, markers)
    out = np.full_like(label, -1)
    size = len(markers)
    for a, k in enumerate(chosen):
        if 0 <= k < size:
            out[label == k] = a
        elif k >= size:
            out[(whole == judge.columns.piece[k]) & (label < 0)] = a
    return Settled(out, judge, chosen, margin, out != label)


def judged(label: IndexArray, scores: FloatArray, tracks: Tracks, turn: FloatArray, markers: MarkerSet, bodies: Bodies,
           options: WholeOptions) -> Settled:  # fmt: skip
    """A labelling as it is, with its judge and margins; arguments as `settle`."""
    whole = join_pieces(tracks.track, tracks.column, tracks.tracked)
    judge = Judge(find_columns(tracks.points, whole, label, scores, options), bodies, options)
    _, margin = settle_groups(judge, judge.start, turn, markers, move=False)
    return Settled(label, judge, judge.start, margin, np.zeros(label.shape, bool))


def settle_groups(judge: Judge, chosen: IndexArray, turn: FloatArray, markers: MarkerSet,
                  move: bool = True) -> tuple[IndexArray, FloatArray]:  # fmt: skip
    """The best order of the names within the head, the hands and the feet, which the network may mistake as a whole,
    and the margins of `Settled`; with `move` off the order stays, and margins are negative where another is better."""
    out, margin = chosen.copy(), np.full(len(chosen), np.inf)
    for group in groups_of(markers.names):
        members = np.array(group)
        here = members[out[members] >= 0]
        if len(here) < 2:
            continue
        head = markers.names[here[0]].endswith("_head")
        orders, values = _orders(len(here)), []
        for order in orders:
            trial = out.copy()
            trial[here] = out[here[list(order)]]
            value = judge.geometry(trial) + judge.options.group * judge.network(trial)
            if head:
                value += head_posture(judge.columns.place @ turn.T, trial, markers.names)
            values.append(value)
        # Where two orders are equally good the first one stays.
        first = int(np.argmax(np.array(values) - 1e-9 * np.arange(len(values)))) if move else 0
        for i, a in enumerate(here):
            margin[a] = values[first] - max(v for o, v in zip(orders, values, strict=True) if o[i] != orders[first][i])
        out[here] = out[here[list(orders[first])]]
    return out, margin


def _orders(count: int) -> list[tuple[int, ...]]:
    """All orders of up to 4, beyond that exchanges of two and three."""
    if count <= 4:
        return list(itertools.permutations(range(count)))
    same = tuple(range(count))
    out = {same: None}
    for three in itertools.combinations(range(count), 3):
        for order in itertools.permutations(three):
            moved = list(same)
            for a, b in zip(three, order, strict=True):
                moved[a] = b
            out[tuple(moved)] = None
    return list(out)


def find_upright(tracks: Tracks, fps: float, markers: MarkerSet, network: LabelNetwork, bodies: Bodies,
            options: WholeOptions, stated: FloatArray | None = None) -> tuple[FloatArray, float]:  # fmt: skip
    """The rotation to Z up, of six candidates for the file's vertical axis, and the quality of the labelling with it:
    the best whole labelling decides.

    Args:
        tracks: trajectories.
        fps: frames per second.
        markers: the set.
        network: scores points.
        bodies: distances of the set.
        options: see `WholeOptions`.
        stated: (3,) what the file says is up, which is believed unless it is far worse; None where it says nothing.
    """
    frames = _full_frames(tracks)
    some = Tracks(tracks.points[frames], tracks.track[frames], tracks.column[frames], tracks.tracked)
    asked = np.array(markers.surface_indices)
    found = []
    for axis, sign in _AXES:
        turn = up_turn(axis, sign)
        prior = 0.0 if (axis, sign) in ((2, 1.0), (1, 1.0)) else -_UNUSUAL
        if stated is not None:
            prior = 0.0 if float(turn[2] @ stated) > 0.9 else -_AGAINST * len(markers)
        scores = network.scores(tracks, fps, asked, frames, turn).astype(np.float64)
        votes, span = vote(scores, some.track, 0.0)
        t, s = np.nonzero(some.track >= 0)
        label = np.full(some.track.shape, -1, np.intp)
        of_track = dict(zip(np.unique(some.track[t, s]), assign_labels(votes, span), strict=True))
        label[t, s] = [of_track[n] for n in some.track[t, s]]
        judge = Judge(find_columns(some.points, some.track, label, scores, options), bodies, options)
        found.append((judge.quality(judge.start) + prior, prior, judge, turn))
    found.sort(key=lambda f: -f[0])
    best, most = found[0][3], -np.inf
    quick = replace(options, rounds=2)
    for first, prior, judge, turn in found:
        if first < found[0][0] - 4.0 * len(markers):
            continue
        judge.options = quick
        value = judge.quality(judge.improve(judge.start)) + prior
        if value > most:
            best, most = turn, value
    return best, most


def upright_by_network(tracks: Tracks, fps: float, asked: IndexArray, network: LabelNetwork) -> FloatArray:
    """The rotation to Z up, of six candidates, with which the network is most confident: for recordings whose markers
    are of no set yet. Arguments as `find_upright`; `asked` (A,) are points of `SURFACE`."""
    frames = _full_frames(tracks)
    best, most = np.eye(3), -np.inf
    for axis, sign in _AXES:
        turn = up_turn(axis, sign)
        scores = network.scores(tracks, fps, asked, frames, turn)
        known = np.isfinite(scores[..., 0])
        confidence = float(scores[known][:, :-1].max(1).clip(-6).mean())
        if confidence > most:
            best, most = turn, confidence
    return best


def _full_frames(tracks: Tracks) -> IndexArray:
    """Frames over the whole recording in which most points are there."""
    full = (tracks.track >= 0).sum(1)
    frames = np.linspace(0, len(full) - 1, min(_FRAMES, len(full))).astype(int)
    frames = frames[full[frames] >= 0.6 * full.max()]
    return frames if len(frames) else np.array([int(full.argmax())])


def one_or_two(people: list[Tracks], everybody: Tracks, fps: float, markers: MarkerSet, network: LabelNetwork,
               bodies: Bodies, options: WholeOptions, stated: FloatArray | None = None) -> list[Tracks]:  # fmt: skip
    """Two people only where both are whole bodies: with many markers beyond the set, one person's legs and trunk look
    like two groups. Arguments as `find_upright`."""
    one, *two = (find_upright(p, fps, markers, network, bodies, options, stated)[1] for p in (everybody, *people))
    return people if max(two) > _WHOLE * one and min(two) > _HALF * one else [everybody]


def up_turn(axis: int, sign: float) -> FloatArray:
    """A rotation that turns the signed axis of the file to +Z."""
    up = np.zeros(3)
    up[axis] = sign
    x = np.roll(np.abs(up), 1)
    return np.stack([x, np.cross(up, x), up])
