"""What a network sees of a mesh and its bones: for each point the joints that may move it, and features of each pair.

After Pan, Huang, Mai, Wang, Li, Su, Wang and Jin, HeterSkinNet: a heterogeneous network for skin weights prediction,
2021: points and bones are nodes of one graph. Here a node is a pair of a point and one of the joints near to it; edges
lead to the same joint at neighbouring points, and to the joint's parent and children at the same point. Lengths are
relative to the mesh or to the limb, and no feature depends on how the mesh stands.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.motion.character.surface import Surface
from muybridge.motion.character.weights.bones import Bones
from muybridge.motion.character.weights.heat import heat_weights
from muybridge.motion.character.weights.islands import follow_surface
from muybridge.motion.character.weights.voxels import voxel_distance
from muybridge.motion.character.weights.ways import Ways, find_ways

CANDIDATES = 6
NEIGHBOURS = 6
FLOOR = 0.003  # added to a weight before its logarithm is taken
_STRENGTHS = (1.0, 25.0)  # of heat that spreads farther and less far than the usual
_MOST_LOG = 3.0  # of ratios
_MOST_HOPS = 3
FEATURES = (
    "heat", "heat_spread", "heat_narrow", "belonging", "distance", "seen", "from_middle", "voxels", "distance_of_size",
    "along_of_length", "length_of_size", "along_of_depth", "left_of_depth", "facing", "leaf", "children", "first",
    "hop", "two_hops", "farther", "heat_of_island", "depth_of_size", "island", "islands", "border", "edge_of_depth",
    "crease", "owned", "exists",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class WeightGraph:
    """Pairs of points and joints.

    Attributes:
        joint: (P, K) the joints that may move a point, those of most heat first.
        features: (P, K, F) of the pairs, in the order of `FEATURES`.
        parent: (P, K) the place among the K of the joint's nearest ancestor; K for none.
        same: (P, N, K) the pair, of P * K, of the same joint at neighbouring points; P * K for none.
        base: (P, K) logarithm of the weights by heat, to which a network adds.
        exists: (P, K) whether there is such a pair; there are fewer joints than K in small skeletons.
    """

    joint: IndexArray
    features: Float32Array
    parent: IndexArray
    same: IndexArray
    base: Float32Array
    exists: Float32Array

    def dense(self, weights: FloatArray, count: int) -> FloatArray:
        """(P, J) of the weights (P, K) of the pairs."""
        out = np.zeros((len(self.joint), count))
        np.add.at(out, (np.arange(len(out))[:, None], self.joint), weights * self.exists)
        return out


def weight_graph(surface: Surface, bones: Bones, parents: IntArray, strength: float = 5.0) -> WeightGraph:
    """The graph of a mesh.

    Args:
        surface: of the mesh.
        bones: in it.
        parents: (J,) of the joints.
        strength: of the heat.
    """
    ways = find_ways(surface, bones)
    shares, reach = ways.belonging
    near, middle_distance = ways.from_middle.min(axis=1), ways.depth
    heats = [follow_surface(surface, heat_weights(surface, shares, reach, s), near, middle_distance)
             for s in (strength, *_STRENGTHS)]  # fmt: skip
    seen = _by_joint(bones, ways.from_middle + 0.3 * ways.seen)
    used = np.unique(bones.joint)
    rank = np.where(np.isfinite(seen), -seen / seen.min(axis=1, keepdims=True), -np.inf) * 1e-6 + heats[0]
    joint = np.argsort(-rank, axis=1, kind="stable")[:, :CANDIDATES]
    exists = np.isfinite(np.take_along_axis(rank, joint, 1))
    if joint.shape[1] < CANDIDATES:
        short = CANDIDATES - joint.shape[1]
        joint, exists = np.pad(joint, ((0, 0), (0, short))), np.pad(exists, ((0, 0), (0, short)))
    above = _nearest_ancestor(np.asarray(parents), used, bones.count)
    features = _features(surface, bones, ways, heats, joint, above)
    features[..., -1] = exists
    features *= exists[..., None]
    base = np.log(np.take_along_axis(heats[0], joint, 1) + FLOOR)
    return WeightGraph(joint, features, _parent_places(joint, exists, above), _same_joint(surface, joint, exists),
                       base.astype(np.float32), exists.astype(np.float32))  # fmt: skip


def _features(
    surface: Surface, bones: Bones, ways: Ways, heats: list[FloatArray], joint: IndexArray, above: IntArray
) -> Float32Array:
    """(P, K, F), all but the last."""
    count, size = len(surface.points), max(surface.size, 1e-9)
    rows = np.arange(count)[:, None]

    def pick(table: FloatArray) -> FloatArray:
        return np.asarray(np.take_along_axis(table, joint, 1))

    def ratio(table: FloatArray) -> FloatArray:
        with np.errstate(invalid="ignore"):
            value = np.log((pick(table) + 1e-3 * size) / (table.min(axis=1, keepdims=True) + 1e-3 * size))
        return np.asarray(np.nan_to_num(np.minimum(value, _MOST_LOG), nan=_MOST_LOG))

    distance = _by_joint(bones, ways.distance)
    segment = _nearest_segment(bones, ways.distance)[rows, joint]
    length = np.linalg.norm(bones.end - bones.begin, axis=1)[segment]
    along = bones.along(surface.points)[rows, segment]
    depth = np.maximum(ways.depth[:, None], 1e-3 * size)
    places = bones.places(np.repeat(surface.points, joint.shape[1], 0), segment.ravel()).reshape(count, -1, 3)
    out = surface.points[:, None] - places
    out /= np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-9 * size)
    children = np.bincount(above[above >= 0], minlength=bones.count)
    hops = _hops(above)[joint[:, :1], joint]
    area = surface.areas / max(float(surface.areas.sum()), 1e-300)
    island, number = surface.islands, int(surface.islands.max()) + 1
    owned = np.bincount(heats[0].argmax(axis=1), area, bones.count)
    whole = np.stack([np.bincount(island, area * heats[0][:, j], number) for j in range(bones.count)], axis=1)
    share = np.bincount(island, area, number)
    mean: FloatArray = whole / np.maximum(share, 1e-12)[:, None]
    edge, crease = _shape(surface)

    def of_point(value: FloatArray | IntArray | BoolArray) -> FloatArray:
        return np.broadcast_to(np.asarray(value, np.float64).reshape(-1, 1), joint.shape)

    columns = [
        *(pick(h) for h in heats), pick(ways.belonging.shares), ratio(distance), ratio(_by_joint(bones, ways.seen)),
        ratio(_by_joint(bones, ways.from_middle)), ratio(voxel_distance(surface, bones)),
        np.log(np.minimum(pick(distance) / size, 1.0) + 1e-3), np.clip(along / np.maximum(length, 1e-3 * size), -1, 2),
        np.log(length / size + 1e-3), np.clip(along / depth, -3, 3), np.clip((length - along) / depth, -3, 3),
        np.einsum("pkc,pc->pk", out, surface.normals), children[joint] == 0, np.minimum(children[joint], 4) / 4,
        hops == 0, hops == 1, hops == 2, hops >= _MOST_HOPS, mean[island[:, None], joint],
        of_point(np.log(depth[:, 0] / size)), of_point(share[island]),
        np.full(joint.shape, np.log(number) / 4), of_point(surface.border),
        of_point(np.clip(edge / depth[:, 0], 0, 3)), of_point(crease), np.sqrt(owned)[joint],
    ]  # fmt: skip
    table = np.zeros((*joint.shape, len(FEATURES)), np.float32)
    for k, column in enumerate(columns):
        table[..., k] = column
    return table


def _by_joint(bones: Bones, table: FloatArray) -> FloatArray:
    """(P, J) the least of the segments (P, S) of each joint; inf where it has none."""
    out = np.full((len(table), bones.count), np.inf)
    for s, j in enumerate(bones.joint):
        np.minimum(out[:, j], table[:, s], out=out[:, j])
    return out


def _nearest_segment(bones: Bones, distance: FloatArray) -> IndexArray:
    """(P, J) the segment of each joint that is nearest to a point; 0 where it has none."""
    out = np.zeros((len(distance), bones.count), np.intp)
    for j in np.unique(bones.joint):
        own = np.nonzero(bones.joint == j)[0]
        out[:, j] = own[distance[:, own].argmin(axis=1)]
    return out


def _nearest_ancestor(parents: IntArray, used: IntArray, count: int) -> IntArray:
    """(J,) the nearest ancestor that moves the mesh; -1 for none, and of joints that do not."""
    moves = np.zeros(count, bool)
    moves[used] = True
    out = np.full(count, -1, np.int64)
    for j in used:
        up = parents[j]
        while up >= 0 and not moves[up]:
            up = parents[up]
        out[j] = up
    return out


def _hops(above: IntArray) -> IntArray:
    """(J, J) steps from joint to joint along the skeleton, at most `_MOST_HOPS`."""
    count = len(above)
    near = np.eye(count, dtype=bool)
    child = np.nonzero(above >= 0)[0]
    near[child, above[child]] = near[above[child], child] = True
    out, reached = np.full((count, count), _MOST_HOPS, np.int64), np.eye(count, dtype=bool)
    out[reached] = 0
    for k in range(1, _MOST_HOPS):
        further = (reached.astype(np.float32) @ near.astype(np.float32)) > 0
        out[further & ~reached] = k
        reached = further
    return out


def _parent_places(joint: IndexArray, exists: FloatArray, above: IntArray) -> IndexArray:
    """(P, K)"""
    wanted = above[joint]
    found = (joint[:, None, :] == wanted[:, :, None]) & (exists[:, None, :] > 0) & (exists[:, :, None] > 0)
    found &= wanted[:, :, None] >= 0
    return np.asarray(np.where(found.any(axis=2), found.argmax(axis=2), joint.shape[1]))


def _same_joint(surface: Surface, joint: IndexArray, exists: FloatArray) -> IndexArray:
    """(P, N, K)"""
    count, width = joint.shape
    neighbour = _neighbours(surface)
    other = joint[np.maximum(neighbour, 0)]  # (P, N, K)
    match = (other[:, :, None, :] == joint[:, None, :, None]) & (exists[np.maximum(neighbour, 0)] > 0)[:, :, None, :]
    match &= (exists > 0)[:, None, :, None] & (neighbour >= 0)[:, :, None, None]
    at = neighbour[:, :, None] * width + match.argmax(axis=3)
    return np.asarray(np.where(match.any(axis=3), at, count * width))


def _neighbours(surface: Surface) -> IntArray:
    """(P, N) the nearest neighbours of a point along edges, -1 where there are fewer."""
    count, (a, b) = len(surface.points), surface.edges.T
    begin, end = np.r_[a, b], np.r_[b, a]
    length = np.linalg.norm(surface.points[begin] - surface.points[end], axis=1)
    order = np.lexsort((length, begin))
    begin, end = begin[order], end[order]
    place = np.arange(len(begin)) - np.searchsorted(begin, begin)
    out = np.full((count, NEIGHBOURS), -1, np.int64)
    kept = place < NEIGHBOURS
    out[begin[kept], place[kept]] = end[kept]
    return out


def _shape(surface: Surface) -> tuple[FloatArray, FloatArray]:
    """(P,) mean length of the edges at each point, and how far the neighbours are above the surface, over that."""
    count, (a, b) = len(surface.points), surface.edges.T
    links = sparse.csr_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(count, count))
    amount = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1.0)
    length = np.linalg.norm(surface.points[a] - surface.points[b], axis=1)
    edge = (np.bincount(a, length, count) + np.bincount(b, length, count)) / amount
    away = (links @ surface.points) / amount[:, None] - surface.points
    crease = np.einsum("pc,pc->p", away, surface.normals) / np.maximum(edge, 1e-9)
    return edge, np.clip(crease, -1, 1)
