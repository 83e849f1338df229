"""Bones as straight segments in a mesh: which joints move it, and where each bone begins and ends."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from muybridge.arrays import BoolArray, FloatArray, IndexArray, IntArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.motion.character.surface import Surface

_INSIDE = 0.5  # winding number from which a place is inside
_SAMPLES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of a segment, at which it is judged
_MOST_OUTSIDE = 0.6  # share of a bone outside, from which it moves nothing
_SKIN = 0.005  # of the size of the mesh: a joint so near to the surface may be in a mouth or a socket
_SAME_PLACE = 0.06  # of the size of the mesh: a loose chain so near to the main one is a control, not a bone
_BRANCH = 0.3  # of the way from a joint to one of several children belongs to the joint
_LEAST_CHAIN = 8  # joints of the main chain; characters of a few rigid parts may have all of them on one root


@dataclass(frozen=True, eq=False)
class Bones:
    """The segments of a skeleton that move a mesh.

    Attributes:
        joint: (S,) the joint that a segment turns with, ascending.
        begin: (S, 3) metres, the joint.
        end: (S, 3) metres: the only child; where a bone without child leaves the mesh; of a joint with several children
            the middle between them, and a part of the way to each.
        child: (S,) the joint that begins where the segment ends; -1 where none does.
        count: of the skeleton's joints.
    """

    joint: IndexArray
    begin: FloatArray
    end: FloatArray
    child: IndexArray
    count: int

    def along(self, points: FloatArray) -> FloatArray:
        """(P, S) metres from the beginning of each segment along it to points (P, 3); negative behind it."""
        way = self._ways()
        return np.asarray(points @ way.T - np.sum(self.begin * way, axis=1))

    def distance(self, points: FloatArray) -> FloatArray:
        """(P, S) metres from points (P, 3) to the segments."""
        along = self.along(points)
        reached = np.clip(along, 0.0, np.linalg.norm(self.end - self.begin, axis=1))
        to_begin_sq = (
            np.sum(points * points, axis=1)[:, None] - 2 * points @ self.begin.T + np.sum(self.begin**2, axis=1)
        )
        return np.asarray(np.sqrt(np.maximum(to_begin_sq + reached * (reached - 2 * along), 0.0)))

    def places(self, points: FloatArray, segments: IndexArray) -> FloatArray:
        """(P, 3) the nearest place to points (P, 3), each on its own segment (P,)."""
        begin, way = self.begin[segments], self.end[segments] - self.begin[segments]
        share = np.sum((points - begin) * way, axis=1) / np.maximum(np.sum(way * way, axis=1), 1e-18)
        return np.asarray(begin + np.clip(share, 0.0, 1.0)[:, None] * way)

    def _ways(self) -> FloatArray:
        way = self.end - self.begin
        return np.asarray(way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12))


def bones_in(surface: Surface, joints: FloatArray, parents: IntArray, still: BoolArray | None = None) -> Bones:
    """The segments of the joints that move a surface.

    A bone that is outside of the mesh moves nothing: a root on the floor, a target of inverse kinematics, a slot for
    props. Nor do controls, chains of their own that lie on the bones of the main chain. A bone without child is as long
    as the mesh goes on around its joint.

    Args:
        surface: of the mesh.
        joints: (J, 3) metres, at rest.
        parents: (J,) of the joints; -1 for a root.
        still: (J,) joints that move nothing wherever they are; a bone may end at one.
    """
    parents = np.asarray(parents, np.int64)
    count = len(joints)
    children: list[list[int]] = [[] for _ in range(count)]
    for j, p in enumerate(parents):
        if p >= 0:
            children[p].append(j)
    size = surface.size
    inside = _winding(joints, surface) > _INSIDE
    inside |= np.array([bool(c) for c in children]) & (_distance(joints, surface) < _SKIN * size)
    pairs = np.array([(p, j) for j, p in enumerate(parents) if p >= 0], np.int64).reshape(-1, 2)
    share = _share_inside(surface, joints, pairs)
    kept: dict[int, list[int]] = {j: [] for j in range(count)}
    for (p, j), part in zip(pairs, share, strict=True):
        if part > 1 - _MOST_OUTSIDE and (inside[p] or parents[p] >= 0):
            kept[p].append(j)
    moves = inside | np.array([bool(kept[j]) for j in range(count)])
    if still is not None:
        moves &= ~still
    moves &= ~_controls(joints, parents, kept, moves, surface)
    if not moves.any():
        moves[:] = True
    return _extended(_segments(joints, kept, np.nonzero(moves)[0]), surface, joints, parents)


def _segments(joints: FloatArray, kept: dict[int, list[int]], of: IndexArray) -> Bones:
    """The segments of some joints; those without child have no length yet.

    The way to a child beside the bone, such as from the chest to a shoulder or from the head to an ear, is no bone of
    an artist's: only its beginning counts.
    """
    rows: list[tuple[int, FloatArray, int]] = []
    for j in of:
        ends = [joints[k] for k in kept[j]]
        if len(ends) < 2:
            rows.append((j, ends[0] if ends else joints[j], kept[j][0] if ends else -1))
        else:
            rows.append((j, np.mean(ends, axis=0), -1))
            rows += [(j, joints[j] + _BRANCH * (e - joints[j]), -1) for e in ends]
    joint = np.array([r[0] for r in rows], np.intp)
    ends_at = np.array([r[1] for r in rows]).reshape(-1, 3)
    return Bones(joint, joints[joint], ends_at, np.array([r[2] for r in rows], np.intp), len(joints))


def _controls(
    joints: FloatArray, parents: IntArray, kept: dict[int, list[int]], moves: BoolArray, surface: Surface
) -> BoolArray:
    """(J,) whether a joint is of a chain of its own whose bones all lie on those of the main chain."""
    chain = np.arange(len(joints))
    for j, p in enumerate(parents):
        if p >= 0 and moves[p] and moves[j]:
            chain[j] = chain[p]
    sizes = np.bincount(chain[moves], minlength=len(joints)) if moves.any() else np.zeros(len(joints), int)
    main = np.nonzero(moves & (chain == sizes.argmax()))[0]
    out = np.zeros(len(joints), bool)
    if len(main) < _LEAST_CHAIN:
        return out
    bones = _segments(joints, kept, main)
    near = bones.distance(joints).min(axis=1) < _SAME_PLACE * surface.size
    for c in np.unique(chain[moves]):
        own = moves & (chain == c)
        if c != sizes.argmax() and near[own].mean() > 0.5:
            out |= own
    return out


def _extended(bones: Bones, surface: Surface, joints: FloatArray, parents: IntArray) -> Bones:
    """Bones without child, lengthened to where the mesh ends in the direction of the vertices next to them."""
    leaf = np.nonzero((bones.begin == bones.end).all(axis=1))[0]
    if not len(leaf):
        return bones
    distance = bones.distance(surface.points)
    least = distance.min(axis=1) + 1e-6 * surface.size
    end = bones.end.copy()
    for s in leaf:
        joint = bones.joint[s]
        own = surface.points[distance[:, s] <= least]
        up = parents[joint]
        way = joints[joint] - joints[up] if up >= 0 else np.zeros(3)
        length = np.linalg.norm(way)
        way = way / length if length > 1e-9 else np.zeros(3)
        if len(own) >= 3:
            middle = own.mean(axis=0) - joints[joint]
            reach = np.linalg.norm(middle)
            way = middle / reach if reach > 1e-9 else way
            # The bone ends as far before the surface as limbs are thick, where distances to it are even.
            along = (own - joints[joint]) @ way
            across = np.linalg.norm(own - joints[joint] - along[:, None] * way, axis=1)
            end[s] = joints[joint] + max(float(along.max()) - float(np.median(across)), 0.0) * way
    return Bones(bones.joint, bones.begin, end, bones.child, bones.count)


def _distance(places: FloatArray, surface: Surface) -> FloatArray:
    """(N,) metres from places to the nearest vertex."""
    return np.asarray(cKDTree(surface.points).query(places)[0])


def _share_inside(surface: Surface, joints: FloatArray, pairs: IntArray) -> FloatArray:
    """(S,) share of the ways between pairs of joints that is inside of the mesh."""
    if not len(pairs):
        return np.zeros(0)
    a, b = joints[pairs[:, 0]], joints[pairs[:, 1]]
    places = np.stack([a + t * (b - a) for t in _SAMPLES], axis=1)
    return np.asarray((_winding(places.reshape(-1, 3), surface) > _INSIDE).reshape(len(pairs), -1).mean(axis=1))


def _winding(places: FloatArray, surface: Surface) -> FloatArray:
    """(N,) winding numbers of a surface about places (N, 3): one inside, zero outside, between where it is open."""
    return np.asarray(_winding_kernel(np.ascontiguousarray(places), surface.points, surface.triangles))


@compiled
def _winding_kernel(places, points, triangles):  # type: ignore[no-untyped-def]
    """Jacobson, Kavan, Sorkine-Hornung, Robust inside-outside segmentation, 2013; solid angles of van Oosterom."""
    out = np.zeros(len(places))
    for n in range(len(places)):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        total = 0.0
        for f in range(len(triangles)):
            i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
            ax, ay, az = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
            bx, by, bz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            cx, cy, cz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            la = np.sqrt(ax * ax + ay * ay + az * az)
            lb = np.sqrt(bx * bx + by * by + bz * bz)
            lc = np.sqrt(cx * cx + cy * cy + cz * cz)
            det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            low = (la * lb * lc + (ax * bx + ay * by + az * bz) * lc + (bx * cx + by * cy + bz * cz) * la
                   + (cx * ax + cy * ay + cz * az) * lb)  # fmt: skip
            total += np.arctan2(det, low)
        out[n] = total / (2 * np.pi)
    return out
