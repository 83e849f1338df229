"""The body that motion is generated for: its bones and skin, its joint angles, and rotations.

Rotations are anny's `local-ref` (see `muybridge.train.synthesis.bodies.pose_sampler`): a bone's global rotation is its
parent's times its own, and its origin is its parent's plus the parent's rotation of the offset at rest.
"""

import functools
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.skeleton.skeleton import Skeleton

SIDES = (("L", 1.0), ("R", -1.0))
SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
NECK = (("neck01", 0.3), ("neck02", 0.2), ("neck03", 0.2), ("head", 0.3))

# Joint limits in degrees, of the angles that `joint_angles` measures.
LIMITS: dict[str, tuple[float, float]] = {
    "hip_flexion": (-45.0, 140.0), "hip_abduction": (-50.0, 75.0), "hip_rotation": (-70.0, 70.0),
    "knee": (-7.0, 158.0), "ankle": (-48.0, 62.0), "elbow": (0.0, 158.0), "trunk": (-45.0, 85.0),
}  # fmt: skip

# anny's bones by the roles that `muybridge.geometry.skeleton.mass` names.
_BONE_OF_PART = {
    "thigh": "upperleg01", "shin": "lowerleg01", "foot": "foot", "toe": "toe2-1", "upper_arm": "upperarm01",
    "forearm": "lowerarm01", "hand": "wrist", "middle_1": "finger3-1",
}  # fmt: skip
BONE_OF_ROLE = {"hips": "root", "neck": "neck01", "head": "head"} | {
    f"{side}_{part}": f"{bone}.{letter}"
    for side, letter in (("left", "L"), ("right", "R"))
    for part, bone in _BONE_OF_PART.items()
}


@dataclass(frozen=True)
class SkinnedBody:
    """One body at rest.

    Attributes:
        bones: names, parents before children.
        parents: (bones,) index of the parent, -1 for the root.
        rest: (bones, 3) metres, joint origins in the A-pose, soles on z = 0.
        surface: (P, 3) metres, points of the skin at rest.
        skin: (P, K) indices of the bones that move a point; `weights`: (P, K), rows sum to 1.
    """

    bones: tuple[str, ...]
    parents: IndexArray
    rest: FloatArray
    surface: FloatArray
    skin: IndexArray
    weights: FloatArray

    def index(self, bone: str) -> int:
        """Position of a bone."""
        return self.bones.index(bone)

    def at(self, bone: str) -> FloatArray:
        """(3,) origin of a bone at rest."""
        return np.asarray(self.rest[self.bones.index(bone)])

    @functools.cached_property
    def strongest(self) -> IndexArray:
        """(P,) index of the bone that moves a point of the skin the most."""
        return np.asarray(np.take_along_axis(self.skin, self.weights.argmax(1)[:, None], 1)[:, 0])

    @functools.cached_property
    def joints(self) -> Skeleton:
        """The bones as joints, without limits."""
        parents = tuple(int(p) for p in self.parents)
        offsets = np.stack([self.rest[i] - self.rest[p] if i else np.zeros(3) for i, p in enumerate(parents)])
        free = np.full(offsets.shape, np.inf)
        return Skeleton(self.bones, parents, offsets, np.full_like(offsets, np.nan), (2,) * len(parents), -free, free)

    @functools.cached_property
    def roles(self) -> dict[str, int]:
        """Index of the bone of each role that the centre of mass needs."""
        return {role: self.bones.index(bone) for role, bone in BONE_OF_ROLE.items() if bone in self.bones}

    @property
    def height(self) -> float:
        """Standing height, metres."""
        return float(np.ptp(self.surface[:, 2]))

    @property
    def leg(self) -> float:
        """Height of the hip joints over the soles, metres."""
        return float(self.at("upperleg01.L")[2])


def rot(axis: int, degrees: FloatArray | float) -> FloatArray:
    """(..., 3, 3) rotations about one axis."""
    a = np.radians(np.asarray(degrees, np.float64))
    c, s = np.cos(a), np.sin(a)
    out = np.zeros((*a.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = 1.0
    out[..., i, i] = out[..., j, j] = c
    out[..., i, j], out[..., j, i] = -s, s
    return out


def turn(vectors: FloatArray) -> FloatArray:
    """(..., 3, 3) rotations from rotation vectors in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    k = np.zeros((*vectors.shape[:-1], 3, 3))
    k[..., 0, 1], k[..., 0, 2], k[..., 1, 2] = -vectors[..., 2], vectors[..., 1], -vectors[..., 0]
    k -= np.swapaxes(k, -1, -2)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * (k @ k))


def log(r: FloatArray) -> FloatArray:
    """Rotation vectors of rotations, (..., 3, 3) to (..., 3)."""
    axis = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], -1) / 2
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (np.trace(r, axis1=-2, axis2=-1)[..., None] - 1) / 2)
    return np.asarray(axis * angle / (sine + 1e-9))


def unit(v: FloatArray) -> FloatArray:
    """Vectors of length one."""
    return np.asarray(v / (np.linalg.norm(v, axis=-1, keepdims=True) + 1e-12))


def between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Shortest rotation vectors that turn the directions `a` into `b`, (..., 3)."""
    a, b = unit(a), unit(b)
    c = np.cross(a, b)
    s = np.linalg.norm(c, axis=-1, keepdims=True)
    return np.asarray(c / (s + 1e-9) * np.arctan2(s, (a * b).sum(-1, keepdims=True)))


def apply(r: FloatArray, v: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) of vectors (..., 3)."""
    return np.asarray((r @ v[..., None])[..., 0])


def forward(body: SkinnedBody, local: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Global rotations (T, bones, 3, 3) and origins (T, bones, 3) from local rotations and root positions."""
    return body.joints.forward(root, local)


def skin(skeleton: SkinnedBody, rotations: FloatArray, origins: FloatArray,
         chosen: slice | BoolArray = slice(None)) -> FloatArray:  # fmt: skip
    """(T, P, 3) surface points, linear blend skinning."""
    out = np.zeros((len(rotations), len(skeleton.surface[chosen]), 3))
    for k in range(skeleton.skin.shape[1]):
        bone = skeleton.skin[chosen, k]
        offset = skeleton.surface[chosen] - skeleton.rest[bone]
        out += skeleton.weights[chosen, k, None] * (apply(rotations[:, bone], offset) + origins[:, bone])
    return out


def joint_angles(skeleton: SkinnedBody, local: FloatArray) -> dict[str, FloatArray]:
    """Anatomical angles in degrees, each (T, 2) left and right (the trunk's flexion: (T, 1))."""
    out: dict[str, list[FloatArray]] = {k: [] for k in LIMITS}
    for side, sign in SIDES:
        thigh = local[:, skeleton.index("upperleg01." + side)]
        # thigh = Ry(-sign abduction) Rx(-flexion) Rz(sign rotation)
        down = -thigh[:, :, 2]
        flexion = np.degrees(np.arctan2(-down[:, 1], np.hypot(down[:, 2], down[:, 0]) * np.sign(-down[:, 2])))
        out["hip_flexion"].append(flexion)
        out["hip_abduction"].append(np.degrees(np.arcsin(np.clip(sign * down[:, 0], -1, 1))))
        past = np.sign(-down[:, 2])  # a hip flexed past the horizontal
        rotation = np.degrees(np.arctan2(thigh[:, 1, 0] * past, thigh[:, 1, 1] * past)) * sign
        out["hip_rotation"].append(np.where(np.hypot(thigh[:, 1, 0], thigh[:, 1, 1]) > 0.35, rotation, 0.0))
        knee, foot = local[:, skeleton.index("lowerleg01." + side)], local[:, skeleton.index("foot." + side)]
        out["knee"].append(np.degrees(np.arctan2(knee[:, 2, 1], knee[:, 1, 1])))
        out["ankle"].append(np.degrees(np.arctan2(foot[:, 2, 1], foot[:, 1, 1])))
        elbow = local[:, skeleton.index("lowerarm01." + side)]
        hinge, _, bent = arm_rest(skeleton, side)
        axis = np.stack([elbow[:, 2, 1] - elbow[:, 1, 2], elbow[:, 0, 2] - elbow[:, 2, 0],
                         elbow[:, 1, 0] - elbow[:, 0, 1]], -1) / 2  # fmt: skip
        trace = (np.trace(elbow, axis1=1, axis2=2) - 1) / 2
        out["elbow"].append(np.degrees(np.arctan2(axis @ hinge, trace)) + bent)
    spine = local[:, skeleton.index(SPINE[0])]
    for bone in SPINE[1:]:
        spine = spine @ local[:, skeleton.index(bone)]
    out["trunk"].append(np.degrees(np.arctan2(spine[:, 2, 1], spine[:, 2, 2])))
    return {k: np.stack(v, -1) for k, v in out.items()}


def arm_rest(skeleton: SkinnedBody, side: str) -> tuple[FloatArray, FloatArray, float]:
    """The elbow's axis, the upper arm's direction and the elbow's flexion in degrees, all at rest."""
    upper = skeleton.at("lowerarm01." + side) - skeleton.at("upperarm01." + side)
    lower = skeleton.at("wrist." + side) - skeleton.at("lowerarm01." + side)
    hinge = np.cross(upper, lower)
    size = np.linalg.norm(hinge)
    return hinge / size, unit(upper), float(np.degrees(np.arctan2(size, upper @ lower)))
