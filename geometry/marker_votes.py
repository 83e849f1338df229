"""From scores of every point in every frame to labels of whole trajectories.

A trajectory's frames vote; where they change their mind for good (two markers were exchanged), it is cut; two
trajectories that are there at the same time never share a label.
"""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Float = NDArray[np.float64]
Int = NDArray[np.intp]


@dataclass(frozen=True)
class VoteOptions:
    """How trajectories vote.

    Attributes:
        memory: seconds over which a network's errors are alike, so that frames closer than that share one vote.
        floor: least logarithm of a probability that a frame can hold against a label.
        switch: votes that it costs a trajectory to change its label.
    """

    memory: float = 0.12
    floor: float = -5.0
    switch: float = 8.0


def assign_frames(scores: Float, floor: float = -9.0) -> Int:
    """Labels (T, S) of points by every frame's scores (T, S, L + 1) alone, -1 for none: the best assignment in which
    a label is given once. Points that are not there have NaN scores."""
    count, slots, columns = scores.shape
    out = np.full((count, slots), -1, np.intp)
    for t in range(count):
        there = np.nonzero(np.isfinite(scores[t, :, 0]))[0]
        if not len(there):
            continue
        gain = np.maximum(scores[t, there, :-1], floor) - np.maximum(scores[t, there, -1:], floor)
        best = np.concatenate([gain, np.zeros((len(there), len(there)))], 1)
        rows, cols = linear_sum_assignment(best, maximize=True)
        real = cols < columns - 1
        out[t, there[rows[real]]] = cols[real]
    return out


def cut_tracks(scores: Float, track: Int, fps: float, options: VoteOptions = VoteOptions()) -> Int:
    """Track numbers (T, S) with trajectories cut where their label changes for good.

    Args:
        scores: (T, S, L + 1) logarithms, NaN where no point is.
        track: (T, S) numbers, -1 where no point is.
        fps: frames a second.
        options: how.
    """
    weight = _weight(fps, options)
    out = np.full_like(track, -1)
    number = 0
    for t, s in _members(track):
        votes = weight * np.maximum(np.nan_to_num(scores[t, s], nan=options.floor), options.floor)
        path = _best_path(np.ascontiguousarray(votes, np.float64), options.switch)
        piece = np.cumsum(np.concatenate([[0], path[1:] != path[:-1]]))
        out[t, s] = number + piece
        number += int(piece[-1]) + 1
    return out


def vote(scores: Float, track: Int, fps: float, options: VoteOptions = VoteOptions()) -> tuple[Float, list[Int]]:
    """Votes (P, L + 1) of every trajectory, and its frames; arguments as `cut_tracks`."""
    members = _members(track)
    votes = np.zeros((len(members), scores.shape[2]))
    for p, (t, s) in enumerate(members):
        votes[p] = np.maximum(np.nan_to_num(scores[t, s], nan=options.floor), options.floor).sum(0)
    return votes * _weight(fps, options), [t for t, _ in members]


def elect(votes: Float, overlap: NDArray[np.bool_]) -> Int:
    """Labels (P,) of trajectories, -1 for none.

    Args:
        votes: (P, L + 1), the last column for being no marker.
        overlap: (P, P) whether two are there at the same time.

    The votes won are maximised: greedily first, then by moving one trajectory to a label and whoever stands there to
    its next best, as long as that wins votes.
    """
    gain = votes[:, :-1] - votes[:, -1:]
    label = np.full(len(votes), -1, np.intp)
    order = np.argsort(-np.partition(gain, -1, 1)[:, -1]) if gain.size else np.zeros(0, np.intp)
    for p in order:
        label[p] = _free(p, label, gain, overlap)
    for _ in range(8):
        moved = False
        for p in order:
            moved |= _improve(int(p), label, gain, overlap)
        if not moved:
            break
    return label


def _free(p: int, label: Int, gain: Float, overlap: NDArray[np.bool_]) -> int:
    """The best label that no trajectory beside `p` has, -1 where none wins votes."""
    taken = label[overlap[p] & (label >= 0)]
    own = gain[p].copy()
    own[taken] = -np.inf
    best = int(own.argmax())
    return best if own[best] > 0 else -1


def _improve(p: int, label: Int, gain: Float, overlap: NDArray[np.bool_]) -> bool:
    now = gain[p, label[p]] if label[p] >= 0 else 0.0
    for new in np.argsort(-gain[p])[:5]:
        if gain[p, new] <= now or new == label[p]:
            break
        rivals = np.nonzero(overlap[p] & (label == new))[0]
        trial = label.copy()
        trial[rivals], trial[p] = -1, new
        for q in rivals[np.argsort(-gain[rivals, new])]:
            trial[q] = _free(int(q), trial, gain, overlap)
        changed = np.append(rivals, p)
        before = sum(gain[q, label[q]] for q in changed if label[q] >= 0)
        after = sum(gain[q, trial[q]] for q in changed if trial[q] >= 0)
        if after > before + 1e-9:
            label[:] = trial
            return True
    return False


def overlaps(frames: list[Int], count: int) -> NDArray[np.bool_]:
    """(P, P) which trajectories share a frame; `frames` those of each, of `count` in all."""
    there = np.zeros((len(frames), count), np.float32)
    for p, t in enumerate(frames):
        there[p, t] = 1
    out = there @ there.T > 0
    np.fill_diagonal(out, False)
    return np.asarray(out)


def _weight(fps: float, options: VoteOptions) -> float:
    return 1.0 / (1.0 + fps * options.memory)


def _members(track: Int) -> list[tuple[Int, Int]]:
    """Frames and slots of every trajectory, in the order of their numbers."""
    t, s = np.nonzero(track >= 0)
    number = track[t, s]
    order = np.lexsort((t, number))
    cuts = np.nonzero(np.diff(number[order]))[0] + 1
    if not len(order):
        return []
    return list(zip(np.split(t[order], cuts), np.split(s[order], cuts), strict=True))


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _best_path(votes: Float, switch: float) -> Int:
    """The labels (N,) of the best course through votes (N, L), each change costing `switch` (Viterbi)."""
    count, labels = votes.shape
    came = np.empty((count, labels), np.intp)
    best = votes[0].copy()
    for i in range(1, count):
        top = 0
        for c in range(labels):
            if best[c] > best[top]:
                top = c
        for c in range(labels):
            if best[c] >= best[top] - switch:
                came[i, c] = c
                best[c] += votes[i, c]
            else:
                came[i, c] = top
                best[c] = best[top] - switch + votes[i, c]
    out = np.empty(count, np.intp)
    out[count - 1] = best.argmax()
    for i in range(count - 1, 0, -1):
        out[i - 1] = came[i, out[i]]
    return out
