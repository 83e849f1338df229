"""Branch and bound for walks that follow a path: the loops over frames, and over what may come next."""

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled

# Metres squared for a frame that goes across the path; what goes back along it costs twice as much.
_ASTRAY = 0.05
# Transitions that are followed up from one node.
_CHILDREN = 32
# Columns of a node's numbers.
YAW, X, Y, ALONG, COST, LEFT = 0, 1, 2, 3, 4, 5


@compiled
def _advance(places: FloatArray, along: float, x: float, y: float, least: float) -> tuple[float, float]:
    """The next place of the path, in steps, that is nearest to (x, y) and at least so much farther; and the squared
    distance to it."""
    last = len(places) - 1
    along = min(along + least, float(last))
    k = int(along)
    best = (places[k, 0] - x) ** 2 + (places[k, 1] - y) ** 2
    while k < last:
        ahead = (places[k + 1, 0] - x) ** 2 + (places[k + 1, 1] - y) ** 2
        if ahead > best:
            break
        k, best, along = k + 1, ahead, float(k + 1)
    return along, best


@compiled
def _play(
    trail: FloatArray, wrong: FloatArray, places: FloatArray, node: FloatArray, state: int, stop: int, least: float,
    costs: FloatArray, alongs: FloatArray,
) -> int:  # fmt: skip
    """Play a clip from `state` to before `stop`, for as long as the node's frames last and the path goes on.

    Args:
        costs: changed: cost before each frame from `state` on, and behind the last.
        alongs: changed likewise: steps along the path.

    Returns:
        The frame after the last.
    """
    c, s = np.cos(node[YAW]), np.sin(node[YAW])
    cost, along, last = node[COST], node[ALONG], len(places) - 1
    label_rows = wrong.shape[0]
    most = min(stop, state + int(node[LEFT]))
    frame = state
    while True:
        costs[frame - state], alongs[frame - state] = cost, along
        if frame >= most or along >= last:
            return frame
        x = c * trail[frame, 0] - s * trail[frame, 1] + node[X]
        y = s * trail[frame, 0] + c * trail[frame, 1] + node[Y]
        along, squared = _advance(places, along, x, y, least)
        at = int(along)
        astray = 1.0 - (
            places[at, 2] * (c * trail[frame, 2] - s * trail[frame, 3])
            + places[at, 3] * (s * trail[frame, 2] + c * trail[frame, 3])
        )
        cost += squared + _ASTRAY * astray + wrong[min(at * label_rows // (last + 1), label_rows - 1), frame]
        frame += 1


@compiled
def _follow(
    trail: FloatArray, wrong: FloatArray, places: FloatArray, node: FloatArray, leave: int, enter: int,
    yaw: float, shift: FloatArray, share: FloatArray, least: float, out: FloatArray,
) -> None:  # fmt: skip
    """The node behind a transition, from a node that stands before it. `out` is changed."""
    c, s = np.cos(node[YAW]), np.sin(node[YAW])
    turn = node[YAW] + yaw
    nx, ny = node[X] + c * shift[0] - s * shift[1], node[Y] + s * shift[0] + c * shift[1]
    nc, ns = np.cos(turn), np.sin(turn)
    cost, along, last = node[COST], node[ALONG], len(places) - 1
    label_rows = wrong.shape[0]
    for k in range(len(share)):
        i, j, old = leave + k, enter + k, share[k]
        x = old * (c * trail[i, 0] - s * trail[i, 1] + node[X])
        y = old * (s * trail[i, 0] + c * trail[i, 1] + node[Y])
        x += (1 - old) * (nc * trail[j, 0] - ns * trail[j, 1] + nx)
        y += (1 - old) * (ns * trail[j, 0] + nc * trail[j, 1] + ny)
        along, squared = _advance(places, along, x, y, least)
        cost += squared + wrong[min(int(along) * label_rows // (last + 1), label_rows - 1), j]
    out[YAW], out[X], out[Y], out[ALONG], out[COST], out[LEFT] = turn, nx, ny, along, cost, node[LEFT] - len(share)


@compiled
def _choose(
    cost: FloatArray, estimate: FloatArray, open_nodes: BoolArray, depth: IntArray, layer: int, layers: int,
    best: float,
) -> tuple[int, int]:  # fmt: skip
    """The open node to follow up next, and its layer: layers in turn, in each the one that promises most. Nodes that
    cost more already than the best whole walk are closed; -1 where none is open."""
    for _ in range(layers):
        chosen, layer = -1, (layer + 1) % layers
        for q in range(len(open_nodes)):
            if open_nodes[q] and cost[q] >= best:
                open_nodes[q] = False
            if open_nodes[q] and depth[q] == layer and (chosen < 0 or estimate[q] < estimate[chosen]):
                chosen = q
        if chosen >= 0:
            return chosen, layer
    return -1, layer


@compiled
def _children(
    trail: FloatArray, wrong: FloatArray, places: FloatArray, stops: IntArray, first_leaving: IntArray,
    leave: IntArray, enter: IntArray, yaw: FloatArray, shift: FloatArray, rough: FloatArray, share: FloatArray,
    least: float, node: FloatArray, state: int, end: int, costs: FloatArray, alongs: FloatArray, best: float,
    children: FloatArray, guesses: FloatArray, ways: IntArray,
) -> int:  # fmt: skip
    """The nodes behind all transitions that leave the clip between `state` and `end`.

    Args:
        costs, alongs: of the node's clip from `state` on, as `_play` leaves them.
        best: cost from which a child is cut off.
        children: changed: the nodes. guesses: changed: what staying in the entered clip costs. ways: changed: the
            transitions.

    Returns:
        How many there are.
    """
    window, last, played, found = len(share), len(places) - 1, end - state, 0
    room = max(window, int(node[LEFT])) + 2
    here, costs_too, alongs_too = np.zeros(6), np.zeros(room), np.zeros(room)
    for e in range(first_leaving[state], first_leaving[min(end + 1, len(first_leaving) - 1)]):
        at = leave[e] - state
        if leave[e] >= stops[state] or at > played or alongs[at] >= last or found >= len(children):
            break
        if costs[at] + rough[e] >= best or at >= node[LEFT]:
            continue
        here[:] = node
        here[ALONG], here[COST], here[LEFT] = alongs[at], costs[at] + rough[e], node[LEFT] - at
        _follow(trail, wrong, places, here, leave[e], enter[e], yaw[e], shift[e], share, least, children[found])
        if children[found, COST] >= best:
            continue
        target = enter[e] + window
        here[:] = children[found]
        here[LEFT] = min(here[LEFT], window)
        stop = _play(trail, wrong, places, here, target, stops[target], least, costs_too, alongs_too)
        guesses[found], ways[found] = costs_too[stop - target], e
        found += 1
    return found


@compiled
def _trace(node: int, parents: IntArray, used: IntArray, left: FloatArray) -> tuple[int, IntArray, FloatArray]:
    """The root that a node goes back to, the transitions on the way, and what was left of the frames at each."""
    size, q = 0, node
    while parents[q] >= 0:
        size, q = size + 1, parents[q]
    edges, lefts = np.zeros(size, np.int64), np.zeros(size)
    root, q = q, node
    while parents[q] >= 0:
        size -= 1
        edges[size], lefts[size] = used[q], left[q]
        q = parents[q]
    return root, edges, lefts


@compiled
def search_ahead(
    trail: FloatArray, wrong: FloatArray, places: FloatArray, stops: IntArray, component: BoolArray,
    first_leaving: IntArray, leave: IntArray, enter: IntArray, yaw: FloatArray, shift: FloatArray, rough: FloatArray,
    share: FloatArray, least: float, roots: FloatArray, root_states: IntArray, budget: int, room: int,
) -> tuple[int, IntArray, FloatArray, bool]:  # fmt: skip
    """The cheapest walk for some frames ahead, by branch and bound.

    Nodes are opened in the order of what it would cost to stay in their clips from there on; those that cost more
    already than the best whole walk are cut off.

    Args:
        trail: (F, 4) metres, of the body over the floor, and the direction in which it goes.
        wrong: (L, F) cost of a frame in each part of the path.
        places: (S, 4) metres, of the path in even steps, and its direction.
        stops: (F,) the frame after the last of each frame's clip.
        component: (F,) whether a walk may go on from a frame.
        first_leaving: (F + 1,) number of the first transition at a frame or later.
        leave: (E,) frame. enter: (E,) frame. yaw: (E,) radians. shift: (E, 2) metres. rough: (E,) cost.
        share: (window,) of the left motion in a transition.
        least: steps along the path that a frame makes at least.
        roots: (R, 6) where the search begins: yaw, x, y, steps along the path, cost, frames that are left.
        root_states: (R,) their frames.
        budget: nodes to open.
        room: nodes to keep.

    Returns:
        Number of the root; (N,) transitions of the walk; their costs are in (N,) what was left of the frames at each;
        and whether the walk is whole.
    """
    window, last = len(share), len(places) - 1
    nodes = np.zeros((room, 6))
    states, parents, used = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(room, np.int64)
    estimate = np.zeros(room)
    open_nodes = np.zeros(room, np.bool_)
    count = len(roots)
    longest = int(roots[:, 5].max()) + 2
    costs, alongs = np.zeros(longest), np.zeros(longest)
    here, depth = np.zeros(6), np.zeros(room, np.int64)
    for r in range(count):
        nodes[r], states[r], parents[r], used[r], open_nodes[r] = roots[r], root_states[r], -1, -1, True
        here[:] = roots[r]
        here[LEFT] = min(here[LEFT], window)
        end = _play(trail, wrong, places, here, states[r], stops[states[r]], least, costs, alongs)
        estimate[r] = costs[end - states[r]]
    best, best_node, whole = np.inf, -1, False
    most, layer, layers = 4096, -1, max(longest // max(window // 2, 1), 1)
    children, guesses, ways = np.zeros((most, 6)), np.zeros(most), np.zeros(most, np.int64)
    for _ in range(budget):
        chosen, layer = _choose(nodes[:, COST], estimate, open_nodes[:count], depth, layer, layers, best)
        if chosen < 0:
            break
        open_nodes[chosen] = False
        state, node = states[chosen], nodes[chosen]
        end = _play(trail, wrong, places, node, state, stops[state], least, costs, alongs)
        played = end - state
        done = alongs[played] >= last
        if done or (played >= node[LEFT] and end < stops[state] and component[end]):
            if costs[played] < best:
                best, best_node, whole = costs[played], chosen, True
        found = _children(
            trail, wrong, places, stops, first_leaving, leave, enter, yaw, shift, rough, share, least, node, state, end,
            costs, alongs, best, children, guesses, ways,
        )  # fmt: skip
        order = np.argsort(guesses[:found])
        for q in order[: min(_CHILDREN, room - count)]:
            nodes[count], states[count], parents[count], used[count] = (
                children[q], enter[ways[q]] + window, chosen, ways[q]
            )  # fmt: skip
            if nodes[count, LEFT] <= 0 or nodes[count, ALONG] >= last:
                if nodes[count, COST] < best:
                    best, best_node, whole = nodes[count, COST], count, True
            else:
                estimate[count], open_nodes[count] = guesses[q], True
                depth[count] = int((roots[0, LEFT] - nodes[count, LEFT]) * (layers - 1) / roots[0, LEFT])
            count += 1
    if best_node < 0:
        # Nothing whole was found: what got farthest.
        best_node = int(np.argmin(nodes[:count, LEFT]))
    root, edges, left = _trace(best_node, parents, used, nodes[:, LEFT])
    return root, edges, left, whole


@compiled
def keep_ahead(
    trail: FloatArray, wrong: FloatArray, places: FloatArray, stops: IntArray, leave: IntArray, enter: IntArray,
    yaw: FloatArray, shift: FloatArray, share: FloatArray, least: float, node: FloatArray, state: int,
    edges: IntArray, keep: int,
) -> tuple[int, int, bool]:  # fmt: skip
    """Go the first part of a walk: so many frames, and to the end of a transition that has begun.

    Args:
        node: (6,) where it begins; changed to where it gets.
        state: its frame.
        edges: (N,) transitions of the walk.
        keep: frames.

    Returns:
        The frame where it gets, how many transitions are behind it, and whether the path is.
    """
    last = len(places) - 1
    costs, alongs = np.zeros(keep + 2), np.zeros(keep + 2)
    after = np.zeros(6)
    for k in range(len(edges) + 1):
        until = stops[state] if k == len(edges) else min(leave[edges[k]], stops[state])
        node[LEFT] = keep
        end = _play(trail, wrong, places, node, state, until, least, costs, alongs)
        played = end - state
        node[ALONG], node[COST] = alongs[played], costs[played]
        keep -= played
        state = end
        if node[ALONG] >= last:
            return state, k, True
        if k == len(edges) or keep <= 0:
            return state, k, False
        e = edges[k]
        _follow(trail, wrong, places, node, leave[e], enter[e], yaw[e], shift[e], share, least, after)
        node[:] = after
        keep -= len(share)
        state = enter[e] + len(share)
        if node[ALONG] >= last or keep <= 0:
            return state, k + 1, node[ALONG] >= last
    return state, len(edges), False
