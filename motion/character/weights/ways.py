"""Ways from the points of a surface to the bones: straight, as they are seen through the mesh, and from its middle."""

from typing import NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.surface import Surface
from muybridge.motion.character.weights.bones import Bones
from muybridge.motion.character.weights.rays import RayGrid

_INWARD = 2e-4  # of the size of the mesh by which ways begin below the surface
_CONE = np.radians(30.0)  # of the rays that measure how thick the mesh is
_RAYS = 5
_FROM_SURFACE = 0.3  # how much the distance from the vertex counts beside that from the middle of the limb
_TIE = 1e-4


class Belonging(NamedTuple):
    """(P, J) the joint that each point belongs to, and (P,) metres to its bone."""

    shares: FloatArray
    distance: FloatArray


class Ways(NamedTuple):
    """How far the segments are from the points of a surface.

    Attributes:
        distance: (P, S) metres.
        seen: (P, S) metres, longer for what of the way is outside of the mesh.
        from_middle: (P, S) metres from the middle of the limb below each point.
        depth: (P,) metres that this middle is deep.
        belonging: of the points to joints.
    """

    distance: FloatArray
    seen: FloatArray
    from_middle: FloatArray
    depth: FloatArray
    belonging: Belonging


def find_ways(surface: Surface, bones: Bones, outside: float = 1.0) -> Ways:
    """What heat starts from.

    Args:
        surface: of the mesh.
        bones: in it.
        outside: how much longer a way is that runs outside of the mesh.
    """
    distance = bones.distance(surface.points)
    rays = RayGrid(surface.points, surface.triangles)
    middle, depth = _middles(surface, rays, distance.min(axis=1))
    from_middle = bones.distance(middle)
    seen = _seen(surface, rays, bones, distance, from_middle, outside)
    return Ways(distance, seen, from_middle, depth, _belonging(bones, from_middle + _FROM_SURFACE * seen, seen))


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


def _belonging(bones: Bones, cost: FloatArray, distance: FloatArray) -> Belonging:
    """The bones of least cost, shared where several are equal."""
    nearest = cost.argmin(axis=1)
    least = np.take_along_axis(cost, nearest[:, None], axis=1)
    chosen = cost <= least * (1 + _TIE)
    shares = np.zeros((len(cost), bones.count))
    for s, j in enumerate(bones.joint):
        shares[:, j] = np.maximum(shares[:, j], chosen[:, s])
    return Belonging(shares / shares.sum(axis=1, keepdims=True), distance[np.arange(len(cost)), nearest])
