"""From unlabelled points to labelled markers: orientation and unit, network, trajectories, votes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.marker_sets import MarkerDistances, MarkerSet
from muybridge.geometry.landmarks.real_markers import find_markers
from muybridge.geometry.markers.known_distances import KNOWN_WEIGHT, known_rigidity, near_known, open_to_any
from muybridge.geometry.markers.recovery import RecoverOptions, recover_points
from muybridge.geometry.markers.rigidity import RigidityOptions, distance_scores, measured_rigidity, prior_rigidity
from muybridge.geometry.markers.subjects import split_people
from muybridge.geometry.markers.tracking import TrackOptions, Tracks, find_tracks
from muybridge.geometry.markers.voting import (
    VoteOptions,
    assign_frames,
    assign_labels,
    cut_tracks,
    join_pieces,
    share_votes,
    sort_by_track,
    vote,
)
from muybridge.geometry.markers.whole import Bodies, WholeOptions
from muybridge.infer.labelling.certainty import by_piece, certainty, evidence_of
from muybridge.infer.labelling.file_names import believe_names, columns_of, with_names
from muybridge.infer.labelling.settle import Settled, bodies_of, find_upright, judged, one_or_two, settle
from muybridge.infer.networks.labelling import LabelNetwork

_log = logging.getLogger(__name__)

# Range of the median distance to a marker's third neighbour, metres: 0.15 to 0.37 on bodies of all sizes and poses in
# the known sets, more with few markers; other people nearby change it little.
APART_M = (0.06, 1.0)
# Votes for a name that is settled by the whole, per frame.
_SETTLED = 6.0
# With more points in a frame, their extent decides, metres.
DENSE, EXTENT_M = 60, (0.7, 2.8)
FACTORS = (1.0, 0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)


@dataclass(frozen=True)
class LabelOptions:
    """How markers are labelled.

    Attributes:
        track: trajectories.
        vote: votes of trajectories.
        rigidity: distances between markers.
        recover: markers recovered after the vote.
        whole: the labelling judged as a whole.
        window: the network also takes past and future positions.
        votes: trajectories vote; otherwise every frame is labelled by itself.
        distances: distances between markers correct the network's errors.
    """

    track: TrackOptions = TrackOptions()
    vote: VoteOptions = VoteOptions()
    rigidity: RigidityOptions = RigidityOptions()
    recover: RecoverOptions = RecoverOptions()
    whole: WholeOptions = WholeOptions()
    window: bool = True
    votes: bool = True
    distances: bool = True


@dataclass(frozen=True)
class Labelled:
    """Labelled markers.

    Attributes:
        markers: the marker set, M labels.
        points: (T, M, 3) metres, in the file's axes (in metres also where the file states a wrong unit); NaN where a
            marker was not found.
        confidence: (T, M) probability that a point is this marker; 0 where there is none.
        column: (T, M) column of the file that a marker comes from, -1 where there is none.
        turn: (3, 3) rotation from the file's axes to Z up.
        factor: by which the file's points, in the unit it states, were multiplied to be in metres.
        tracks: trajectories of the file's points.
        label: (T, S) index of the label of every slot of `tracks`, -1 for none.
        notes: for the user, as sentences.
        evidence: (T, M, E) what `confidence` was computed from; None where trajectories did not vote.
    """

    markers: MarkerSet
    points: FloatArray
    confidence: FloatArray
    column: IndexArray
    turn: FloatArray
    factor: float
    tracks: Tracks
    label: IndexArray
    notes: list[str] = field(default_factory=list)
    evidence: FloatArray | None = None


def label_points(points: FloatArray, fps: float, markers: MarkerSet, network: LabelNetwork,
                 options: LabelOptions = LabelOptions(), known: MarkerDistances | None = None,
                 up: FloatArray | None = None, names: Sequence[str] = ()) -> Labelled:  # fmt: skip
    """Label the points of a recording.

    Args:
        points: (T, K, 3) metres if the file's unit is right, any axis up; NaN where missing.
        fps: frames per second.
        markers: the set to look for.
        network: scores points.
        options: of every step.
        known: distances between the person's markers, where they were measured before.
        up: (3,) the axis that the file says is up; None where it says nothing.
        names: (K,) what the file calls the points: those that are labels of the set hold unless the evidence against
            them is beyond doubt. Empty for points without names.

    Raises:
        FormatError: there are too few points to recognise a person.
    """
    count = np.isfinite(points[..., 0]).sum(1)
    if count.max(initial=0) < 6:
        raise FormatError(
            f"no frame has more than {count.max(initial=0)} points; at least 6 markers of one person are needed"
        )
    notes: list[str] = []
    scale = metres_of(points, notes)
    scaled = points * scale
    tracks = find_tracks(scaled, fps, options.track)
    if tracks.tracked:
        notes.append("the file's trajectories jump from marker to marker: the points were tracked again")
    bodies = bodies_of(network, markers, options.whole, known)
    people = split_people(tracks, len(markers))
    if len(people) > 1:
        people = one_or_two(people, tracks, fps, markers, network, bodies, options.whole, up)
    if len(people) > 1:
        notes.append("the file holds two people: the one with more points was labelled, the other's points were not")
    tracks = people[0]
    asked = np.array(markers.surface_indices)
    turn, _ = find_upright(tracks, fps, markers, network, bodies, options.whole, up)
    scores = network.scores(tracks, fps, asked, turn=turn, windowed=options.window).astype(np.float64)
    scores = open_to_any(scores) if known else scores
    for note in notes:
        _log.info(note)
    raw, label, last = scores, _elect(scores, tracks, fps, options), None
    if options.distances:
        scores, label, last = _by_distances(raw, label, tracks, fps, turn, markers, network, bodies, options, known)
    smooth = _over_time(raw, tracks.track, fps, options) if options.votes else scores
    hint, kept = columns_of(names, markers), np.zeros(len(markers), bool)
    if last is not None and (hint >= 0).any():
        foreign = ~find_markers(names).unnamed & ~np.isin(np.arange(len(names)), hint)
        sure = _labelled(markers, label, smooth, turn, scale, tracks, []).confidence
        label, kept = believe_names(label, sure, hint, foreign, raw, tracks, bodies, options.whole)
        last = judged(label, raw, tracks, turn, markers, bodies, options.whole)
    done = _labelled(markers, label, smooth, turn, scale, tracks, notes)
    if last is not None:
        fit = _fit(label, tracks, asked, network, options)
        evidence = evidence_of(done.confidence, last, fit)
        found = np.isfinite(done.points[..., 0])
        sure = with_names(by_piece(certainty(evidence), fit, done.column), done.column, hint, kept)
        done = replace(done, confidence=np.where(found, sure, 0.0), evidence=evidence)
    return done


def _by_distances(
    raw: FloatArray, label: IndexArray, tracks: Tracks, fps: float, turn: FloatArray, markers: MarkerSet,
    network: LabelNetwork, bodies: Bodies, options: LabelOptions, known: MarkerDistances | None,
) -> tuple[FloatArray, IndexArray, Settled | None]:  # fmt: skip
    """Scores that include distances between markers, the labels by them, and, where trajectories vote, the whole that
    was settled."""
    asked, scores = np.array(markers.surface_indices), raw
    if options.votes:
        first = settle(label, raw, tracks, turn, markers, bodies, options.whole)
        label = first.label
        t, s = np.nonzero(first.changed & (label >= 0))
        scores = raw.copy()
        scores[t, s, label[t, s]] = np.maximum(raw[t, s, label[t, s]], options.vote.floor) + _SETTLED
    scores, label = _repair(scores, label, tracks, fps, asked, network, options, known)
    if not options.votes:
        return scores, label, None
    last = settle(label, raw, tracks, turn, markers, bodies, options.whole)
    return scores, last.label, last


def _over_time(scores: FloatArray, track: IndexArray, fps: float, options: LabelOptions) -> FloatArray:
    """Scores averaged over half a second to either side and, with less weight, over the whole trajectory: what a
    label's confidence is computed from."""
    out = scores.copy()
    weight, half = 1.0 / (1.0 + fps * options.vote.memory), max(1, round(0.5 * fps))
    t, s, starts = sort_by_track(track)
    total = np.cumsum(np.maximum(scores[t, s], options.vote.floor), 0)
    total = np.concatenate([np.zeros((1, total.shape[1])), total])
    count = np.diff(starts)
    first, last = np.repeat(starts[:-1], count), np.repeat(starts[1:], count)
    low, high = np.maximum(np.arange(len(t)) - half, first), np.minimum(np.arange(len(t)) + half + 1, last)
    mean = (total[last] - total[first]) / (last - first)[:, None]
    out[t, s] = (total[high] - total[low]) * weight + mean * np.minimum(5.0, (last - first) * weight)[:, None]
    return out


def _labelled(
    markers: MarkerSet, label: IndexArray, scores: FloatArray, turn: FloatArray, factor: float, tracks: Tracks,
    notes: list[str],
) -> Labelled:  # fmt: skip
    shape = (len(label), len(markers))
    out, confidence, column = np.full((*shape, 3), np.nan), np.zeros(shape), np.full(shape, -1, np.intp)
    t, s = np.nonzero(label >= 0)
    m = label[t, s]
    out[t, m] = tracks.points[t, s]
    confidence[t, m] = np.exp(scores[t, s, m] - np.logaddexp.reduce(scores[t, s], -1))
    column[t, m] = tracks.column[t, s]
    return Labelled(markers, out, confidence, column, turn, factor, tracks, label, notes)


def relabel(labelled: Labelled, label: IndexArray) -> Labelled:
    """The same with labels (T, S) set by a person, which are certain."""
    sure = np.zeros((*label.shape, len(labelled.markers) + 1))
    changed = label != labelled.label
    t, s = np.nonzero((label >= 0) & ~changed)
    found = labelled.confidence[t, label[t, s]]
    sure[t, s, label[t, s]] = np.log(found / np.maximum(1 - found, 1e-9) * len(labelled.markers) + 1e-9)
    t, s = np.nonzero((label >= 0) & changed)
    sure[t, s, label[t, s]] = 20.0
    return _labelled(labelled.markers, label, sure, labelled.turn, labelled.factor, labelled.tracks, labelled.notes)


def _elect(scores: FloatArray, tracks: Tracks, fps: float, options: LabelOptions) -> IndexArray:
    if not options.votes:
        return assign_frames(scores)
    how, whole = options.vote, join_pieces(tracks.track, tracks.column, tracks.tracked)
    pieces = cut_tracks(scores, tracks.track, tracks.points, fps, how, whole)
    t, s = np.nonzero(tracks.track >= 0)
    # Trajectories share votes with the pieces of the same column that the cut left together.
    both = pieces[t, s] * (tracks.count + 1) + tracks.track[t, s]
    pair, number = np.unique(both, return_inverse=True)
    piece = np.full_like(pieces, -1)
    piece[t, s] = number
    votes, span = vote(scores, piece, fps, how)
    label = assign_labels(share_votes(votes, pair // (tracks.count + 1), how.shared), span)
    return np.where(piece >= 0, label[piece], -1)


def _repair(scores: FloatArray, label: IndexArray, tracks: Tracks, fps: float, asked: IndexArray, network: LabelNetwork,
            options: LabelOptions, known: MarkerDistances | None) -> tuple[FloatArray, IndexArray]:  # fmt: skip
    """Scores that include distances between markers, and the resulting labels."""
    how, table = options.rigidity, network.card.between(asked)
    prior = known_rigidity(known, *table, how.links) if known else prior_rigidity(*table, how.links)
    fitted, weight = scores, how.weight * (KNOWN_WEIGHT if known else 1.0)
    for turn in range(how.rounds):
        named, owner = _named(label, tracks.points, len(asked))
        measured = measured_rigidity(named, prior, how)
        if known:  # labels that known distances have corrected are measured, not those before
            measured = near_known(measured, prior) if turn else prior
        fit = distance_scores(tracks.points, named, owner, measured)
        fitted = scores.copy()
        fitted[..., :-1] = np.maximum(scores[..., :-1], options.vote.floor) + weight * 2.5 * fit
        before, label = label, _elect(fitted, tracks, fps, options)
        if np.array_equal(before, label) and (turn or not known):
            break
    if options.votes:
        label = recover_points(tracks.points, label, fitted[..., :-1] - fitted[..., -1:], options.recover)
    return fitted, label


def _fit(label: IndexArray, tracks: Tracks, asked: IndexArray, network: LabelNetwork,
         options: LabelOptions) -> FloatArray:  # fmt: skip
    """(T, M) how well every labelled point's distances fit in its frame, from -1 to 1; see `distance_scores`."""
    prior = prior_rigidity(*network.card.between(asked), options.rigidity.links)
    named, owner = _named(label, tracks.points, len(asked))
    fit = distance_scores(tracks.points, named, owner, measured_rigidity(named, prior, options.rigidity))
    out = np.zeros(named.shape[:2])
    t, m = np.nonzero(owner >= 0)
    out[t, m] = fit[t, owner[t, m], m]
    return out


def _named(label: IndexArray, points: FloatArray, count: int) -> tuple[FloatArray, IndexArray]:
    """Markers (T, A, 3) and the slots (T, A) they come from, by the slots' labels (T, S)."""
    named, owner = np.full((len(points), count, 3), np.nan), np.full((len(points), count), -1, np.intp)
    t, s = np.nonzero(label >= 0)
    named[t, label[t, s]] = points[t, s]
    owner[t, label[t, s]] = s
    return named, owner


def metres_of(points: FloatArray, notes: list[str]) -> float:
    """The factor to metres: 1 where neighbouring points are as close as a person's markers, otherwise the power of ten
    that makes them so.

    Args:
        points: (T, K, 3) in the unit that the file states.
        notes: receives a sentence where the factor is not 1.

    Raises:
        FormatError: no factor fits a person.
    """
    count = np.isfinite(points[..., 0]).sum(1)
    frames = np.nonzero(count >= 4)[0]
    frames = frames[np.linspace(0, len(frames) - 1, min(200, len(frames))).astype(int)] if len(frames) else frames
    apart, extent = [], []
    for frame in points[frames]:
        there = frame[np.isfinite(frame[:, 0])]
        apart.append(np.median(np.sort(np.linalg.norm(there[:, None] - there, axis=-1), 1)[:, 3]))
        extent.append(np.linalg.norm(np.ptp(there, axis=0)))
    usual = float(np.median(apart)) if apart else 0.0
    # Clusters of markers on every segment are closer than a set's markers, but the person has its size.
    if len(apart) and np.median(count[frames]) > DENSE and EXTENT_M[0] <= np.median(extent) <= EXTENT_M[1]:
        return 1.0
    for factor in FACTORS:
        if APART_M[0] <= usual * factor <= APART_M[1]:
            if factor != 1.0:
                notes.append(f"the file states no unit or a wrong one: its points were multiplied by {factor:g}")
            return factor
    raise FormatError(f"neighbouring points are {usual:.3g} m apart: no person in any unit; check the file's unit")
