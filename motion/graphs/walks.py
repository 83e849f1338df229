"""Walks in a motion graph, and the motions that they are."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat, slerp
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.alignment import place_at
from muybridge.motion.graphs.components import in_largest_component
from muybridge.motion.graphs.graph import MotionGraph
from muybridge.motion.graphs.transitions import blend_weights

_DWELL_S = 2.5  # mean time that a random walk plays on in a clip before it looks for a transition
_CHOICES = 12  # transitions that leave next, from which it takes one


@dataclass(frozen=True, eq=False)
class Walk:
    """A way through a graph: frames from `start` to the first transition, from behind its window to the next one, and
    so on up to `stop`.

    Attributes:
        start: first frame.
        transitions: (N,) numbers of the graph's transitions, in order.
        stop: the frame after the last.
        yaw: radians by which the clip that it starts in is turned about the world's Z axis.
        shift: (2,) metres by which that clip is then shifted.
    """

    start: int
    transitions: IntArray
    stop: int
    yaw: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    def pieces(self, graph: MotionGraph) -> list[tuple[int, int]]:
        """First frame, and the frame after the last, of what is played unblended; there is one before and behind each
        transition, and it may be empty."""
        ways, window = graph.transitions, graph.window
        first = [self.start, *(int(ways.enter[e]) + window for e in self.transitions)]
        stop = [*(int(ways.leave[e]) for e in self.transitions), self.stop]
        return list(zip(first, stop, strict=True))

    def frames(self, graph: MotionGraph) -> int:
        """How long it is."""
        return sum(b - a for a, b in self.pieces(graph)) + len(self.transitions) * graph.window

    def windows(self, graph: MotionGraph) -> IntArray:
        """(N,) frame of the walk at which each transition's window begins."""
        lengths = [b - a for a, b in self.pieces(graph)]
        return np.cumsum(lengths[:-1]).astype(np.int64) + graph.window * np.arange(len(self.transitions))


def walk_motion(graph: MotionGraph, walk: Walk) -> Motion:
    """The motion of a walk: clips laid behind each other on the ground, blended over the windows of transitions.

    Source: section 3.2 of the paper; the root is interpolated linearly, rotations spherically.
    """
    ways, window = graph.transitions, graph.window
    yaw, shift = walk.yaw, np.array(walk.shift)
    share = blend_weights(window)
    parts: list[Motion] = []
    pieces = walk.pieces(graph)
    for k, (first, stop) in enumerate(pieces):
        last = k == len(pieces) - 1
        here = place_at(graph.motion.select(slice(first, stop if last else stop + window)), yaw, shift)
        parts.append(here.select(slice(0, stop - first)))
        if last:
            break
        e = int(walk.transitions[k])
        shift = shift + _turned(ways.shift[e], yaw)
        yaw = float(yaw + ways.yaw[e])
        enter = int(ways.enter[e])
        there = place_at(graph.motion.select(slice(enter, enter + window)), yaw, shift)
        parts.append(_blended(here.select(slice(stop - first, None)), there, share))
    slides = [p.translations for p in parts if p.translations is not None]
    return replace(
        graph.motion,
        root_positions_world=np.concatenate([p.root_positions_world for p in parts]),
        quat_wxyz=continuous_quat(np.concatenate([p.quat_wxyz for p in parts])),
        translations=np.concatenate(slides) if slides else None,
    )


def _turned(place: FloatArray, yaw: float) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * place[0] - s * place[1], s * place[0] + c * place[1]])


def _blended(old: Motion, new: Motion, share: FloatArray) -> Motion:
    """Between two motions of one length; the share (T,) is the old one's."""
    slides = None
    if old.translations is not None and new.translations is not None:
        slides = share[:, None, None] * old.translations + (1 - share[:, None, None]) * new.translations
    return replace(
        old,
        root_positions_world=share[:, None] * old.root_positions_world
        + (1 - share[:, None]) * new.root_positions_world,
        quat_wxyz=slerp(new.quat_wxyz, old.quat_wxyz, np.broadcast_to(share[:, None], old.quat_wxyz.shape[:2])),
        translations=slides,
    )


def random_walk(graph: MotionGraph, seconds: float, seed: int = 0) -> Walk:
    """A walk of a given length that prefers what it has played least, and never comes to an end before.

    Args:
        graph: to walk in.
        seconds: of the walk, to the frame.
        seed: of the random numbers.
    """
    rng = np.random.default_rng(seed)
    inside = np.flatnonzero(graph.component)
    start = int(rng.choice(inside))
    used, stop = _wander(graph, start, round(seconds * graph.fps), graph.component, np.zeros(len(graph)), rng)
    return Walk(start, np.array(used, np.int64), stop)


def _wander(
    graph: MotionGraph, state: int, frames: int, inside: BoolArray, visits: FloatArray, rng: np.random.Generator
) -> tuple[list[int], int]:
    """Transitions of so many frames from `state` on within a component, and where they stop."""
    ways, window = graph.transitions, graph.window
    usable = np.flatnonzero(inside[ways.leave] & inside[np.minimum(ways.enter + window, len(graph) - 1)])
    leave = ways.leave[usable]
    used: list[int] = []
    while True:
        end = int(graph.starts[graph.clip_of[state] + 1])
        a, b = np.searchsorted(leave, (state, end))
        at = min(np.searchsorted(leave, state + rng.exponential(_DWELL_S * graph.fps)), b - 1)
        if a == b or int(leave[at]) - state + window >= frames:
            # What is left is played in this clip if it is long enough, else by the first transition that there is.
            if state + frames <= end or a == b:
                return used, min(state + frames, end)
            at = a
        near = usable[max(at - _CHOICES // 2, a) : min(at + _CHOICES, b)]
        seen = np.array([visits[ways.enter[e] + window : ways.enter[e] + 2 * window].sum() for e in near])
        rough = ways.distance[near] / graph.threshold
        e = int(near[np.argmin(seen / window + rough + rng.uniform(0, 0.5, len(near)))])
        lasts = int(ways.leave[e]) - state + window
        if lasts > frames:
            if state + frames <= end:
                return used, state + frames
            return used, end
        visits[state : ways.leave[e]] += 1
        frames -= lasts
        state = int(ways.enter[e]) + window
        used.append(e)


def action_walk(graph: MotionGraph, actions: Sequence[str], seconds: float, seed: int = 0) -> Walk:
    """A walk through a list of actions, each for the same time; the ways between them come on top.

    Args:
        graph: to walk in.
        actions: labels of clips.
        seconds: of all actions together.
        seed: of the random numbers.

    Raises:
        MuybridgeError: no clip has such a label, or none that can be reached and gone on in.
    """
    rng, visits = np.random.default_rng(seed), np.zeros(len(graph))
    inside = {action: action_component(graph, action) for action in dict.fromkeys(actions)}
    state = start = int(rng.choice(np.flatnonzero(inside[actions[0]])))
    used: list[int] = []
    for k, action in enumerate(actions):
        if k:
            way, state = _way_to(graph, state, inside[action])
            used += way
        more, state = _wander(graph, state, round(seconds * graph.fps / len(actions)), inside[action], visits, rng)
        used += more
    return Walk(start, np.array(used, np.int64), state)


def action_component(graph: MotionGraph, action: str) -> BoolArray:
    """(F,) frames of an action in which one can go on for ever without leaving it.

    Raises:
        MuybridgeError: there are none.
    """
    with_label = [k for k, label in enumerate(graph.labels) if label == action]
    if not with_label:
        raise MuybridgeError(f"no clip of the graph shows {action!r}; there are {', '.join(sorted(set(graph.labels)))}")
    ways, window = graph.transitions, graph.window
    of_action = np.isin(graph.clip_of, with_label) & graph.component
    behind = np.minimum(ways.enter + window, len(graph) - 1)
    kept = of_action[ways.leave] & of_action[behind]
    inside = in_largest_component(ways.leave[kept], ways.enter[kept], graph.starts, window) & of_action
    if not inside.any():
        frames = int(of_action.sum())
        raise MuybridgeError(
            f"one cannot go on in {action!r}: of its clips {frames} frames are connected to the others, and no "
            "transition among them leads back; build the graph with more or longer takes of it, or a larger threshold"
        )
    return inside


def _way_to(graph: MotionGraph, state: int, goal: BoolArray) -> tuple[list[int], int]:
    """Transitions by which some frames are reached with the fewest steps, and the frame at which they are."""
    if goal[state]:
        return [], state
    ways, window, frames = graph.transitions, graph.window, len(graph)
    following = np.flatnonzero(graph.clip_of[:-1] == graph.clip_of[1:])
    # A node for each frame; a transition takes as long as its window, of which the search knows nothing.
    rows = np.concatenate([following, ways.leave])
    columns = np.concatenate([following + 1, np.minimum(ways.enter + window, frames - 1)])
    matrix = csr_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(frames, frames))
    order, before = breadth_first_order(matrix, state, directed=True)
    reached = order[goal[order]]
    if not len(reached):
        raise MuybridgeError("the next action cannot be reached from the one before it")
    nodes = [int(reached[0])]
    while nodes[-1] != state:
        nodes.append(int(before[nodes[-1]]))
    nodes.reverse()
    used = []
    for a, b in zip(nodes[:-1], nodes[1:], strict=True):
        lo, hi = graph.first_leaving[a], graph.first_leaving[a + 1]
        match = [e for e in range(lo, hi) if ways.enter[e] + window == b]
        if match and not (b == a + 1 and graph.clip_of[a] == graph.clip_of[b]):
            used.append(min(match, key=lambda e: ways.distance[e]))
    return used, nodes[-1]
