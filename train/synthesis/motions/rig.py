"""The skeleton that motion is made on: forward kinematics, limb inverse kinematics, centre of mass, floor.

Rotations are anny's `local-ref` (see `muybridge.train.synthesis.bodies.pose_sampler`): a bone's global rotation is its parent's times its
own, and its origin is its parent's plus the parent's rotation of the offset at rest.
"""

import functools
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray

SIDES = (("L", 1.0), ("R", -1.0))
SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
NECK = (("neck01", 0.3), ("neck02", 0.2), ("neck03", 0.2), ("head", 0.3))

# Joint limits in degrees, of the angles that `joint_angles` measures.
LIMITS: dict[str, tuple[float, float]] = {
    "hip_flexion": (-45.0, 140.0), "hip_abduction": (-50.0, 75.0), "hip_rotation": (-70.0, 70.0),
    "knee": (-7.0, 158.0), "ankle": (-48.0, 62.0), "elbow": (0.0, 158.0), "trunk": (-45.0, 85.0),
}  # fmt: skip

# Segments of the body, their share of its mass and where along them their centre lies (de Leva 1996).
SEGMENTS: tuple[tuple[str, str, float, float], ...] = (
    ("root", "neck01", 0.4346, 0.45), ("neck01", "head", 0.0694, 1.4),
    *((a + s, b + s, m, c) for s in "LR" for a, b, m, c in (
        ("upperleg01.", "lowerleg01.", 0.1416, 0.41), ("lowerleg01.", "foot.", 0.0433, 0.44),
        ("foot.", "toe2-1.", 0.0137, 0.44), ("upperarm01.", "lowerarm01.", 0.0271, 0.58),
        ("lowerarm01.", "wrist.", 0.0162, 0.46), ("wrist.", "finger3-1.", 0.0061, 0.8))),
)  # fmt: skip


@dataclass(frozen=True)
class Skeleton:
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


def forward(skeleton: Skeleton, local: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Global rotations (T, bones, 3, 3) and origins (T, bones, 3) from local rotations and root positions."""
    out, at = np.empty_like(local), np.empty(local.shape[:2] + (3,))
    out[:, 0], at[:, 0] = local[:, 0], root
    for i, p in enumerate(skeleton.parents[1:].tolist(), 1):
        np.matmul(out[:, p], local[:, i], out=out[:, i])
        at[:, i] = at[:, p] + out[:, p] @ (skeleton.rest[i] - skeleton.rest[p])
    return out, at


def skin(skeleton: Skeleton, rotations: FloatArray, origins: FloatArray,
         chosen: slice | BoolArray = slice(None)) -> FloatArray:  # fmt: skip
    """(T, P, 3) surface points, linear blend skinning."""
    out = np.zeros((len(rotations), len(skeleton.surface[chosen]), 3))
    for k in range(skeleton.skin.shape[1]):
        bone = skeleton.skin[chosen, k]
        offset = skeleton.surface[chosen] - skeleton.rest[bone]
        out += skeleton.weights[chosen, k, None] * (apply(rotations[:, bone], offset) + origins[:, bone])
    return out


def centre_of_mass(skeleton: Skeleton, origins: FloatArray) -> FloatArray:
    """(T, 3) centre of mass."""
    out, total = np.zeros((len(origins), 3)), 0.0
    for a, b, mass, share in SEGMENTS:
        i, j = skeleton.index(a), skeleton.index(b)
        out += mass * (origins[:, i] * (1 - share) + origins[:, j] * share)
        total += mass
    return out / total


def two_bone(upper: FloatArray, lower: FloatArray, hinge: FloatArray, reach: FloatArray, pole: FloatArray,
             limits: tuple[float, float]) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Analytic inverse kinematics of a limb.

    Args:
        upper, lower: (3,) the two segments at rest; hinge: (3,) unit axis of the middle joint at rest.
        reach: (T, 3) where the end shall be, from the limb's root, in the frame that rest is given in.
        pole: (T, 3) where the hinge axis shall point as nearly as it can.
        limits: smallest and largest angle of the hinge, degrees.

    Returns:
        Rotations (T, 3, 3) of the upper segment and angles (T,) of the hinge, degrees.
    """
    parallel = hinge * (hinge @ lower)
    cosine, sine = upper @ (lower - parallel), upper @ np.cross(hinge, lower)
    size, phase = np.hypot(cosine, sine), np.arctan2(sine, cosine)
    want = ((reach**2).sum(-1) - upper @ upper - lower @ lower) / 2 - upper @ parallel
    angle = np.degrees(phase + np.arccos(np.clip(want / size, -1, 1)))
    angle = np.clip(angle, *limits)
    end = upper + apply(turn(np.radians(angle)[:, None] * hinge), np.broadcast_to(lower, reach.shape))
    return _frame(reach, pole) @ np.swapaxes(_frame(end, np.broadcast_to(hinge, reach.shape)), -1, -2), angle


def _frame(first: FloatArray, second: FloatArray) -> FloatArray:
    x = unit(first)
    y = unit(second - (second * x).sum(-1, keepdims=True) * x)
    return np.stack([x, y, np.cross(x, y)], -1)


def joint_angles(skeleton: Skeleton, local: FloatArray) -> dict[str, FloatArray]:
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


def arm_rest(skeleton: Skeleton, side: str) -> tuple[FloatArray, FloatArray, float]:
    """The elbow's axis, the upper arm's direction and the elbow's flexion in degrees, all at rest."""
    upper = skeleton.at("lowerarm01." + side) - skeleton.at("upperarm01." + side)
    lower = skeleton.at("wrist." + side) - skeleton.at("lowerarm01." + side)
    hinge = np.cross(upper, lower)
    size = np.linalg.norm(hinge)
    return hinge / size, unit(upper), float(np.degrees(np.arctan2(size, upper @ lower)))
