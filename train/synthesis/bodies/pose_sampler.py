"""Procedural body poses: wide, plausible, within rough joint limits, seeded.

A pose is one rotation per bone in anny's `local-ref` convention: about axes parallel to the world's (x to the subject's
left, -y forward, z up) in the A-pose, for every bone. Thigh flexion is -x, knee flexion +x, lowering the left arm +y;
the right side mirrors y and z.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import BoolArray, FloatArray, IndexArray

# Shares of the kinds of pose. Everyday upright poses dominate; the others keep the network from learning that people
# are always upright.
KINDS: dict[str, float] = {
    "stand": 0.22, "walk": 0.20, "balance": 0.16, "reach": 0.10, "sit": 0.08, "crouch": 0.08,
    "kick": 0.06, "jump": 0.04, "crawl": 0.03, "lie": 0.03,
}  # fmt: skip

# Hands: share, and flexion in degrees of the three joints of a finger and of the thumb.
GRIPS: dict[str, tuple[float, float, float, float, float]] = {
    "flat": (0.16, 4, 6, 4, 0), "relaxed": (0.42, 26, 34, 18, 12), "grip": (0.16, 52, 68, 32, 28),
    "fist": (0.20, 74, 88, 40, 40), "point": (0.06, 74, 88, 40, 38),
}  # fmt: skip
# Axes of the left hand at rest: along the knuckles to the little finger, out of the back of the hand, along the thumb.
KNUCKLES, PALM = np.array([0.387, 0.82, -0.418]), np.array([0.736, -0.017, 0.647])
THUMB = np.array([0.87, -0.49, -0.15])

SPINE = ("spine05", "spine04", "spine03", "spine02", "spine01")
NECK = (("neck01", 0.3), ("neck02", 0.2), ("neck03", 0.2), ("head", 0.3))


@dataclass(frozen=True)
class Poses:
    """A batch of poses.

    Attributes:
        rotvec: (B, bones, 3) rotation vectors, radians, `local-ref`.
        kinds: (B,) index into `KINDS`.
    """

    rotvec: FloatArray
    kinds: IndexArray


def _rotvec_deg(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.radians(np.stack([x, y, z], -1))


def _compose(*rotvecs: FloatArray) -> FloatArray:
    out = Rotation.from_rotvec(rotvecs[0])
    for r in rotvecs[1:]:
        out = out * Rotation.from_rotvec(r)
    return np.asarray(out.as_rotvec())


def _shortest_rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Shortest rotation vectors from the directions `a` to `b`, both (B, 3)."""
    a = a / np.linalg.norm(a, axis=-1, keepdims=True)
    b = b / np.linalg.norm(b, axis=-1, keepdims=True)
    c = np.cross(a, b)
    s = np.linalg.norm(c, axis=-1, keepdims=True)
    return np.asarray(c / (s + 1e-9) * np.arctan2(s, (a * b).sum(-1, keepdims=True)))


class PoseSampler:
    """Draws poses for a skeleton given by its bone names."""

    def __init__(self, bone_names: Sequence[str], rng: np.random.Generator) -> None:
        self.index = {b: i for i, b in enumerate(bone_names)}
        self.rng = rng

    def sample(self, n: int, kinds: Sequence[str] | None = None) -> Poses:
        """`n` poses; `kinds` restricts the kinds (names of `KINDS`)."""
        names = list(KINDS)
        weights = np.array([KINDS[k] if kinds is None or k in kinds else 0.0 for k in names])
        kind = self.rng.choice(len(names), n, p=weights / weights.sum())
        is_kind = {k: kind == i for i, k in enumerate(names)}
        rotvec = np.zeros((n, len(self.index), 3))
        side_of_action = self.rng.choice([-1.0, 1.0], n)  # the leg that swings, kicks or is lifted
        self._trunk(rotvec, is_kind, side_of_action)
        self._legs(rotvec, is_kind, side_of_action)
        self._arms(rotvec, is_kind)
        self._root(rotvec, is_kind)
        return Poses(rotvec, kind)

    def _normal(self, n: int, sd: float, mean: float = 0.0) -> FloatArray:
        return self.rng.normal(mean, sd, n)

    def _uniform(self, n: int, lo: float, hi: float) -> FloatArray:
        return self.rng.uniform(lo, hi, n)

    def _trunk(self, rotvec: FloatArray, is_kind: dict[str, BoolArray], side: FloatArray) -> None:
        n = len(rotvec)
        lean = self._normal(n, 9, 4)
        lean = np.where(is_kind["crouch"] | is_kind["reach"], self._uniform(n, -5, 60), lean)
        lean = np.where(is_kind["crawl"], self._uniform(n, -10, 25), lean)
        lateral = self._normal(n, 7)
        tilt = is_kind["balance"] | is_kind["reach"] | is_kind["kick"]
        lateral = np.where(tilt, self._normal(n, 18), lateral)
        twist = self._normal(n, 15)
        for bone in SPINE:
            rotvec[:, self.index[bone]] = _rotvec_deg(lean / 5, lateral / 5, twist / 5)
        nod, bend, turn = self._normal(n, 16, 4), self._normal(n, 9), self._normal(n, 28).clip(-70, 70)
        nod = np.where(is_kind["crawl"], nod - 35, nod)
        for bone, share in NECK:
            rotvec[:, self.index[bone]] = _rotvec_deg(nod * share, bend * share, turn * share)

    def _leg_angles(
        self, is_kind: dict[str, BoolArray], side: FloatArray, sign: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Hip flexion, knee flexion and hip abduction, degrees, of the leg on side `sign` (+1 left)."""
        n = len(side)
        k, u, g = is_kind, self._uniform, self._normal
        acting = side * sign > 0
        swing = side * sign * u(n, 0, 1)
        conditions = [k["stand"] | k["reach"], k["walk"], k["balance"], k["sit"], k["crouch"], k["kick"],
                      k["jump"], k["crawl"], k["lie"]]  # fmt: skip
        lifted_flexion = np.where(self.rng.random(n) < 0.5, u(n, -45, 20), u(n, 0, 110))
        flexion = np.select(conditions, [
            g(n, 6), swing * u(n, 10, 55) + 5, np.where(acting, lifted_flexion, g(n, 10, 8)), u(n, 65, 105),
            u(n, 15, 110), np.where(acting, u(n, -35, 100), g(n, 10, 8)), u(n, -20, 70), u(n, 60, 105),
            np.where(self.rng.random(n) < 0.5, g(n, 8), u(n, 0, 90)),
        ])  # fmt: skip
        bent = np.clip(flexion, 0, None) * u(n, 0, 1.4)
        knee = np.select(conditions, [
            np.abs(g(n, 7)), np.abs(g(n, 12)) + np.clip(-swing, 0, 1) * u(n, 10, 90),
            np.where(acting, bent + np.clip(-flexion, 0, 45) * u(n, 0, 2.2) + u(n, 0, 30), np.abs(g(n, 12))),
            u(n, 50, 115), flexion * u(n, 0.8, 1.4), np.where(acting, u(n, 0, 90), np.abs(g(n, 12))),
            flexion * u(n, 0.2, 1.6) + u(n, 0, 40), u(n, 60, 110), flexion * u(n, 0.3, 1.5) + np.abs(g(n, 8)),
        ]).clip(0, 145)  # fmt: skip
        wide = k["crouch"] | k["jump"] | k["lie"]
        # In the A-pose the legs are already about 8 degrees apart.
        abduction = g(n, 6, -4) + np.where(wide, u(n, 0, 25), 0)
        abduction = np.where((k["balance"] | k["kick"]) & acting, u(n, -12, 65), abduction)
        return flexion, knee, abduction

    def _legs(self, rotvec: FloatArray, is_kind: dict[str, BoolArray], side: FloatArray) -> None:
        n = len(rotvec)
        zero = np.zeros(n)
        for suffix, sign in (("L", 1.0), ("R", -1.0)):
            flexion, knee, abduction = self._leg_angles(is_kind, side, sign)
            thigh = _compose(
                _rotvec_deg(zero, -sign * abduction, zero),
                _rotvec_deg(-flexion, zero, zero),
                _rotvec_deg(zero, zero, sign * self._normal(n, 13, 4)),
            )
            rotvec[:, self.index["upperleg01." + suffix]] = thigh
            rotvec[:, self.index["lowerleg01." + suffix]] = _rotvec_deg(knee, zero, zero)
            point = np.where(self.rng.random(n) < 0.3, self._uniform(n, 0, 45), self._normal(n, 12, -2))
            rotvec[:, self.index["foot." + suffix]] = _rotvec_deg(point, zero, self._normal(n, 7))

    def _arms(self, rotvec: FloatArray, is_kind: dict[str, BoolArray]) -> None:
        n = len(rotvec)
        g, u = self._normal, self._uniform
        free = is_kind["balance"] | is_kind["reach"] | is_kind["kick"] | is_kind["jump"]
        for suffix, sign in (("L", 1.0), ("R", -1.0)):
            # Direction of the upper arm relative to the trunk; azimuth 0 is sideways, 90 forward.
            azimuth = np.radians(np.where(self.rng.random(n) < 0.7, u(n, -30, 100), u(n, -45, 130)))
            low = self.rng.random(n) < np.where(free, 0.2, 0.6)
            elevation = np.radians(np.where(low, u(n, -88, -50), u(n, -60, 85)))
            forward = is_kind["crawl"]
            azimuth = np.where(forward, np.radians(u(n, 70, 100)), azimuth)
            elevation = np.where(forward, np.radians(u(n, -25, 30)), elevation)
            direction = np.stack(
                [sign * np.cos(elevation) * np.cos(azimuth), -np.cos(elevation) * np.sin(azimuth),
                 np.sin(elevation)], -1
            )  # fmt: skip
            rest = np.array([sign * 0.17, -0.02, -0.20])
            raise_arm = _shortest_rotation(np.broadcast_to(rest, direction.shape), direction)
            rotvec[:, self.index["clavicle." + suffix]] = raise_arm * 0.12
            rotvec[:, self.index["shoulder01." + suffix]] = raise_arm * 0.10
            twist = np.radians(g(n, 30))[:, None] * rest / np.linalg.norm(rest)
            rotvec[:, self.index["upperarm01." + suffix]] = _compose(raise_arm * 0.78, twist)
            forearm = np.array([sign * 0.12, -0.15, -0.13])
            hinge = np.cross(rest, forearm)
            hinge /= np.linalg.norm(hinge)
            straight = self.rng.random(n) < 0.3
            elbow = np.where(straight, u(n, -25, 15), self.rng.beta(1.1, 1.8, n) * 150 - 25)
            elbow = np.where(forward, u(n, -25, 20), elbow)
            rotvec[:, self.index["lowerarm01." + suffix]] = np.radians(elbow)[:, None] * hinge
            axis = sign * forearm / np.linalg.norm(forearm)
            rotvec[:, self.index["lowerarm02." + suffix]] = np.radians(u(n, -60, 50))[:, None] * axis
            rotvec[:, self.index["wrist." + suffix]] = _rotvec_deg(g(n, 16), g(n, 14), g(n, 14))
            self._hand(rotvec, suffix, sign)

    def _hand(self, rotvec: FloatArray, suffix: str, sign: float) -> None:
        """Hands: flat, relaxed, gripping, fists, pointing; fingers bend about the line of the knuckles."""
        n, u = len(rotvec), self._uniform
        kind = self.rng.choice(len(GRIPS), n, p=[share for share, *_ in GRIPS.values()])
        table = np.array([bends for _, *bends in GRIPS.values()])  # (kinds, 3 joints + thumb), degrees
        bends = table[kind] * u(n, 0.75, 1.1)[:, None] + self._normal(n, 4)[:, None]
        fan = u(n, -0.25, 0.35)  # relative flexion of the little and the index finger
        spread = u(n, -1, 3.5)
        mirror = np.array([1.0, sign, sign])
        for finger in range(2, 6):
            straight = (kind == list(GRIPS).index("point")) & (finger == 2)
            more = np.where(straight, 0.08, 1 + fan * (finger - 3.5) / 1.5) * u(n, 0.85, 1.15)
            for joint in range(3):
                angle = np.radians((bends[:, joint] * more).clip(-12, 100))
                bend = angle[:, None] * KNUCKLES * mirror
                if joint == 0:
                    bend = bend + np.radians(spread * (finger - 3.5))[:, None] * PALM * mirror
                rotvec[:, self.index[f"finger{finger}-{joint + 1}.{suffix}"]] = bend
        for joint, share in ((1, 0.5), (2, 0.8), (3, 1.0)):
            angle = np.radians((bends[:, 3] * share * u(n, 0.6, 1.2)).clip(-10, 70))
            rotvec[:, self.index[f"finger1-{joint}.{suffix}"]] = angle[:, None] * THUMB * mirror

    def _root(self, rotvec: FloatArray, is_kind: dict[str, BoolArray]) -> None:
        """Whole-body tilt: small for all, to the ground for crawling and lying, sideways for balances."""
        n = len(rotvec)
        g, u = self._normal, self._uniform
        pitch, roll = g(n, 4), g(n, 4)
        tilt = is_kind["balance"] | is_kind["kick"]
        pitch = np.where(tilt, g(n, 20, 8), pitch)
        roll = np.where(tilt, g(n, 16), roll)
        pitch = np.where(is_kind["jump"], g(n, 14), pitch)
        pitch = np.where(is_kind["crawl"], u(n, 60, 95), pitch)
        lying = np.where(self.rng.random(n) < 0.5, -1.0, 1.0) * u(n, 75, 100)
        pitch = np.where(is_kind["lie"], lying, pitch)
        roll = np.where(is_kind["lie"], g(n, 25), roll)
        zero = np.zeros(n)
        rotvec[:, self.index["root"]] = _compose(_rotvec_deg(zero, roll, zero), _rotvec_deg(pitch, zero, zero))
