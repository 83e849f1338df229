"""Which frames one can go on from for ever: the largest strongly connected component, and the threshold for it."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.motion.graphs.transitions import Transitions

# Of the frames that any threshold connects: so many are enough.
_ENOUGH = 0.9
_TIGHT_QUANTILE, _LOOSE_QUANTILE = 0.1, 0.75
_LEAST_M = 0.005  # a threshold that is chosen for motions that hardly move


@dataclass(frozen=True)
class Choice:
    """The threshold of a graph's transitions.

    Attributes:
        threshold: metres.
        chosen: whether it was chosen, rather than given.
        connected: frames in the largest component.
        most: frames in it with the loosest threshold of all.
        needed: metres, the threshold that connects nine in ten of those.
        usual: metres that the motions themselves go in half a window, the 75th percentile.
    """

    threshold: float
    chosen: bool
    connected: int
    most: int
    needed: float
    usual: float


def in_largest_component(leave: IntArray, enter: IntArray, starts: IntArray, window: int) -> BoolArray:
    """(F,) whether a frame is in the largest set of frames each of which can be reached from each.

    Args:
        leave: (E,) frames at which transitions begin.
        enter: (E,) frames at which the windows begin that they go to; what follows is played behind the window.
        starts: (C + 1,) of the clips.
        window: frames.
    """
    frames = int(starts[-1])
    clip = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    inside = enter + window < frames
    leave, enter = leave[inside], enter[inside]
    same = clip[enter + window] == clip[enter]
    following = np.flatnonzero(clip[:-1] == clip[1:])
    rows = np.concatenate([following, leave[same]])
    columns = np.concatenate([following + 1, enter[same] + window])
    graph = csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(frames, frames))
    _, number = connected_components(graph, directed=True, connection="strong")
    counts = np.bincount(number)
    largest = int(np.argmax(counts))
    return np.asarray(number == largest) if counts[largest] > 1 else np.zeros(frames, np.bool_)


def choose_threshold(ways: Transitions, starts: IntArray, window: int, given: float | None, lags: FloatArray) -> Choice:
    """The threshold of transitions, and what it connects.

    The smallest one that connects nine in ten of the frames that any would, but within bounds that the motions
    themselves set: a transition is no faster than they are if windows are no farther apart than one and the one that
    begins half a window later. It is at least the tenth percentile of that distance, at most the 75th.

    Args:
        ways: all transitions.
        starts: (C + 1,) of the clips.
        window: frames.
        given: metres; None chooses.
        lags: (L,) metres between windows of one clip that are half a window apart.

    Raises:
        MuybridgeError: transitions connect nothing, whatever the threshold.
    """

    def connected(threshold: float) -> int:
        good = ways.select(ways.distance <= threshold)
        return int(in_largest_component(good.leave, good.enter, starts, window).sum())

    values = np.unique(ways.distance)
    most = connected(np.inf) if len(values) else 0
    if not most:
        raise MuybridgeError(
            "no transition leads back to where the motion was, at any threshold: the clips are too short, or nothing "
            "in them is done twice; add longer ones, or several of one kind"
        )
    needed = _least(values, lambda v: connected(v) >= _ENOUGH * most)
    tight = usual = _LEAST_M
    if len(lags):
        tight, usual = (max(float(q), _LEAST_M) for q in np.quantile(lags, (_TIGHT_QUANTILE, _LOOSE_QUANTILE)))
    threshold = given if given is not None else float(np.clip(needed, tight, usual))
    count = connected(threshold)
    if not count:
        least = _least(values, lambda v: connected(v) > 0)
        what = "given" if given is not None else "as fast as the motions themselves are"
        raise MuybridgeError(
            f"at a threshold of {threshold:.3g} m, {what}, no transition leads back to where the motion was; one of "
            f"{_up(least):g} m connects {connected(least)} of {int(starts[-1])} frames, and one of {_up(needed):g} m "
            f"{connected(needed)}",
            remedy="graph_threshold", metres=f"{_up(needed):g}",
        )  # fmt: skip
    return Choice(threshold, given is None, count, most, needed, usual)


def _least(values: FloatArray, enough: Callable[[float], bool]) -> float:
    """The least of ascending values that is enough; the last one is."""
    low, high = 0, len(values) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(float(values[middle])) else (middle + 1, high)
    return float(values[low])


def _up(metres: float) -> float:
    """Rounded up to three digits, so that it is enough when it is typed."""
    step = 10.0 ** (math.floor(math.log10(max(metres, 1e-6))) - 2)
    return round(math.ceil(metres / step - 1e-9) * step, 9)
