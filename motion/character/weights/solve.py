"""Weights for a mesh and the joints in it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.surface import Surface, join_vertices
from muybridge.motion.character.weights.bones import Bones, bones_in
from muybridge.motion.character.weights.distance import distance_weights
from muybridge.motion.character.weights.graph import FLOOR, WeightGraph, weight_graph
from muybridge.motion.character.weights.heat import heat_weights
from muybridge.motion.character.weights.islands import follow_surface
from muybridge.motion.character.weights.names import without_flesh
from muybridge.motion.character.weights.voxels import voxel_weights
from muybridge.motion.character.weights.ways import find_ways

WEIGHT_METHODS = ("auto", "heat", "voxels", "distance")
_BROKEN = 0.3  # share of points on borders from which a surface is pieces, not a body
_MOST_POINTS = 40_000  # larger meshes are weighted on a coarser surface
_SMOOTHED = 8  # steps of smoothing after that
_GRAPH_POINTS = 4_000  # a network sees larger meshes as a coarser surface, as it was trained
WeightNetwork = Callable[[WeightGraph], FloatArray]  # (P, K) weights of the pairs of a graph


@dataclass(frozen=True)
class WeightOptions:
    """How weights are made.

    Attributes:
        influences: most joints of a vertex; 4 and 8 are what engines have.
        strength: of the heat; larger values make narrower transitions.
        outside: how much longer a way is that runs outside of the mesh.
        least: weights below it are left out.
    """

    influences: int = 8
    strength: float = 5.0
    outside: float = 1.0
    least: float = 0.01

    def __post_init__(self) -> None:
        if self.influences < 1 or not self.strength > 0 or self.outside < 0 or not 0 <= self.least < 1:
            raise ValueError("weights need at least one influence, a strength above 0, outside of at least 0 and least "
                             "from 0 to 1")  # fmt: skip


def skin_weights(
    vertices: FloatArray, triangles: IntArray, joints: FloatArray, parents: IntArray, method: str = "auto",
    options: WeightOptions | None = None, network: WeightNetwork | None = None, names: Sequence[str] | None = None,
) -> FloatArray:  # fmt: skip
    """(V, J) weights of a mesh's vertices, at most `options.influences` above zero in a row, each row's sum one.

    Joints that move nothing get no weight: a root on the floor, controls, ends of chains outside of the mesh. Loose
    islands without a bone of their own, such as eyes, buttons and straps, follow the surface next to them.

    Args:
        vertices: (V, 3) metres, at rest.
        triangles: (F, 3) vertices; pieces that are inside out are turned.
        joints: (J, 3) metres, at rest.
        parents: (J,) of the joints, -1 for a root.
        method: "heat" over the surface from the bones that are seen through the mesh; "voxels", distances through the
            inside, which need no surface in one piece; "distance", to the nearest bone; "auto", heat unless the surface
            is in pieces.
        options: see `WeightOptions`.
        network: corrects weights by heat; other methods do without.
        names: (J,) of the joints. Slots for props, targets and controls lie inside of many meshes and are known by
            their names alone; they get no weight either.

    Raises:
        ValueError: no such method, or arrays that do not fit together or are not finite.
    """
    options = options or WeightOptions()
    vertices, joints = np.asarray(vertices, np.float64), np.asarray(joints, np.float64)
    triangles, parents = np.asarray(triangles, np.int64), np.asarray(parents, np.int64)
    _check(vertices, triangles, joints, parents, method)
    if names is not None and len(names) != len(parents):
        raise ValueError(f"names must be those of the {len(parents)} joints, not {len(names)}")
    still = None if names is None else without_flesh(names, parents)
    surface = join_vertices(vertices, triangles).outward()
    coarse = len(surface.points) > _MOST_POINTS
    solved = surface.coarser(_MOST_POINTS) if coarse else surface
    weights = _solve(solved, bones_in(solved, joints, parents, still), parents, method, options, network)
    if coarse:
        weights = _smoothed(surface, weights[solved.point_of], _SMOOTHED)
    return _pruned(weights, options)[surface.point_of]


def packed_weights(weights: FloatArray, most: int) -> tuple[IntArray, FloatArray]:
    """(V, K) joints, the heaviest first, and (V, K) their weights, as files have them.

    Args:
        weights: (V, J) with at most that many above zero in a row, as `skin_weights` makes them.
        most: joints of a vertex, K if there are as many.
    """
    joints = np.argsort(-weights, axis=1, kind="stable")[:, :most]
    return joints.astype(np.int64), np.take_along_axis(weights, joints, axis=1)


def _check(vertices: FloatArray, triangles: IntArray, joints: FloatArray, parents: IntArray, method: str) -> None:
    if method not in WEIGHT_METHODS:
        raise ValueError(f"no weight method {method!r}; valid are {', '.join(WEIGHT_METHODS)}")
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not len(vertices):
        raise ValueError(f"vertices must be (V, 3) with at least one, not {vertices.shape}")
    if joints.shape != (len(parents), 3) or not len(parents):
        raise ValueError(f"joints must be (J, 3), one for each of the {len(parents)} parents, not {joints.shape}")
    if triangles.ndim != 2 or triangles.shape[1:] != (3,) or not len(triangles):
        raise ValueError(f"triangles must be (F, 3) with at least one, not {triangles.shape}")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ValueError(f"a triangle refers to vertex {triangles.max()} of {len(vertices)}")
    if not np.isfinite(vertices).all() or not np.isfinite(joints).all():
        raise ValueError("vertices and joints must be finite")
    if ((parents < -1) | (parents >= len(parents)) | (parents == np.arange(len(parents)))).any():
        raise ValueError("a joint's parent must be another joint, or -1 for a root")


def _solve(
    surface: Surface, bones: Bones, parents: IntArray, method: str, options: WeightOptions,
    network: WeightNetwork | None,
) -> FloatArray:  # fmt: skip
    """(P, J) weights before pruning."""
    if method == "auto":
        method = "voxels" if surface.border.mean() > _BROKEN else "heat"
    if method == "distance":
        distance = bones.distance(surface.points)
        return distance_weights(bones, distance, bones.along(surface.points), parents)
    if method == "voxels":
        return voxel_weights(surface, bones)
    ways = find_ways(surface, bones, options.outside)
    weights = heat_weights(surface, ways.belonging.shares, ways.belonging.distance, options.strength)
    weights = follow_surface(surface, weights, ways.from_middle.min(axis=1), ways.depth)
    return weights if network is None else _corrected(surface, bones, parents, weights, network, options)


def _corrected(
    surface: Surface, bones: Bones, parents: IntArray, weights: FloatArray, network: WeightNetwork,
    options: WeightOptions,
) -> FloatArray:  # fmt: skip
    """(P, J) weights by heat as a network changes them, on a coarser surface where there are many points."""
    small = surface.coarser(_GRAPH_POINTS) if len(surface.points) > _GRAPH_POINTS else None
    graph = weight_graph(small or surface, bones, parents, options.strength)
    answer = graph.dense(network(graph), bones.count)
    if small is None:
        return answer
    factor = answer / (graph.dense(np.exp(graph.base.astype(np.float64)), bones.count) + FLOOR)
    out = (weights + FLOOR) * _smoothed(surface, factor[small.point_of], _SMOOTHED)
    return np.asarray(out / out.sum(axis=1, keepdims=True))


def _smoothed(surface: Surface, weights: FloatArray, steps: int) -> FloatArray:
    """(P, J) weights, each step halfway to the mean of the neighbours."""
    count = len(surface.points)
    a, b = surface.edges.T
    links = sparse.csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count))
    amount = np.asarray(links.sum(axis=1)).ravel()
    links = sparse.diags(0.5 / np.maximum(amount, 1.0)) @ links
    own = np.where(amount > 0, 0.5, 1.0)[:, None]
    for _ in range(steps):
        weights = own * weights + links @ weights
    return weights


def _pruned(weights: FloatArray, options: WeightOptions) -> FloatArray:
    """(P, J) the largest weights of each row, their sum one."""
    most = min(options.influences, weights.shape[1])
    if most < weights.shape[1]:
        last = np.partition(weights, -most, axis=1)[:, -most, None]
        weights = np.where(weights >= last, weights, 0.0)
    largest = weights.max(axis=1, keepdims=True)
    weights = np.where((weights >= options.least) | (weights >= largest), weights, 0.0)
    if (np.count_nonzero(weights, axis=1) > most).any():  # several that are equal
        order = np.argsort(-weights, axis=1, kind="stable")[:, most:]
        np.put_along_axis(weights, order, 0.0, axis=1)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
