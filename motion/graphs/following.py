"""Walks that follow a path on the floor, found a few seconds at a time.

Kovar, Gleicher and Pighin 2002, "Motion Graphs", section 4: branch and bound over the transitions, with the squared
distance between where the body is and where on the path it should be, summed over the frames. The best walk of a few
seconds is found, its first part is kept, and the search goes on from there. Other than in the paper, a body should be
at the place of the path that is nearest ahead rather than as far along as it went, since hips sway and go farther than
they get.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.motion.editing.channels import body_joint
from muybridge.motion.editing.root_path import ground_path
from muybridge.motion.graphs._search_kernel import ALONG, COST, LEFT, YAW, X, Y, keep_ahead, search_ahead
from muybridge.motion.graphs.graph import MotionGraph
from muybridge.motion.graphs.paths import FloorPath
from muybridge.motion.graphs.transitions import blend_weights
from muybridge.motion.graphs.walks import Walk

_SWAY_S = 0.3  # standard deviation: faster movement of the hips is not part of their way
_SLOWEST = 0.3  # of the median speed: progress that is demanded of every frame
_WRONG_M = 1.0  # metres off the path that a wrong action is as bad as
_STILL = 0.1  # metres per second
_LOOK_M = 0.5  # of the path's start that a walk first turns to
_ROOM = 100_000


@dataclass(frozen=True)
class FollowOptions:
    """How a walk along a path is searched for.

    Attributes:
        horizon: seconds that are looked ahead.
        keep: seconds of them that are kept.
        starts: frames that the walk may start from, evenly chosen.
        budget: walks that are followed up in each step of the search.
        smooth: metres off the path that the roughest transition is as bad as.
    """

    horizon: float = 4.0
    keep: float = 0.5
    starts: int = 200
    budget: int = 1000
    smooth: float = 0.15


@dataclass(frozen=True, eq=False)
class _Ground:
    """What the search knows of a graph: the hips' way over the floor, and what frames cost beside their distance."""

    trail: FloatArray
    wrong: FloatArray
    stops: IntArray
    rough: FloatArray
    least: float


def floor_trail(graph: MotionGraph) -> FloatArray:
    """(F, 2) metres: where the hips are over the floor, without their swaying; each clip in its own place."""
    body = body_joint(graph.clip(0))
    roles = {"hips": body}
    return np.concatenate([ground_path(graph.clip(k), _SWAY_S, False, roles).places for k in range(len(graph.names))])


def follow_path(
    graph: MotionGraph, path: FloorPath, actions: Sequence[str] = (), options: FollowOptions | None = None,
    advance: Callable[[int], object] | None = None,
) -> Walk:  # fmt: skip
    """The walk that follows a path, from its start to its end.

    Args:
        graph: to walk in.
        path: on the floor.
        actions: labels of clips, each for an equal part of the path; none takes any clip.
        options: of the search.
        advance: called with the number of places that were passed, of `path.places`.

    Raises:
        MuybridgeError: no clip has the label of an action, or nothing in the graph moves over the floor.
    """
    options = options or FollowOptions()
    ground = _ground(graph, path, actions, options)
    ways, share = graph.transitions, blend_weights(graph.window)
    fixed = (ground.trail, ground.wrong, _with_directions(path), ground.stops)
    transitions = (ways.leave, ways.enter, ways.yaw, ways.shift)
    roots, states = _starts(graph, path, ground, options)
    used: list[int] = []
    first, passed = None, 0
    while True:
        roots[:, COST], roots[:, LEFT] = 0.0, max(round(options.horizon * graph.fps), 2 * graph.window)
        root, edges, _, whole = search_ahead(
            *fixed, graph.component, graph.first_leaving, *transitions, ground.rough, share, ground.least, roots,
            states, options.budget, _ROOM,
        )  # fmt: skip
        node, state = roots[root].copy(), int(states[root])
        if first is None:
            first = (state, float(node[YAW]), (float(node[X]), float(node[Y])))
        # Where nothing whole was found, what was found does not lead into a dead end as long as it lasts.
        keep = round(options.keep * graph.fps) if whole else int(roots[root, LEFT])
        state, taken, done = keep_ahead(*fixed, *transitions, share, ground.least, node, state, edges, keep)
        used += edges[:taken].tolist()
        if advance is not None:
            advance(int(node[ALONG]) - passed)
        passed = int(node[ALONG])
        if done or not graph.component[min(state, len(graph) - 1)]:
            return Walk(first[0], np.array(used, np.int64), state, first[1], first[2])
        roots, states = node[None].copy(), np.array([state])


def _ground(graph: MotionGraph, path: FloorPath, actions: Sequence[str], options: FollowOptions) -> _Ground:
    trail = floor_trail(graph)
    following = graph.component[:-1] & graph.component[1:] & (graph.clip_of[:-1] == graph.clip_of[1:])
    steps = np.linalg.norm(np.diff(trail, axis=0), axis=1)[following]
    speed = float(np.median(steps)) if len(steps) else 0.0
    fast = float(np.quantile(steps, 0.9)) if len(steps) else 0.0
    if fast * graph.fps < _STILL:
        raise MuybridgeError(
            f"nine in ten connected frames of the graph move slower than {_STILL:g} m/s, so that no walk in it follows "
            "a path; build it with takes of somebody who goes somewhere"
        )
    goes = _unit(np.concatenate([np.gradient(trail[a:b], axis=0) for a, b in pairwise(graph.starts)]))
    known = sorted(set(graph.labels))
    wrong = np.zeros((max(len(actions), 1), len(graph)))
    for k, action in enumerate(actions):
        if action not in known:
            raise MuybridgeError(f"no clip of the graph shows {action!r}; there are {', '.join(known)}")
        wrong[k] = _WRONG_M**2 * (np.array(graph.labels)[graph.clip_of] != action)
    stops = graph.starts[1:][graph.clip_of]
    rough = graph.window * (options.smooth * graph.transitions.distance / graph.threshold) ** 2
    least = _SLOWEST * (speed if speed > 0.5 * fast else 0.5 * fast) / path.step
    return _Ground(np.concatenate([trail, goes], axis=1), wrong, stops, rough, least)


def _with_directions(path: FloorPath) -> FloatArray:
    """(S, 4) places and unit directions, of the path over half a metre before and behind."""
    reach, last = max(round(_LOOK_M / path.step), 1), len(path.places) - 1
    at = np.arange(last + 1)
    ways = path.places[np.minimum(at + reach, last)] - path.places[np.maximum(at - reach, 0)]
    return np.concatenate([path.places, _unit(ways)], axis=1)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9))


def _starts(
    graph: MotionGraph, path: FloorPath, ground: _Ground, options: FollowOptions
) -> tuple[FloatArray, IntArray]:
    """Nodes at the path's start that go the way that it goes, and their frames."""
    inside = np.flatnonzero(graph.component)
    inside = inside[ground.stops[inside] - inside > graph.window]
    states = inside[np.unique(np.linspace(0, len(inside) - 1, options.starts).astype(int))]
    trail = ground.trail[:, :2]
    goes = trail[np.minimum(states + graph.window, ground.stops[states] - 1)] - trail[states]
    speed = np.linalg.norm(goes, axis=1)
    moving = speed >= 0.5 * np.median(speed)
    states, goes = states[moving], goes[moving]
    ahead = path.places[min(round(_LOOK_M / path.step), len(path.places) - 1)] - path.places[0]
    yaw = np.arctan2(ahead[1], ahead[0]) - np.arctan2(goes[:, 1], goes[:, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = trail[states].T
    roots = np.zeros((len(states), 6))
    roots[:, YAW] = yaw
    roots[:, X] = path.places[0, 0] - (c * x - s * y)
    roots[:, Y] = path.places[0, 1] - (s * x + c * y)
    return roots, states
