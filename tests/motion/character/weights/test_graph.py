"""Graphs of points and joints, and weights that a network corrects."""

import numpy as np
import pytest

from muybridge.arrays import FloatArray
from muybridge.motion.character import skin_weights
from muybridge.motion.character.surface import join_vertices
from muybridge.motion.character.weights import solve
from muybridge.motion.character.weights.bones import bones_in
from muybridge.motion.character.weights.graph import CANDIDATES, FEATURES, NEIGHBOURS, WeightGraph, weight_graph
from tests.motion.character.skinning.tubes import tube

JOINTS, PARENTS = np.array([[0.1, 0, 0], [0.7, 0, 0], [1.3, 0, 0], [1.9, 0, 0]]), np.array([-1, 0, 1, 2])


def graph_of(joints: np.ndarray = JOINTS, turn: np.ndarray | None = None, size: float = 1.0) -> WeightGraph:
    points, triangles = tube()
    turn = np.eye(3) if turn is None else turn
    surface = join_vertices(size * points @ turn.T, triangles).outward()
    return weight_graph(surface, bones_in(surface, size * joints @ turn.T, PARENTS), PARENTS)


def by_heat(graph: WeightGraph) -> FloatArray:
    """What a network that adds nothing answers."""
    weights = np.exp(graph.base.astype(float)) * graph.exists
    return weights / weights.sum(axis=1, keepdims=True)


def test_pairs_are_of_the_nearest_joints_and_small_skeletons_leave_places_empty() -> None:
    graph = graph_of()
    assert graph.features.shape == (*graph.joint.shape, len(FEATURES)) and np.isfinite(graph.features).all()
    assert graph.joint.shape[1] == CANDIDATES and (graph.exists.sum(axis=1) == 4).all()
    assert not graph.features[graph.exists == 0].any()
    heat = graph.features[..., FEATURES.index("heat")]
    assert (np.diff(heat, axis=1) <= 1e-6).all() and (heat.sum(axis=1) > 0.999).all()


def test_edges_lead_to_the_same_joint_and_to_parents() -> None:
    graph = graph_of()
    count, width = graph.joint.shape
    assert graph.same.shape == (count, NEIGHBOURS, width)
    flat = np.append(graph.joint.ravel(), -1)
    there = graph.same < count * width
    assert there.any() and (flat[graph.same] == graph.joint[:, None, :])[there].all()
    assert (np.append(graph.exists.ravel(), 0)[graph.same] > 0)[there].all()
    has = graph.parent < width
    above = np.take_along_axis(graph.joint, np.minimum(graph.parent, width - 1), 1)
    assert has.any() and (above == PARENTS[graph.joint])[has].all()
    # Every joint but the first has its parent among the candidates, since all four are.
    assert (has == ((PARENTS[graph.joint] >= 0) & (graph.exists > 0))).all()


def test_features_depend_neither_on_size_nor_on_how_the_mesh_stands() -> None:
    angle = np.radians(90)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    plain, other = graph_of(), graph_of(turn=turn, size=3.0)
    voxels = FEATURES.index("voxels")  # depends on the grid
    chosen = [k for k in range(len(FEATURES)) if k != voxels]
    order = [np.lexsort(g.features[:, 0, chosen].round(3).T) for g in (plain, other)]
    one, two = (g.features[o][:, 0][:, chosen] for g, o in zip((plain, other), order, strict=True))
    assert np.abs(one.mean(axis=0) - two.mean(axis=0)).max() < 0.02


def test_network_that_adds_nothing_keeps_the_heat() -> None:
    points, triangles = tube()
    heat = skin_weights(points, triangles, JOINTS, PARENTS, "heat")
    same = skin_weights(points, triangles, JOINTS, PARENTS, "heat", network=by_heat)
    np.testing.assert_allclose(same.sum(axis=1), 1, atol=1e-9)
    assert np.abs(same - heat).sum(axis=1).max() < 0.03


def test_large_meshes_are_corrected_on_a_coarser_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    points, triangles = tube(81, 48)
    seen = []

    def rigid(graph: WeightGraph) -> FloatArray:
        seen.append(len(graph.joint))
        return np.eye(CANDIDATES)[np.zeros(len(graph.joint), int)]

    monkeypatch.setattr(solve, "_GRAPH_POINTS", 1500)
    heat = skin_weights(points, triangles, JOINTS, PARENTS, "heat")
    weights = skin_weights(points, triangles, JOINTS, PARENTS, "heat", network=rigid)
    assert seen[0] <= 1500 < len(points)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-9)
    # All weight goes to the first joint but where the coarser surface changes from one to the next.
    assert (weights.max(axis=1) > 0.98).mean() > 0.6 > (heat.max(axis=1) > 0.98).mean()
    assert (weights.argmax(axis=1) == heat.argmax(axis=1)).mean() > 0.9


def test_other_methods_do_without_a_network() -> None:
    points, triangles = tube()

    def never(graph: WeightGraph) -> FloatArray:
        raise AssertionError("asked")

    for method in ("voxels", "distance"):
        skin_weights(points, triangles, JOINTS, PARENTS, method, network=never)
