"""Joints of a generated body bent step by step, and what skinning does to the surface around them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled
from muybridge.geometry.numerics.rotations import quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.skinning import Skin

_BLENDED = 0.1  # least weight on both sides of a joint of a vertex that both move


@dataclass(frozen=True, eq=False)
class Body:
    """A body at rest with its artist's weights.

    Attributes:
        skeleton: its joints, without limits.
        joints: (J, 3) metres.
        skin: the mesh.
    """

    skeleton: Skeleton
    joints: FloatArray
    skin: Skin


@dataclass(frozen=True)
class Bend:
    """What is bent: shares of the angle by joint, how far, and the bones on both sides of the joint.

    Attributes:
        shares: of the angle, by bone.
        axis: (3,) in the world at rest.
        rest_deg: of the joint at rest, as anatomy counts: zero for a straight or a hanging limb.
        angles_deg: steps, the first of them the rest.
        joint: the bone that begins at the joint.
        bones: joints whose segments are the middle of the limb.
    """

    shares: dict[str, float]
    axis: FloatArray
    rest_deg: float
    angles_deg: tuple[float, ...]
    joint: str
    bones: tuple[tuple[str, str], ...]


def generated_body(seed: int = 0) -> Body:
    """A body from the generator, of middle proportions for seed 0; needs the extra `train`."""
    import torch

    from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel

    model = BodyModel(seed)
    labels = list(model.model.phenotype_labels)
    phenotypes = np.full(len(labels), 0.5, np.float32)
    phenotypes[labels.index("age")] = 0.75
    if seed:
        phenotypes = model.sample_phenotypes(1)[0]
    skeleton = model.skeleton(phenotypes).joints
    rest = torch.eye(4).expand(1, len(model.bones), 4, 4)
    with torch.inference_mode():
        out = model.model(pose_parameters=rest, phenotype_kwargs=torch.from_numpy(phenotypes[None]))
    vertices = out["vertices"][0, :BODY_VERTICES].numpy().astype(np.float64)
    joints = out["bone_poses"][0, :, :3, 3].numpy().astype(np.float64)
    triangles = model.parts[0][(model.parts[0] < BODY_VERTICES).all(axis=1)].astype(np.int64)
    weights = model.model.vertex_bone_weights.numpy()[:BODY_VERTICES].astype(np.float64)
    bind = np.tile(np.eye(4), (len(joints), 1, 1))
    bind[:, :3, 3] = -joints
    bones = model.model.vertex_bone_indices.numpy()[:BODY_VERTICES].astype(np.int64)
    return Body(skeleton, joints, Skin(vertices, triangles, bones, weights / weights.sum(1, keepdims=True), bind))


def bends_of(body: Body) -> dict[str, Bend]:
    """Elbow, knee and shoulder from 0 to 150 degrees, and the forearm twisted to 180, all on the left."""
    at = {name: body.joints[i] for i, name in enumerate(body.skeleton.names)}
    arm = at["lowerarm01.L"] - at["upperarm01.L"]
    forearm = at["wrist.L"] - at["lowerarm01.L"]
    thigh, shin = at["lowerleg01.L"] - at["upperleg01.L"], at["foot.L"] - at["lowerleg01.L"]
    side, down = np.array([1.0, 0, 0]), np.array([0, 0, -1.0])
    raised = {"clavicle.L": 0.12, "shoulder01.L": 0.10, "upperarm01.L": 0.78}
    steps = tuple(float(a) for a in range(0, 151, 15))

    def from_rest(deg: float) -> tuple[float, tuple[float, ...]]:
        return deg, (deg, *steps)

    return {
        "elbow": Bend({"lowerarm01.L": 1.0}, np.cross(arm, forearm), *from_rest(_between(arm, forearm)), "lowerarm01.L",
                      (("upperarm01.L", "lowerarm01.L"), ("lowerarm01.L", "wrist.L"))),
        "knee": Bend({"lowerleg01.L": 1.0}, side, *from_rest(_between(thigh, shin)), "lowerleg01.L",
                     (("upperleg01.L", "lowerleg01.L"), ("lowerleg01.L", "foot.L"))),
        "shoulder": Bend(raised, np.array([0.0, -1.0, 0]), *from_rest(_between(down, arm * [1, 0, 1])), "upperarm01.L",
                         (("clavicle.L", "upperarm01.L"), ("upperarm01.L", "lowerarm01.L"))),
        "forearm twist": Bend({"lowerarm02.L": 1.0}, forearm, 0.0, tuple(float(a) for a in range(0, 181, 20)),
                              "lowerarm02.L", (("lowerarm01.L", "wrist.L"),)),
    }  # fmt: skip


def _between(a: FloatArray, b: FloatArray) -> float:
    """Degrees between two vectors."""
    return float(np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b))))


def bent_frames(body: Body, bend: Bend) -> FloatArray:
    """(T, J, 4, 4) world_from_joints of the steps of a bend."""
    skeleton, axis = body.skeleton, bend.axis / np.linalg.norm(bend.axis)
    turns = np.tile(np.eye(3), (len(bend.angles_deg), len(skeleton), 1, 1))
    for bone, share in bend.shares.items():
        turns[:, skeleton.index(bone)] = Rotation.from_rotvec(
            np.radians(share * (np.array(bend.angles_deg) - bend.rest_deg))[:, None] * axis
        ).as_matrix()
    root = np.tile(body.joints[0], (len(turns), 1))
    return Motion(skeleton, 30.0, root, quat_from_matrix(turns)).forward()


@dataclass(frozen=True, eq=False)
class Region:
    """The part of a body's surface around a joint, in one piece.

    Attributes:
        body: whole.
        bend: of the joint.
        triangles: (F, 3) vertices of the body.
    """

    body: Body
    bend: Bend
    triangles: IntArray

    @cached_property
    def vertices(self) -> IntArray:
        """Numbers of its vertices."""
        return np.unique(self.triangles)

    @cached_property
    def _border(self) -> tuple[IntArray, IntArray]:
        """(E, 2) directed edges of one triangle only, and (E,) the loop of each."""
        t = self.triangles
        sides = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
        count = len(self.body.skin.positions)
        key, back = sides[:, 0] * count + sides[:, 1], sides[:, 1] * count + sides[:, 0]
        edges = sides[~np.isin(key, back)]
        links = sparse.coo_matrix((np.ones(len(edges)), edges.T), shape=(count, count))
        return edges, connected_components(links, directed=False)[1][edges[:, 0]]

    @cached_property
    def volume_at_rest(self) -> float:
        """Cubic metres inside, the ends closed by fans from their middles."""
        at_rest = self.body.skin.positions
        p = at_rest - at_rest[self.vertices].mean(axis=0)
        total = _signed(p[self.triangles])
        edges, loop = self._border
        for k in np.unique(loop):
            own = edges[loop == k]
            middle = np.broadcast_to(p[own[:, 0]].mean(axis=0), (len(own), 3))
            total += _signed(np.stack([p[own[:, 1]], p[own[:, 0]], middle], axis=1))
        return total

    def volume(self, vertices: FloatArray) -> float:
        """Of the region over that at rest; vertices (V, 3).

        All else of the body is rigid, so that what the whole body loses, the region has lost.
        """
        triangles, at_rest = self.body.skin.triangles, self.body.skin.positions
        lost = _signed(at_rest[triangles]) - _signed(vertices.astype(np.float64)[triangles])
        return 1.0 - lost / self.volume_at_rest

    @cached_property
    def blended(self) -> IntArray:
        """Numbers of the vertices that follow both sides of the joint."""
        skeleton, skin = self.body.skeleton, self.body.skin
        below = np.nonzero(skeleton.is_ancestor[skeleton.index(self.bend.joint)])[0]
        share = (skin.weights * np.isin(skin.joints, below)).sum(axis=1)[self.vertices]
        return self.vertices[np.abs(share - 0.5) < 0.5 - _BLENDED]

    def radii(self, vertices: FloatArray, frame: FloatArray) -> FloatArray:
        """(N,) metres of its blended vertices from the bones; vertices (V, 3), frame (J, 4, 4)."""
        points, best = vertices[self.blended].astype(np.float64), np.full(len(self.blended), np.inf)
        index = self.body.skeleton.index
        for first, last in self.bend.bones:
            a, b = frame[index(first), :3, 3], frame[index(last), :3, 3]
            share = np.clip((points - a) @ (b - a) / np.sum((b - a) ** 2), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
        return best

    def crossings(self, vertices: FloatArray) -> int:
        """Pairs of its triangles that cross without sharing a vertex; vertices (V, 3)."""
        return int(_crossings(vertices.astype(np.float64)[self.triangles], self.triangles))


def region_of(body: Body, bend: Bend) -> Region:
    """The surface around a joint at rest, as far as the middles of the bones on both sides."""
    skin = body.skin
    at = {name: body.joints[i] for i, name in enumerate(body.skeleton.names)}
    radius = 0.5 * np.mean([np.linalg.norm(at[b] - at[a]) for a, b in bend.bones])
    away = np.linalg.norm(skin.positions - at[bend.joint], axis=1)
    chosen = skin.triangles[(away[skin.triangles] < radius).all(axis=1)]
    count = len(away)
    links = sparse.coo_matrix(
        (np.ones(2 * len(chosen)), (np.r_[chosen[:, 0], chosen[:, 1]], np.r_[chosen[:, 1], chosen[:, 2]])),
        shape=(count, count),
    )
    part = connected_components(links, directed=False)[1][chosen[:, 0]]
    return Region(body, bend, chosen[part == np.bincount(part).argmax()])


def _signed(corners: FloatArray) -> float:
    return float(np.sum(np.cross(corners[:, 0], corners[:, 1]) * corners[:, 2]) / 6)


@compiled
def _cuts(a, b, p, q, r):  # type: ignore[no-untyped-def]
    """Whether the segment from a to b goes through the triangle p, q, r."""
    d, e, f = b - a, q - p, r - p
    h = np.array([d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2], d[0] * f[1] - d[1] * f[0]])
    det = e[0] * h[0] + e[1] * h[1] + e[2] * h[2]
    if abs(det) < 1e-18:
        return False
    s = a - p
    u = (s[0] * h[0] + s[1] * h[1] + s[2] * h[2]) / det
    if u < 0 or u > 1:
        return False
    g = np.array([s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2], s[0] * e[1] - s[1] * e[0]])
    v = (d[0] * g[0] + d[1] * g[1] + d[2] * g[2]) / det
    t = (f[0] * g[0] + f[1] * g[1] + f[2] * g[2]) / det
    return v >= 0 and u + v <= 1 and 0 < t < 1


@compiled
def _crossings(corners, names):  # type: ignore[no-untyped-def]
    count, found = len(corners), 0
    low, high = np.empty((count, 3)), np.empty((count, 3))
    for i in range(count):
        for k in range(3):
            low[i, k] = min(corners[i, 0, k], corners[i, 1, k], corners[i, 2, k])
            high[i, k] = max(corners[i, 0, k], corners[i, 1, k], corners[i, 2, k])
    for i in range(count):
        for j in range(i + 1, count):
            if (low[i] > high[j]).any() or (low[j] > high[i]).any():
                continue
            shared = False
            for m in range(3):
                for n in range(3):
                    shared = shared or names[i, m] == names[j, n]
            if shared:
                continue
            for m in range(3):
                one, other = corners[i], corners[j]
                if _cuts(one[m], one[(m + 1) % 3], other[0], other[1], other[2]) or _cuts(
                    other[m], other[(m + 1) % 3], one[0], one[1], one[2]
                ):
                    found += 1
                    break
    return found
