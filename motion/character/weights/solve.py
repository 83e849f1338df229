"""Weights for a mesh and the joints in it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.surface import Surface, join_vertices
from muybridge.motion.character.weights.bones import Bones, bones_in
from muybridge.motion.character.weights.distance import distance_weights
from muybridge.motion.character.weights.heat import heat_weights
from muybridge.motion.character.weights.islands import follow_surface
from muybridge.motion.character.weights.rays import RayGrid
from muybridge.motion.character.weights.voxels import voxel_weights

WEIGHT_METHODS = ("auto", "heat", "voxels", "distance")
_INWARD = 2e-4  # of the size of the mesh by which ways begin below the surface
_CONE = np.radians(30.0)  # of the rays that measure how thick the mesh is
_RAYS = 5
_FROM_SURFACE = 0.3  # how much the distance from the vertex counts beside that from the middle of the limb
_TIE = 1e-4
_BROKEN = 0.3  # share of points on borders from which a surface is pieces, not a body
_MOST_POINTS = 40_000  # larger meshes are weighted on a coarser surface
_SMOOTHED = 8  # steps of smoothing after that


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


class _Belonging(NamedTuple):
    """(P, J) the joint that each point belongs to, and (P,) metres to its bone."""

    shares: FloatArray
    distance: FloatArray


def skin_weights(
    vertices: FloatArray, triangles: IntArray, joints: FloatArray, parents: IntArray, method: str = "auto",
    options: WeightOptions | None = None,
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

    Raises:
        ValueError: no such method, or arrays that do not fit together or are not finite.
    """
    options = options or WeightOptions()
    vertices, joints = np.asarray(vertices, np.float64), np.asarray(joints, np.float64)
    triangles, parents = np.asarray(triangles, np.int64), np.asarray(parents, np.int64)
    _check(vertices, triangles, joints, parents, method)
    surface = join_vertices(vertices, triangles).outward()
    coarse = len(surface.points) > _MOST_POINTS
    solved = surface.coarser(_MOST_POINTS) if coarse else surface
    weights = _solve(solved, joints, parents, method, options)
    if coarse:
        weights = _smoothed(surface, weights[solved.point_of], _SMOOTHED)
    return _pruned(weights, options)[surface.point_of]


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


def _solve(surface: Surface, joints: FloatArray, parents: IntArray, method: str, options: WeightOptions) -> FloatArray:
    """(P, J) weights before pruning."""
    bones = bones_in(surface, joints, parents)
    if method == "auto":
        method = "voxels" if surface.border.mean() > _BROKEN else "heat"
    if method == "distance":
        distance = bones.distance(surface.points)
        return distance_weights(bones, distance, bones.along(surface.points), parents)
    if method == "voxels":
        return voxel_weights(surface, bones)
    distance = bones.distance(surface.points)
    rays = RayGrid(surface.points, surface.triangles)
    middle, depth = _middles(surface, rays, distance.min(axis=1))
    from_middle = bones.distance(middle)
    seen = _seen(surface, rays, bones, distance, from_middle, options.outside)
    belonging = _belonging(bones, from_middle + _FROM_SURFACE * seen, seen)
    weights = heat_weights(surface, belonging.shares, belonging.distance, options.strength)
    return follow_surface(surface, weights, from_middle.min(axis=1), depth)


def _seen(
    surface: Surface, rays: RayGrid, bones: Bones, distance: FloatArray, from_middle: FloatArray, outside: float
) -> FloatArray:
    """(P, S) metres to the segments, longer for what of the way is outside of the mesh.

    Only ways that may decide which bone is a point's are looked at; the others count as outside all along.
    """
    longest = distance * (1 + outside)
    open_to = from_middle + _FROM_SURFACE * distance <= (from_middle + _FROM_SURFACE * longest).min(axis=1)[:, None]
    point, segment = np.nonzero(open_to)
    share = rays.outside(_below(surface)[point], bones.places(surface.points[point], segment))
    longest[point, segment] = distance[point, segment] * (1 + outside * share)
    return longest


def _below(surface: Surface) -> FloatArray:
    """(P, 3) the points, a little below the surface."""
    return np.asarray(surface.points - _INWARD * surface.size * surface.normals)


def _middles(surface: Surface, rays: RayGrid, most: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P, 3) places in the middle of the limb below each point, and (P,) metres that they are deep.

    A limb is as thick as rays inward find it, the median of a cone, after Shapira, Shamir and Cohen-Or, Consistent mesh
    partitioning and skeletonisation using the shape diameter function, 2008. A place is no deeper than `most` (P,).

    On a wide trunk, bones of arms and legs begin nearer to the skin than the spine is, but the middle of the trunk is
    at the spine.
    """
    normal = surface.normals
    helper = np.where(np.abs(normal[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    first = np.cross(normal, helper)
    first /= np.maximum(np.linalg.norm(first, axis=1, keepdims=True), 1e-12)
    second = np.cross(normal, first)
    begin, reach = _below(surface), 2 * most[:, None]
    found = np.full((_RAYS, len(normal)), np.inf)
    for k in range(_RAYS):
        way = -normal
        if k:
            turn = 2 * np.pi * k / (_RAYS - 1)
            way = -np.cos(_CONE) * normal + np.sin(_CONE) * (np.cos(turn) * first + np.sin(turn) * second)
        found[k] = rays.exits(begin, begin + reach * way)
    # A ray that leaves nowhere within reach only says that the limb is at least as thick.
    depth = most * np.minimum(np.median(found, axis=0), 1.0)
    return np.asarray(surface.points - depth[:, None] * normal), depth


def _belonging(bones: Bones, cost: FloatArray, distance: FloatArray) -> _Belonging:
    """The bones of least cost, shared where several are equal."""
    nearest = cost.argmin(axis=1)
    least = np.take_along_axis(cost, nearest[:, None], axis=1)
    chosen = cost <= least * (1 + _TIE)
    shares = np.zeros((len(cost), bones.count))
    for s, j in enumerate(bones.joint):
        shares[:, j] = np.maximum(shares[:, j], chosen[:, s])
    return _Belonging(shares / shares.sum(axis=1, keepdims=True), distance[np.arange(len(cost)), nearest])


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
