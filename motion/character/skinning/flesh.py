"""Volume-keeping skinning: what a bend presses together is moved aside, so that limbs keep their volume.

Every method that turns vertices one by one loses what is on the inside of a bend twice: the crease shortens, and the
two parts of a folded limb run into each other, where a signed volume counts their flesh two times. Both are put right
after the vertices were turned about rotation centres:

1. Contact. Parts of a limb on the two sides of a joint meet in the plane that bisects them. What has crossed it, on the
   inside of the bend, goes back to it, except for what was beyond it at rest.
2. Volume. Around each joint the surface moves along its normals until the volume is that at rest. The amount fades with
   the distance from the joint; on the side of the bend that is stretched, and where the parts touch, nothing is added.

The plane stands for the contact surface of Vaillant and others, Implicit skinning, 2013; the correction of volume along
a fixed field of displacements is that of von Funck, Theisel and Seidel, Volume-preserving mesh skinning, 2008, with all
joints solved together.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from muybridge.motion.character.skinning.delta_mush import skin_surface
from muybridge.motion.character.skinning.flesh_kernels import at_rest, keep
from muybridge.motion.character.skinning.skin import Skin
from muybridge.motion.character.surface import Surface

# All lengths are radii of the ring around the joint where both sides weigh the same.
_SPREAD = 2.0  # how far from the ring the moved volume is spread
_TOUCHING, _APART = 4.0, 6.0  # parts of a limb that are nearer to the joint touch; those farther off are let through
_BESIDE = 3.0  # the surface that tells which way a side of the joint lies
_WIDE, _MOST_WIDE = 2.0, 0.02  # a limb has hardly any surface there farther from its axis
_ACROSS = -0.5  # most cosine between the ways to the two sides of a limb
_LEAST_AROUND = 0.5  # mean cosine of normals at a ring to its radii; where less, it encloses a patch, not a limb
_LEAST_RING = 6  # edges across the ring
_LEAST_SPREAD = 0.02  # of the field at the ring


class Hinge(NamedTuple):
    """A joint as two sides of the surface.

    Attributes:
        joints: on the two sides, which vertices at the joint follow.
        ring: (E, 2) points of edges from the first side to the second, and so across the ring.
        along: (E,) where on each of them both sides weigh the same.
        radius: metres, of the ring.
        points: (N,) of the surface around it.
        side: (N,) -1 or 1.
        spread: (N,) share of the correction that each takes, from 0 to 1.
        touch: (N,) whether contact holds for each, from 0 to 1.
        triangles: (F, 3) points, around those that a correction moves.
        loops: directed edges (B, 2) of each border of the triangles.
    """

    joints: tuple[int, int]
    ring: IntArray
    along: FloatArray
    radius: float
    points: IndexArray
    side: FloatArray
    spread: FloatArray
    touch: FloatArray
    triangles: IntArray
    loops: list[IntArray]


class Packed(NamedTuple):
    """The hinges of a surface one after another, for compiled loops; `*_of` (H + 1,) tell where each begins."""

    joints: IntArray  # (H, 2)
    radius: FloatArray  # (H,)
    ring_of: IntArray
    ring: IntArray
    along: FloatArray
    points_of: IntArray
    points: IntArray
    side: FloatArray
    spread: FloatArray
    touch: FloatArray
    inside: BoolArray  # whether a point is one of the hinge's triangles
    triangles_of: IntArray
    triangles: IntArray
    loops_of: IntArray
    borders_of: IntArray  # (L + 1,) where the edges of each loop begin
    borders: IntArray


@dataclass(frozen=True, eq=False)
class Flesh:
    """A mesh whose joints keep their volume.

    Attributes:
        surface: of the mesh; vertices that are in one place but follow other joints stay apart.
        first: (P,) a vertex of each point.
        hinges: its joints.
        packed: the same as arrays.
    """

    surface: Surface
    first: IndexArray
    hinges: tuple[Hinge, ...]
    packed: Packed

    def apply(self, posed: Float32Array, shape: FloatArray, rotations: Float32Array) -> None:
        """Correct vertices (T, V, 3) in place.

        Args:
            posed: skinned.
            shape: (V, 3) that they had at rest.
            rotations: (T, J, 3, 3) of the joints, from the rest.
        """
        if not self.hinges:
            return
        points = shape[self.first].astype(np.float64)
        rest = at_rest(points, self.packed)
        keep(posed, self.first, self.surface.point_of, self.surface.triangles, rotations.astype(np.float64), rest,
             self.packed)  # fmt: skip


def prepare_flesh(skin: Skin) -> Flesh:
    """What volume keeping needs of a skin."""
    surface, first = skin_surface(skin)
    shape = skin.stretched(skin.positions)[first]
    surface = Surface(shape, surface.triangles, surface.point_of).outward()
    hinges = tuple(_hinges(surface, _weights(skin, first)))
    return Flesh(surface, first, hinges, _packed(hinges))


def _weights(skin: Skin, first: IndexArray) -> sparse.csr_matrix:
    """(P, J) of the points."""
    joints, weights = skin.joints[first], skin.weights[first]
    rows = np.repeat(np.arange(len(first)), joints.shape[1])
    return sparse.csr_matrix((weights.ravel(), (rows, joints.ravel())), shape=(len(first), len(skin.bind)))


def _links(pairs: IntArray, values: FloatArray, count: int) -> sparse.csr_matrix:
    return sparse.csr_matrix((values, pairs.T), shape=(count, count))


def _hinges(surface: Surface, weights: sparse.csr_matrix) -> Iterator[Hinge]:
    """One for each edge of the tree of joints that share most of the surface: no skeleton says which turn together."""
    count, joints = weights.shape
    shared = (weights.T @ weights).tocoo()
    above = shared.row < shared.col
    if not above.any():
        return
    pairs = np.column_stack([shared.row, shared.col])[above]
    tree = minimum_spanning_tree(_links(pairs, 2 * shared.data.max() - shared.data[above], joints)).tocoo()
    edges = surface.edges
    lengths = np.linalg.norm(surface.points[edges[:, 0]] - surface.points[edges[:, 1]], axis=1)
    paths = _links(edges, np.maximum(lengths, 1e-12), count)
    branches = np.column_stack([tree.row, tree.col])
    for b, (j, k) in enumerate(branches):
        others = np.delete(branches, b, axis=0)
        part = connected_components(_links(others, np.ones(len(others)), joints), directed=False)[1]
        share = np.asarray(weights @ (part == part[k]).astype(float))
        hinge = _hinge(surface, (int(j), int(k)), share, paths)
        if hinge is not None:
            yield hinge


def _hinge(surface: Surface, joints: tuple[int, int], share: FloatArray, paths: sparse.csr_matrix) -> Hinge | None:
    """The joint between two sides; share (P,) of the second side in the weights. None where no ring goes around it."""
    points, edges, triangles = surface.points, surface.edges, surface.triangles
    ring = edges[(share[edges[:, 0]] < 0.5) != (share[edges[:, 1]] < 0.5)]
    if len(ring) < _LEAST_RING:
        return None
    low, high = share[ring].T
    along = (0.5 - low) / (high - low)
    places = points[ring[:, 0]] + along[:, None] * (points[ring[:, 1]] - points[ring[:, 0]])
    centre = places.mean(axis=0)
    radius = float(np.linalg.norm(places - centre, axis=1).mean())
    if radius < 1e-9:
        return None
    outwards = np.sum(surface.normals[ring].mean(axis=1) * (places - centre), axis=1)
    if outwards.mean() < _LEAST_AROUND * radius:
        return None
    away = dijkstra(paths, directed=False, indices=np.unique(ring), min_only=True, limit=12 * radius)
    spread = 1 / np.cosh(np.minimum(away / (_SPREAD * radius), 50.0))
    spread = np.maximum(spread - _LEAST_SPREAD, 0) / (1 - _LEAST_SPREAD)
    bending = (share > 1e-3) & (share < 1 - 1e-3)
    chosen = triangles[((spread > 0) | (bending & np.isfinite(away)))[triangles].any(axis=1)]
    side = np.where(share < 0.5, -1.0, 1.0)
    off = points - centre
    touch = np.clip((_APART - np.linalg.norm(off, axis=1) / radius) / (_APART - _TOUCHING), 0, 1)
    touch = np.where(np.isfinite(away), touch * touch * (3 - 2 * touch), 0.0)
    if not _is_limb(off[np.isfinite(away)], side[np.isfinite(away)], radius):
        touch = np.zeros_like(touch)
    near = np.union1d(np.nonzero(touch)[0], chosen)
    return Hinge(joints, ring, along, radius, near, side[near], spread[near], touch[near], chosen,
                 _loops(chosen, len(points)))  # fmt: skip


def _is_limb(off: FloatArray, side: FloatArray, radius: float) -> bool:
    """Whether both sides of a joint are as slim as the joint and lie across it; off (N, 3) from it.

    A trunk is not slim: the plane between it and an arm meets flesh that the arm never touches. The halves of a palm do
    not lie across the joints between them.
    """
    near = np.linalg.norm(off, axis=1) < _BESIDE * radius
    wide, axes = 0, []
    for which in (-1.0, 1.0):
        own = off[near & (side == which)]
        if not len(own):
            return False
        axis = own.mean(axis=0)
        axis = axis / max(float(np.linalg.norm(axis)), 1e-12)
        wide += int((np.linalg.norm(np.cross(own, axis), axis=1) > _WIDE * radius).sum())
        axes.append(axis)
    return bool(axes[0] @ axes[1] < _ACROSS and wide <= _MOST_WIDE * near.sum())


def _loops(triangles: IntArray, count: int) -> list[IntArray]:
    """Directed edges of one triangle only, by loop."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    key, back = sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0]
    edges = sides[~np.isin(key, back)]
    if not len(edges):
        return []
    loop = connected_components(_links(edges, np.ones(len(edges)), count), directed=False)[1][edges[:, 0]]
    return [edges[loop == k] for k in np.unique(loop)]


def _packed(hinges: tuple[Hinge, ...]) -> Packed:
    def starts(sizes: list[int]) -> IntArray:
        return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    def joined(parts: list[IntArray] | list[IndexArray], width: int) -> IntArray:
        shape = (-1, width) if width else (-1,)
        return np.concatenate([np.zeros((0, width) if width else 0, np.int64), *parts]).astype(np.int64).reshape(shape)

    def floats(parts: list[FloatArray]) -> FloatArray:
        return np.concatenate([np.zeros(0), *parts])

    loops = [loop for h in hinges for loop in h.loops]
    return Packed(
        np.array([h.joints for h in hinges], np.int64).reshape(-1, 2),
        np.array([h.radius for h in hinges], np.float64),
        starts([len(h.ring) for h in hinges]), joined([h.ring for h in hinges], 2), floats([h.along for h in hinges]),
        starts([len(h.points) for h in hinges]), joined([h.points for h in hinges], 0),
        floats([h.side for h in hinges]), floats([h.spread for h in hinges]), floats([h.touch for h in hinges]),
        np.concatenate([np.zeros(0, bool), *(np.isin(h.points, h.triangles) for h in hinges)]),
        starts([len(h.triangles) for h in hinges]), joined([h.triangles for h in hinges], 3),
        starts([len(h.loops) for h in hinges]), starts([len(loop) for loop in loops]), joined(loops, 2),
    )  # fmt: skip
