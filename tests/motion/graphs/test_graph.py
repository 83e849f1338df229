"""Motion graphs: distances, minima, transitions, the component, and walks."""

from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending import cloud_windows, place_at, planar_alignment, point_cloud
from muybridge.motion.graphs import (
    GraphOptions,
    MotionGraph,
    action_walk,
    build_graph,
    distance_block,
    find_minima,
    random_walk,
    walk_motion,
    window_features,
)
from muybridge.motion.graphs import minima as minima_module
from muybridge.motion.graphs.distances import lag_distances, point_weights
from muybridge.motion.graphs.transitions import blend_weights
from tests.motion.editing.clips import PERIOD, walk

WINDOW = 20


def clips() -> list[Motion]:
    whole = walk(520)
    return [whole.select(slice(0, 300)), place_at(whole.select(slice(200, 520)), 2.0, np.array([3.0, -1.0]))]


@pytest.fixture(scope="module")
def graph() -> MotionGraph:
    return build_graph(clips(), ["walk_1", "stroll"], ["walk", "stroll"]).graph


def test_distances_are_those_of_the_best_alignment() -> None:
    some = clips()
    features = window_features(some, WINDOW)
    block = distance_block(features, slice(30, 50), slice(295, 400))
    weights = np.tile(point_weights(some[0].skeleton) / WINDOW, WINDOW)
    a, b = (cloud_windows(point_cloud(c), WINDOW) for c in some)
    for i, j in ((30, 310), (45, 371)):
        exact = planar_alignment(a[i], b[j - 300], weights).distance
        assert block[i - 30, j - 295] == pytest.approx(float(exact), abs=2e-6)
    assert np.isinf(block[:, :5]).all(), "windows that begin less than a window before a clip's end"


def test_distances_do_not_depend_on_where_the_clips_are() -> None:
    some = clips()
    far = [some[0], place_at(some[1], 1.0, np.array([900.0, -400.0]))]
    here, there = (distance_block(window_features(c, WINDOW), slice(0, 60), slice(300, 400)) for c in (some, far))
    np.testing.assert_allclose(there, here, atol=1e-5)


def test_a_lag_of_nothing_is_no_distance_and_more_is_farther() -> None:
    features = window_features(clips(), WINDOW)
    assert lag_distances(features, 0).max() < 2e-3
    assert np.median(lag_distances(features, 4)) < np.median(lag_distances(features, 8))


def test_minima_in_blocks_are_those_of_the_whole_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    features = window_features(clips(), WINDOW)
    whole = find_minima(features, 4, 30)
    monkeypatch.setattr(minima_module, "_BLOCK", 97)
    parts = find_minima(features, 4, 30)
    assert len(whole) > 10
    for some, others in ((whole, parts), (parts, whole)):
        # In a flat valley, rounding decides which of neighbours is the least.
        near = np.maximum(abs(some.first[:, None] - others.first), abs(some.second[:, None] - others.second)) <= 4
        alike = near & (np.abs(some.distance[:, None] - others.distance) < 1e-3)
        assert alike.any(axis=1).all()
    assert (whole.first < whole.second).all()
    matrix = distance_block(features, slice(0, len(features)), slice(0, len(features)))
    for i, j in zip(whole.first, whole.second, strict=True):
        near = matrix[max(i - 4, 0) : i + 5, max(j - 4, 0) : j + 5]
        assert matrix[i, j] <= near.min() + 1e-6


def test_frames_that_are_the_same_are_found_and_laid_over_each_other(graph: MotionGraph) -> None:
    ways = graph.transitions
    same = (ways.leave < 300) & (ways.enter == ways.leave + 100)
    assert same.any() and ways.distance[same].max() < 2e-3, "frame 200 of the one is frame 0 of the other"
    np.testing.assert_allclose(ways.yaw[same], -2.0, atol=1e-4)
    stride = np.abs(np.abs(ways.leave - ways.enter) - PERIOD) <= 3
    assert stride.any(), "a stride later all is nearly the same"


def test_the_component_has_no_dead_end(graph: MotionGraph) -> None:
    ways = graph.transitions
    for frame in np.flatnonzero(graph.component):
        number = graph.clip_of[frame]
        goes_on = frame + 1 < graph.starts[number + 1] and graph.component[frame + 1]
        assert goes_on or frame in ways.leave
    assert graph.component[ways.enter + graph.window].all()
    assert not graph.component[graph.starts[1] - 1], "the last frame of a clip leads nowhere"


def test_a_long_walk_lasts_to_the_frame_and_never_jumps(graph: MotionGraph) -> None:
    found = random_walk(graph, 120.0, seed=3)
    motion = walk_motion(graph, found)
    assert len(motion) == found.frames(graph) == 7200
    at = found.windows(graph)
    assert len(at) > 20 and (np.diff(at) >= graph.window).all()

    def hardest(one: Motion) -> float:
        return float(np.linalg.norm(np.diff(one.joint_positions_world(), n=2, axis=0), axis=2).max()) * one.fps**2

    assert hardest(motion) < 1.02 * max(hardest(c) for c in clips())
    assert np.array_equal(random_walk(graph, 120.0, seed=3).transitions, found.transitions)
    assert not np.array_equal(random_walk(graph, 120.0, seed=4).transitions, found.transitions)


def test_what_is_not_blended_is_as_recorded(graph: MotionGraph) -> None:
    found = random_walk(graph, 20.0)
    motion, (first, stop) = walk_motion(graph, found), found.pieces(graph)[0]
    count = stop - first
    np.testing.assert_allclose(motion.quat_wxyz[:count], graph.motion.quat_wxyz[first:stop], atol=1e-12)
    np.testing.assert_allclose(motion.root_positions_world[:count], graph.motion.root_positions_world[first:stop])


def test_a_list_of_actions_is_done_in_its_order(graph: MotionGraph) -> None:
    found = action_walk(graph, ["walk", "stroll", "walk"], 18.0)
    labels = [graph.labels[graph.clip_of[a]] for a, b in found.pieces(graph) if b > a]
    changes = [a for k, a in enumerate(labels) if k == 0 or labels[k - 1] != a]
    assert changes == ["walk", "stroll", "walk"]
    assert found.frames(graph) >= 18 * 60 - 3 * graph.window
    with pytest.raises(MuybridgeError, match="no clip of the graph shows 'fly'; there are stroll, walk"):
        action_walk(graph, ["fly"], 5.0)


def test_blend_weights_are_smooth_and_symmetric() -> None:
    share = blend_weights(9)
    np.testing.assert_allclose(share + share[::-1], 1.0)
    assert (np.diff(share) < 0).all() and share[0] > 0.95


def test_short_clips_are_passed_over_and_nothing_but_them_refused() -> None:
    one, two = clips()
    built = build_graph([one, two.select(slice(0, WINDOW)), two], ["a", "short", "b"])
    assert built.passed_over == (1,) and built.graph.names == ("a", "b")
    with pytest.raises(
        MuybridgeError, match=r"no clip is longer than the window of 20 frames .* the longest, y, has 20"
    ):
        build_graph([one.select(slice(0, 1)), two.select(slice(0, 20))], ["x", "y"])


def test_what_does_not_connect_says_which_threshold_would() -> None:
    some = clips()
    with pytest.raises(MuybridgeError, match=r"at a threshold of 1e-06 m, given, .*one of \S+ m connects \d+ of 620"):
        build_graph(some, ["a", "b"], options=GraphOptions(threshold=1e-6))
    with pytest.raises(MuybridgeError, match="no transition leads back to where the motion was, at any threshold"):
        build_graph([some[0].select(slice(0, 30))], ["a"])
    chosen = build_graph(some, ["a", "b"]).choice
    assert chosen.chosen and 0 < chosen.connected <= chosen.most <= 620 and chosen.threshold <= chosen.usual


def test_options_out_of_range_are_refused() -> None:
    for options in (GraphOptions(window=0), GraphOptions(threshold=-1.0), GraphOptions(most=0), GraphOptions(apart=-1)):
        with pytest.raises(ValueError):
            build_graph(clips(), ["a", "b"], options=options)


def test_somebody_who_only_breathes_is_a_graph_too() -> None:
    still = walk(2).select(np.zeros(400, int))
    sway = 0.005 * np.sin(np.arange(400) / 20)[:, None] * np.array([0.0, 0.0, 1.0])
    built = build_graph([replace(still, root_positions_world=still.root_positions_world + sway)], ["a"])
    assert built.graph.component.sum() > 100 and built.graph.threshold <= 0.01
