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
_LEAST_CHAIN = 8  # joints of the main chain; characters of a few rigid parts may have all of them on one root


@dataclass(frozen=True, eq=False)
class Bones:
    """The segments of a skeleton that move a mesh.

    Attributes:
        joint: (S,) the joint that a segment turns with, ascending; a joint with several children has several.
        begin: (S, 3) metres, the joint.
        end: (S, 3) metres: the child joint, or where a bone without child leaves the mesh.
        count: of the skeleton's joints.
    """

    joint: IndexArray
    begin: FloatArray
    end: FloatArray
    count: int

    def nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(P, S) metres from points (P, 3) to the segments, and (P, S, 3) the nearest places on them."""
        along = self.end - self.begin
        length_sq = np.maximum(np.sum(along * along, axis=1), 1e-18)
        share = np.clip((points @ along.T - np.sum(self.begin * along, axis=1)) / length_sq, 0.0, 1.0)
        places = self.begin + share[..., None] * along
        return np.linalg.norm(points[:, None] - places, axis=2), places


def bones_in(surface: Surface, joints: FloatArray, parents: IntArray) -> Bones:
    """The segments of the joints that move a surface.

    A bone that is outside of the mesh moves nothing: a root on the floor, a target of inverse kinematics, a slot for
    props. Nor do controls, chains of their own that lie on the bones of the main chain. A bone without child is as long
    as the mesh goes on around its joint.

    Args:
        surface: of the mesh.
        joints: (J, 3) metres, at rest.
        parents: (J,) of the joints; -1 for a root.
    """
    parents = np.asarray(parents, np.int64)
    count = len(joints)
    children: list[list[int]] = [[] for _ in range(count)]
    for j, p in enumerate(parents):
        if p >= 0:
            children[p].append(j)
    size = float(np.linalg.norm(np.ptp(surface.points, axis=0)))
    inside = _winding(joints, surface) > _INSIDE
    inside |= np.array([bool(c) for c in children]) & (_distance(joints, surface) < _SKIN * size)
    pairs = np.array([(p, j) for j, p in enumerate(parents) if p >= 0], np.int64).reshape(-1, 2)
    share = _share_inside(surface, joints, pairs)
    kept: dict[int, list[int]] = {j: [] for j in range(count)}
    for (p, j), part in zip(pairs, share, strict=True):
        if part > 1 - _MOST_OUTSIDE and (inside[p] or parents[p] >= 0):
            kept[p].append(j)
    moves = inside | np.array([bool(kept[j]) for j in range(count)])
    moves &= ~_controls(joints, parents, kept, moves, surface)
    if not moves.any():
        moves[:] = True
    segments = [(j, joints[j], joints[k]) for j in range(count) if moves[j] for k in kept[j]]
    segments += [(j, joints[j], joints[j]) for j in range(count) if moves[j] and not kept[j]]
    segments.sort(key=lambda s: s[0])
    bones = Bones(np.array([s[0] for s in segments], np.intp), np.array([s[1] for s in segments]),
                  np.array([s[2] for s in segments]), count)  # fmt: skip
    return _extended(bones, surface, joints, parents)


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
    segments = [(j, joints[j], joints[k]) for j in main for k in (kept[j] or [j])]
    out = np.zeros(len(joints), bool)
    if len(main) < _LEAST_CHAIN:
        return out
    bones = Bones(np.array([s[0] for s in segments], np.intp), np.array([s[1] for s in segments]),
                  np.array([s[2] for s in segments]), len(joints))  # fmt: skip
    near = bones.nearest(joints)[0].min(axis=1) < _SAME_PLACE * np.linalg.norm(np.ptp(surface.points, axis=0))
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
    distance, _ = bones.nearest(surface.points)
    least = distance.min(axis=1) + 1e-6 * float(np.linalg.norm(np.ptp(surface.points, axis=0)))
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
    return Bones(bones.joint, bones.begin, end, bones.count)


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
            det = (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx))
            low = (la * lb * lc + (ax * bx + ay * by + az * bz) * lc + (bx * cx + by * cy + bz * cz) * la
                   + (cx * ax + cy * ay + cz * az) * lb)  # fmt: skip
            total += np.arctan2(det, low)
        out[n] = total / (2 * np.pi)
    return out
