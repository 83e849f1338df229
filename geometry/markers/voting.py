"""Labels of whole trajectories from scores of every point in every frame.

The frames of a trajectory vote; where their vote changes permanently (two markers were exchanged), the trajectory is
split; two trajectories that overlap in time never share a label.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.numerics._numba import compiled_with


@dataclass(frozen=True)
class VoteOptions:
    """How trajectories vote.

    Attributes:
        memory: correlation time of the network's errors, seconds; frames closer than that share one vote.
        floor: smallest log probability that a frame can hold against a label.
        switch: cost, in votes, of a label change where the trajectory may have been exchanged: where it jumps, or
            another one's path leads to its position.
        smooth: cost, in votes, of a label change elsewhere.
        gap: cost, in votes, of a label change across a gap of one of the file's columns.
        shared: weight that the votes of a column's other pieces have for a piece between gaps.
    """

    memory: float = 0.12
    floor: float = -5.0
    switch: float = 8.0
    smooth: float = 40.0
    gap: float = 6.0
    shared: float = 0.5


def assign_frames(scores: FloatArray, floor: float = -9.0) -> IndexArray:
    """Labels (T, S) of points from the scores (T, S, L + 1) of each frame alone, -1 for none.

    The best assignment in which each label is used once. Missing points have NaN scores.
    """
    count, slots, columns = scores.shape
    out = np.full((count, slots), -1, np.intp)
    for t in range(count):
        there = np.nonzero(np.isfinite(scores[t, :, 0]))[0]
        if not len(there):
            continue
        gain = np.maximum(scores[t, there, :-1], floor) - np.maximum(scores[t, there, -1:], floor)
        best = np.concatenate([gain, np.zeros((len(there), len(there)))], 1)
        rows, cols = scipy.optimize.linear_sum_assignment(best, maximize=True)
        real = cols < columns - 1
        out[t, there[rows[real]]] = cols[real]
    return out


def cut_tracks(
    scores: FloatArray, track: IndexArray, points: FloatArray, fps: float, options: VoteOptions = VoteOptions(),
    whole: IndexArray | None = None,
) -> IndexArray:  # fmt: skip
    """Track numbers (T, S) of trajectories split where their label changes permanently.

    Args:
        scores: (T, S, L + 1) log probabilities, NaN where there is no point.
        track: (T, S) numbers, -1 where there is no point.
        points: (T, S, 3) metres, NaN where there is no point.
        fps: frames per second.
        options: see `VoteOptions`.
        whole: (T, S) numbers of what trajectories are pieces of, see `join_pieces`; a piece between gaps mostly is the
            marker that its neighbours are.
    """
    # A marker does not become a ghost; whether it is one is decided by the votes.
    t, s, starts = sort_by_track(track if whole is None else whole)
    votes = _weight(fps, options) * np.maximum(scores[t, s, :-1], options.floor)
    cost = np.where(exchangeable(points, track)[t, s], options.switch, options.smooth)
    number = track[t, s]
    cost[1:][number[1:] != number[:-1]] = options.gap
    out = np.full_like(track, -1)
    out[t, s] = _cut(np.ascontiguousarray(votes), starts, cost)
    return out


def join_pieces(track: IndexArray, column: IndexArray, tracked: bool) -> IndexArray:
    """(T, S) numbers of what trajectories are pieces of: the file's columns, or the trajectories themselves where they
    were tracked."""
    return np.asarray(track if tracked else np.where(track >= 0, column, -1))


def exchangeable(points: FloatArray, track: IndexArray, slack: float = 0.03) -> BoolArray:
    """(T, S) where a trajectory may continue as another marker; arguments as `cut_tracks`.

    There the step is a jump, or the path of another trajectory leads there as well, within `slack` metres.
    """
    out = np.zeros(track.shape, np.bool_)
    _exchangeable(np.ascontiguousarray(points), np.ascontiguousarray(track), slack, out)
    return out


@compiled_with()
def _exchangeable(points: FloatArray, track: IndexArray, slack: float, out: BoolArray) -> None:
    count, slots = track.shape
    ahead = np.empty((slots, 3))
    for t in range(1, count):
        for s in range(slots):
            before = track[t - 1, s]
            if before >= 0:
                moving = t > 1 and track[t - 2, s] == before
                for i in range(3):
                    step = points[t - 1, s, i] - points[t - 2, s, i] if moving else 0.0
                    ahead[s, i] = points[t - 1, s, i] + step
        for s in range(slots):
            if track[t, s] < 0 or track[t - 1, s] != track[t, s]:
                continue
            own = 0.0
            for i in range(3):
                own += (points[t, s, i] - ahead[s, i]) ** 2
            reach = np.sqrt(own) + slack
            if reach > 2 * slack:
                out[t, s] = True
                continue
            for r in range(slots):
                if r != s and track[t - 1, r] >= 0:
                    off = 0.0
                    for i in range(3):
                        off += (points[t, s, i] - ahead[r, i]) ** 2
                    if off < reach * reach:
                        out[t, s] = True
                        break


def vote(
    scores: FloatArray, track: IndexArray, fps: float, options: VoteOptions = VoteOptions()
) -> tuple[FloatArray, IndexArray]:
    """Votes (P, L + 1) of every trajectory, and its first and last frame (P, 2); arguments as `cut_tracks`."""
    t, s, starts = sort_by_track(track)
    if not len(t):
        return np.zeros((0, scores.shape[2])), np.zeros((0, 2), np.intp)
    votes = np.add.reduceat(np.maximum(scores[t, s], options.floor), starts[:-1], 0)
    return votes * _weight(fps, options), np.stack([t[starts[:-1]], t[starts[1:] - 1]], 1)


def share_votes(votes: FloatArray, whole: IndexArray, share: float, most: float = 40.0) -> FloatArray:
    """Votes (P, L + 1) of pieces with a share of those of the other pieces of the same whole (P,)."""
    total = np.zeros((int(whole.max(initial=-1)) + 1, votes.shape[1]))
    np.add.at(total, whole, votes)
    others = share * (total[whole] - votes)
    lowest = others.min(1, keepdims=True, initial=0.0)
    shared: FloatArray = votes + others * np.minimum(1.0, most / np.maximum(-lowest, 1e-9))
    return shared


def assign_labels(votes: FloatArray, span: IndexArray, rounds: int = 8) -> IndexArray:
    """Assign labels to trajectories.

    Maximises the votes: greedily first, then by moving one trajectory to a label and the one that has it to its next
    best, as long as that gains votes, and by the best assignment (Hungarian method) of all trajectories in some frames.

    Args:
        votes: (P, L + 1), the last column for being no marker.
        span: (P, 2) first and last frame; trajectories that share a frame share no label.
        rounds: number of improvement rounds.

    Returns:
        (P,) labels, -1 for none.
    """
    gain = np.ascontiguousarray(votes[:, :-1] - votes[:, -1:])
    label = np.full(len(votes), -1, np.intp)
    if gain.size:
        order = np.argsort(-gain.max(1), kind="stable")
        first, last = np.ascontiguousarray(span[:, 0]), np.ascontiguousarray(span[:, 1])
        beside, starts = _overlaps(first, last)
        _elect(gain, beside, starts, order, label, rounds, True)
        for frame in np.unique(np.quantile(first, np.linspace(0, 1, 12)).astype(int)):
            _assign_at(frame, gain, first, last, label)
        _elect(gain, beside, starts, order, label, rounds, False)
    return label


def _assign_at(frame: int, gain: FloatArray, first: IndexArray, last: IndexArray, label: IndexArray) -> None:
    """Assign the best labels to all trajectories of a frame, as far as others do not have them."""
    here = np.nonzero((first <= frame) & (last >= frame))[0]
    allowed = gain[here].copy()
    named = np.nonzero(label >= 0)[0]
    named = named[~np.isin(named, here)]
    for i, p in enumerate(here):
        allowed[i, label[named[(first[named] <= last[p]) & (last[named] >= first[p])]]] = -1e9
    rows, cols = scipy.optimize.linear_sum_assignment(
        np.concatenate([allowed, np.zeros((len(here), len(here)))], 1), maximize=True
    )
    label[here[rows]] = np.where(cols < gain.shape[1], cols, -1)


@compiled_with()
def _overlaps(first: IndexArray, last: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Overlapping trajectories: those of trajectory p are beside[starts[p] : starts[p + 1]]."""
    order = np.argsort(first)
    begin = first[order]
    count = np.zeros(len(first) + 1, np.intp)
    for p in range(len(first)):
        for i in range(np.searchsorted(begin, first[p]), np.searchsorted(begin, last[p], side="right")):
            q = order[i]
            # Of two that start together, each finds the other; one of them counts the pair.
            if q != p and (first[q] > first[p] or q > p):
                count[p + 1] += 1
                count[q + 1] += 1
    starts = np.cumsum(count)
    beside, filled = np.empty(starts[-1], np.intp), starts.copy()
    for p in range(len(first)):
        for i in range(np.searchsorted(begin, first[p]), np.searchsorted(begin, last[p], side="right")):
            q = order[i]
            if q != p and (first[q] > first[p] or q > p):
                beside[filled[p]] = q
                beside[filled[q]] = p
                filled[p] += 1
                filled[q] += 1
    return beside, starts


@compiled_with()
def _elect(
    gain: FloatArray,
    beside: IndexArray,
    starts: IndexArray,
    order: IndexArray,
    label: IndexArray,
    rounds: int,
    fresh: bool,
) -> None:
    for p in order:
        if fresh or label[p] < 0:
            label[p] = _free(p, gain, beside, starts, label)
    for _ in range(rounds):
        moved = False
        for p in order:
            moved |= _improve(p, gain, beside, starts, label)
        if not moved:
            break


@compiled_with()
def _free(p: int, gain: FloatArray, beside: IndexArray, starts: IndexArray, label: IndexArray) -> int:
    """The best label that no overlapping trajectory has, -1 where none gains votes."""
    taken = np.zeros(gain.shape[1], np.bool_)
    for q in beside[starts[p] : starts[p + 1]]:
        if label[q] >= 0:
            taken[label[q]] = True
    best, most = -1, 0.0
    for c in range(gain.shape[1]):
        if not taken[c] and gain[p, c] > most:
            best, most = c, gain[p, c]
    return best


@compiled_with()
def _improve(p: int, gain: FloatArray, beside: IndexArray, starts: IndexArray, label: IndexArray) -> bool:
    """Give `p` a label with more votes if the trajectory that has it can be moved at a smaller loss."""
    old = label[p]
    now = gain[p, old] if old >= 0 else 0.0
    for new in np.argsort(-gain[p])[:5]:
        if gain[p, new] <= now:
            return False
        rivals = [q for q in beside[starts[p] : starts[p + 1]] if label[q] == new]
        before = now
        for q in rivals:
            before += gain[q, new]
            label[q] = -1
        label[p] = new
        after = gain[p, new]
        for q in rivals:
            label[q] = _free(q, gain, beside, starts, label)
            if label[q] >= 0:
                after += gain[q, label[q]]
        if after > before + 1e-9:
            return True
        for q in rivals:
            label[q] = new
        label[p] = old
    return False


def _weight(fps: float, options: VoteOptions) -> float:
    return 1.0 / (1.0 + fps * options.memory)


def sort_by_track(track: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Frames and slots of all points, sorted by trajectory, and the start of each trajectory (P + 1)."""
    t, s = np.nonzero(track >= 0)
    number = track[t, s]
    order = np.lexsort((t, number))
    cuts = np.nonzero(np.diff(number[order]))[0] + 1
    return t[order], s[order], np.concatenate([[0], cuts, [len(t)]]).astype(np.intp)


@compiled_with()
def _cut(votes: FloatArray, starts: IndexArray, switch: FloatArray) -> IndexArray:
    """(N,) a number for every piece of every trajectory."""
    out = np.empty(len(votes), np.intp)
    number = -1
    for p in range(len(starts) - 1):
        if starts[p] == starts[p + 1]:
            continue
        path = _best_path(votes[starts[p] : starts[p + 1]], switch[starts[p] : starts[p + 1]])
        for i in range(len(path)):
            if i == 0 or path[i] != path[i - 1]:
                number += 1
            out[starts[p] + i] = number
    return out


@compiled_with()
def _best_path(votes: FloatArray, switch: FloatArray) -> IndexArray:
    """The labels (N,) of the best path through votes (N, L), where a change at i costs `switch[i]` (Viterbi)."""
    count, labels = votes.shape
    came = np.empty((count, labels), np.intp)
    best = votes[0].copy()
    for i in range(1, count):
        top = 0
        for c in range(labels):
            if best[c] > best[top]:
                top = c
        changed = best[top] - switch[i]
        for c in range(labels):
            came[i, c] = c if best[c] >= changed else top
            best[c] = max(best[c], changed) + votes[i, c]
    out = np.empty(count, np.intp)
    out[count - 1] = best.argmax()
    for i in range(count - 1, 0, -1):
        out[i - 1] = came[i, out[i]]
    return out
