"""A person being posed by places: trunk by angles, feet and hands by what they stand on and hold.

Someone at yaw 0 faces -y and has x to the left, as in `train.synthesis.motions`. Metres and degrees.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.ik.two_bone import solve_two_bone
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.bodies.pose_sampler import GRIPS, KNUCKLES, PALM, THUMB
from muybridge.train.synthesis.motions.rig import (
    NECK,
    SIDES,
    SPINE,
    arm_rest,
    between,
    forward,
    log,
    rot,
    skin,
    turn,
    unit,
)
from muybridge.train.synthesis.things.built import Spot
from muybridge.train.synthesis.things.scene import Posed

HIPS = ("root", "pelvis", "upperleg")
_DORSIFLEXION = 32.0  # most, degrees
_BEND_OF_TOES = 55.0
_TWIST, _WRIST = 85.0, 60.0  # most that forearm and wrist turn to fit a handle
SIGN = dict(SIDES)
_HINGE = np.array([1.0, 0.0, 0.0])  # of a knee


class Figure:
    """A person of a scene while being posed.

    Args:
        body: the body model; its generator draws the shape.
        rng: source of random numbers.
        age: range of anny's age, 0 newborn to 1 old; by default as `BodyModel.sample_phenotypes` draws.

    Attributes:
        k: height relative to 1.7 m.
        local: (bones, 3, 3) rotations relative to the bone above.
        root: (3,) where the root is, world.
    """

    def __init__(self, body: BodyModel, rng: np.random.Generator, age: tuple[float, float] | None = None) -> None:
        self.body, self.rng = body, rng
        self.phenotypes, self.skeleton = body.sample_person(rng, age)
        self.index = {b: i for i, b in enumerate(self.skeleton.bones)}
        self.k = self.skeleton.height / 1.7
        self.local = np.tile(np.eye(3), (len(self.skeleton.bones), 1, 1))
        self.root = self.skeleton.rest[0].copy()
        toes = [b for b in self.skeleton.bones if b.startswith("toe") and b.endswith("-1.L")]
        self._toes = {s: [self.index[b[:-1] + s] for b in toes] for s, _ in SIDES}
        ball, ankle = np.mean([self.skeleton.at(b) for b in toes], 0), self.skeleton.at("foot.L")
        # From the ankle to places of the left sole.
        self.sole = {
            "ball": np.array([ball[0] - ankle[0], ball[1] - ankle[1], -ankle[2]]),
            "heel": np.array([0.0, 0.25 * (ankle[2] + 0.08), -ankle[2]]),
        }
        self.sole["middle"] = 0.6 * self.sole["ball"] + 0.4 * self.sole["heel"]
        self.thigh = float(np.linalg.norm(self.skeleton.at("upperleg01.L") - self.skeleton.at("lowerleg01.L")))
        self.shank = float(np.linalg.norm(self.skeleton.at("lowerleg01.L") - ankle))
        self.upper_arm = float(np.linalg.norm(self.skeleton.at("upperarm01.L") - self.skeleton.at("lowerarm01.L")))
        self.forearm = float(np.linalg.norm(self.skeleton.at("lowerarm01.L") - self.skeleton.at("wrist.L")))
        # Height over the floor of the hollow of the knee.
        self.seat = float(self.skeleton.at("lowerleg01.L")[2]) - 0.055 * self.k
        self.yaw = self.pitch = self.bent = 0.0
        self._grips: dict[str, str] = {}
        self._skin: FloatArray | None = None

    def u(self, low: float, high: float) -> float:
        """A random number, uniform."""
        return float(self.rng.uniform(low, high))

    def trunk(
        self,
        yaw: float = 0.0,
        pitch: float = 0.0,
        roll: float = 0.0,
        lean: float = 0.0,
        lateral: float = 0.0,
        twist: float = 0.0,
        vary: float = 1.0,
    ) -> "Figure":
        """Turn the pelvis (yaw, pitch forward, roll), bend the spine and look somewhere, with random deviations of size
        `vary`."""
        rng = self.rng
        self.yaw, self.pitch = yaw, pitch
        self.local[0] = rot(2, yaw) @ rot(1, roll) @ rot(0, pitch)
        bend = np.array([lean, lateral, twist]) + rng.normal(0, 1, 3) * [4, 4, 5] * vary
        for bone in SPINE:
            self.local[self.index[bone]] = turn(np.radians(bend) / len(SPINE))
        self.bent = pitch + float(bend[0])
        # The head comes up again from a bent trunk.
        self.head(-0.45 * self.bent + rng.normal(6, 11) * vary, rng.normal(0, 6) * vary, rng.normal(0, 20) * vary)
        return self

    def head(self, nod: float, tilt: float = 0.0, look: float = 0.0) -> None:
        """Turn the head relative to the trunk."""
        angles = np.radians([np.clip(nod, -50, 50), np.clip(tilt, -30, 30), np.clip(look, -65, 65)])
        for bone, share in NECK:
            self.local[self.index[bone]] = turn(angles * share)
        self._skin = None

    def leg(
        self, side: str, hip: float, knee: float, out: float = 0.0, inward: float = 0.0, ankle: float = 5.0
    ) -> None:
        """A free leg: flexion of the hip, of the knee, how far out it is and is turned in, flexion of the foot."""
        sign, i = SIGN[side], self.index
        thigh = rot(1, -sign * out) @ rot(0, -hip) @ rot(2, sign * -inward)
        self.local[i["upperleg01." + side]] = thigh
        self.local[i["lowerleg01." + side]] = rot(0, knee)
        self.local[i["foot." + side]] = rot(0, ankle)
        self._skin = None

    def arm(self, side: str, flex: float, out: float, elbow: float, spin: float = 0.0) -> None:
        """A free arm: raised forward and out, elbow bent, upper arm turned about its length."""
        sign, i = SIGN[side], self.index
        hinge, rest, bent = arm_rest(self.skeleton, side)
        a, b = np.radians(flex), np.radians(out)
        aim = np.array([sign * np.sin(b), -np.sin(a) * np.cos(b), -np.cos(a) * np.cos(b)])
        raised = between(rest, aim)
        self._shoulder(side, raised)
        self.local[i["upperarm01." + side]] = turn(raised * 0.78) @ turn(np.radians(-sign * spin) * rest)
        self.local[i["lowerarm01." + side]] = turn(np.radians(elbow - bent) * hinge)
        lower = unit(self.skeleton.at("wrist." + side) - self.skeleton.at("lowerarm01." + side)) * sign
        self.local[i["lowerarm02." + side]] = turn(np.radians(self.u(-45, 45)) * lower)
        self.local[i["wrist." + side]] = turn(np.radians(self.rng.normal(0, 10, 3)))
        self._skin = None

    def _shoulder(self, side: str, raised: FloatArray) -> None:
        self.local[self.index["clavicle." + side]] = turn(raised * 0.12)
        self.local[self.index["shoulder01." + side]] = turn(raised * 0.10)

    def frame(self, bone: str) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and origin (3,) of a bone in the world."""
        chain = [self.index[bone]]
        while (above := int(self.skeleton.parents[chain[0]])) >= 0:
            chain.insert(0, above)
        rotation, origin = self.local[0], self.root
        for last, i in zip(chain[:-1], chain[1:], strict=True):
            origin = origin + rotation @ (self.skeleton.rest[i] - self.skeleton.rest[last])
            rotation = rotation @ self.local[i]
        return rotation, origin

    def at(self, bone: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> FloatArray:
        """(3,) world: the point that at rest is `offset` from the origin of `bone`, for a person of 1.7 m."""
        rotation, origin = self.frame(bone)
        return np.asarray(origin + rotation @ (np.array(offset) * self.k))

    def move(self, by: ArrayLike) -> None:
        """Move the person by (3,)."""
        self.root = self.root + np.asarray(by, float)
        self._skin = None

    def foot(
        self, side: str, at: ArrayLike, yaw: float, pitch: float = 0.0, knee_out: float = 8.0, part: str = "ball"
    ) -> float:
        """Put a part of the sole (`ball`, `heel`, `middle`) on a place.

        Args:
            side: L or R.
            at: (3,) the place.
            yaw: where the toes point.
            pitch: how far the heel is up; more where the ankle would bend too far.
            knee_out: how far the knee points out from the toes' direction.
            part: of the sole.

        Returns:
            By how much the place is out of reach, metres.
        """
        sign, i, k = SIGN[side], self.index, self.skeleton
        hip, knee, ankle = (k.at(b + side) for b in ("upperleg01.", "lowerleg01.", "foot."))
        above, origin = self.frame("pelvis." + side)
        origin = origin + above @ (hip - k.at("pelvis." + side))
        sole = self.sole[part] * [sign, 1, 1]
        pole = above.T @ rot(2, yaw + sign * knee_out)[:, 0]
        short = 0.0
        for _ in range(4):
            foot = rot(2, yaw) @ rot(0, pitch)
            reach = above.T @ (np.asarray(at, float) - foot @ sole - origin)
            short = float(np.linalg.norm(reach)) - self.thigh - self.shank
            thigh, bend = solve_two_bone(knee - hip, ankle - knee, _HINGE, reach[None], pole[None], (-2.0, 152.0))
            shank = above @ thigh[0] @ rot(0, float(bend[0]))
            turned = shank.T @ foot
            excess = -np.degrees(np.arctan2(turned[2, 1], turned[1, 1])) - _DORSIFLEXION
            if excess < 1:
                break
            pitch += excess
        self.local[i["upperleg01." + side]] = thigh[0]
        self.local[i["lowerleg01." + side]] = rot(0, float(bend[0]))
        self.local[i["foot." + side]] = turned
        for toe in self._toes[side]:
            self.local[toe] = rot(0, -np.clip(pitch, 0, _BEND_OF_TOES)) if part == "ball" else np.eye(3)
        self._skin = None
        return max(short, 0.0)

    def reach(self, side: str, place: ArrayLike) -> float:
        """Distance from the shoulder to a place, as a share of the length of arm and palm."""
        rotation, origin = self.frame(SPINE[-1])
        shoulder = origin + rotation @ (self.skeleton.at("upperarm01." + side) - self.skeleton.at(SPINE[-1]))
        length = self.upper_arm + self.forearm + 0.06 * self.k
        return float(np.linalg.norm(np.asarray(place, float) - shoulder)) / length

    def hand(
        self,
        side: str,
        at: ArrayLike,
        axis: ArrayLike | None = None,
        back: ArrayLike | None = None,
        elbow: ArrayLike | None = None,
        grip: str = "grip",
        palm: float = 1.0,
    ) -> float:
        """Bring the palm to a place.

        Args:
            side: L or R.
            at: (3,) middle of the handle, or the point that the palm touches.
            axis: (3,) the handle's direction; the hand turns so that fingers close about it.
            back: (3,) where the back of the hand shall point.
            elbow: (3,) where the elbow points, in the axes of the upright trunk.
            grip: one of `GRIPS`, or "" for any.
            palm: 0 to bring the wrist there instead.

        Returns:
            Distance that is left, metres.
        """
        place, sign, i, k = np.asarray(at, float), SIGN[side], self.index, self.skeleton
        chest, origin = self.frame(SPINE[-1])
        shoulder, joint, wrist = (k.at(b + side) for b in ("upperarm01.", "lowerarm01.", "wrist."))
        hinge, rest, bent = arm_rest(k, side)
        self._shoulder(side, between(rest, chest.T @ (place - origin) - (shoulder - k.at(SPINE[-1]))))
        above, origin = self.frame("shoulder01." + side)
        origin = origin + above @ (shoulder - k.at("shoulder01." + side))
        out = np.array([sign * 0.6, 0.4, -0.7]) if elbow is None else np.asarray(elbow, float)
        out = above.T @ rot(2, self.yaw) @ out
        way = unit(wrist - joint)
        knuckles, outward = unit(KNUCKLES * [sign, 1, 1]), unit(PALM * [sign, 1, 1])
        finger = unit(k.at("finger3-1." + side) - wrist)
        to_palm = palm * self.k * (0.078 * finger - (0.03 if grip in ("grip", "fist") else 0.018) * outward)
        hand: FloatArray | None = None
        for _ in range(4):
            goal = above.T @ (place - (0 if hand is None else hand @ to_palm) - origin)
            pole = unit(np.cross(out, goal))
            arm, bend = solve_two_bone(joint - shoulder, wrist - joint, hinge, goal[None], pole[None],
                                       (4 - bent, 150 - bent))  # fmt: skip
            fore = above @ arm[0] @ turn(np.radians(float(bend[0])) * hinge)
            wanted = _hand_frame(fore, way, knuckles, outward, sign, axis, back)
            twist, rest_of_it = _forearm_and_wrist(fore.T @ wanted, way)
            hand = fore @ twist @ rest_of_it
            if palm == 0 and axis is None and back is None:
                break
        self.local[i["upperarm01." + side]] = arm[0]
        self.local[i["lowerarm01." + side]] = turn(np.radians(float(bend[0])) * hinge)
        self.local[i["lowerarm02." + side]], self.local[i["wrist." + side]] = twist, rest_of_it
        self._grips[side] = grip
        self._skin = None
        assert hand is not None
        return float(np.linalg.norm(self.at("wrist." + side) + hand @ to_palm - place))

    def grip(self, side: str) -> tuple[FloatArray, FloatArray]:
        """Turn (3, 3) and place (3,) of what a hand holds: y along the knuckles to the little finger, z out of the back
        of the hand."""
        sign = np.array([SIGN[side], 1, 1])
        rotation, origin = self.frame("wrist." + side)
        y, out = unit(KNUCKLES * sign), unit(PALM * sign)
        z = unit(out - (out @ y) * y)
        finger = unit(self.skeleton.at("finger3-1." + side) - self.skeleton.at("wrist." + side))
        place = origin + rotation @ (self.k * (0.078 * finger - 0.03 * out))
        self._grips[side] = "grip"
        return rotation @ np.stack([np.cross(y, z), y, z], -1), place

    def skin(self) -> FloatArray:
        """(P, 3) points of the skin in the world."""
        if self._skin is None:
            rotations, origins = forward(self.skeleton, self.local[None], self.root[None])
            self._skin = skin(self.skeleton, rotations, origins)[0]
        return self._skin

    def chosen(self, *bones: str) -> BoolArray:
        """(P,) points of the skin that a bone whose name begins with one of `bones` moves the most."""
        return np.array([b.startswith(bones) for b in self.skeleton.bones])[self.skeleton.strongest]

    def depth(self, spot: Spot, *bones: str, margin: float = 0.0) -> float:
        """How deep the skin of bones (all, if none are named) lies behind a surface, within its size, metres; the least
        distance, negative, where it does not."""
        points = self.skin()[self.chosen(*bones)] if bones else self.skin()
        side = np.cross(spot.axis, spot.normal)
        rel = points - spot.at
        inside = np.abs(rel @ side) < spot.size[0] / 2 + margin
        inside &= np.abs(rel @ spot.axis) < spot.size[1] / 2 + margin
        if not inside.any():
            return -np.inf
        return float(-(rel[inside] @ spot.normal).min())

    def lie_on(self, spot: Spot, *bones: str, soft: float = 0.012) -> None:
        """Move the person along the surface's normal until the skin of bones sinks `soft` metres into it."""
        depth = self.depth(spot, *bones)
        if np.isfinite(depth):
            self.move(spot.normal * (depth - soft))

    def top(self, *bones: str) -> float:
        """Height of the highest point of the skin of bones."""
        return float(self.skin()[self.chosen(*bones), 2].max())

    def ahead(self, low: float, high: float) -> float:
        """How far the trunk's front is ahead of the root, along the yaw, between two heights; metres."""
        points = self.skin()[self.chosen("root", "pelvis", "spine", "breast")]
        points = points[(points[:, 2] > low) & (points[:, 2] < high)]
        if not len(points):
            return 0.1 * self.k
        return float(((points - self.root) @ -rot(2, self.yaw)[:, 1]).max())


def _hand_frame(
    fore: FloatArray, way: FloatArray, knuckles: FloatArray, outward: FloatArray, sign: float,
    axis: ArrayLike | None, back: ArrayLike | None,
) -> FloatArray:  # fmt: skip
    """(3, 3) the hand's rotation in the world that fits a handle or a surface; the forearm's, if there is neither."""
    if axis is None and back is None:
        return fore
    along = fore @ way
    if axis is not None:
        k = unit(np.asarray(axis, float))
        if back is not None:
            b = np.asarray(back, float)
            b = unit(b - (b @ k) * k)
            k = k if sign * np.cross(k, b) @ along > 0 else -k
        else:
            k = k if k @ (fore @ knuckles) > 0 else -k
            b = sign * np.cross(unit(along - (along @ k) * k), k)
    else:
        b = unit(np.asarray(back, float))
        k = sign * np.cross(b, unit(along - (along @ b) * b))
    across = unit(outward - (outward @ knuckles) * knuckles)
    rest = np.stack([knuckles, across, np.cross(knuckles, across)], -1)
    return np.asarray(np.stack([k, b, np.cross(k, b)], -1) @ rest.T)


def _forearm_and_wrist(turned: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split a rotation of the hand into the forearm's about its length, and the wrist's, both within limits."""
    vector = log(turned)
    angle = float(np.linalg.norm(vector))
    half = np.sin(angle / 2) * (vector / (angle + 1e-9)) @ way
    spin = np.degrees(2 * np.arctan2(half, np.cos(angle / 2)))
    spin = (spin + 180) % 360 - 180
    twist = turn(np.radians(np.clip(spin, -_TWIST, _TWIST)) * way)
    left = log(twist.T @ turned)
    size = np.degrees(np.linalg.norm(left))
    return twist, turn(left * min(1.0, _WRIST / (size + 1e-9)))


def posed(*figures: Figure) -> tuple[Posed, ...]:
    """The people as a scene needs them; bodies are computed together."""
    body = figures[0].body
    rotvec = np.stack([log(f.local) for f in figures])
    hands = body.poses.sample(len(figures)).rotvec
    for n, f in enumerate(figures):
        _close_hands(f, rotvec[n], hands[n])
    phenotypes = np.stack([f.phenotypes for f in figures])
    vertices, landmarks, _, joints = body.forward(rotvec, phenotypes)
    shift = (np.stack([f.root for f in figures]) - joints[:, 0]).astype(np.float32)[:, None]
    gender = body.gender(phenotypes)
    return tuple(
        Posed(v, p, float(g)) for v, p, g in zip(vertices + shift, landmarks + shift, gender, strict=True)
    )  # fmt: skip


def _close_hands(figure: Figure, rotvec: FloatArray, free: FloatArray) -> None:
    """Bend fingers (of `rotvec` (bones, 3), in place) about what a hand holds; other hands are as in `free`."""
    for side, sign in SIDES:
        grip = figure._grips.get(side, "")
        mirror = np.array([1.0, sign, sign])
        _, *bends = GRIPS[grip or "relaxed"]
        size = figure.u(0.85, 1.1)
        for finger in range(1, 6):
            for joint in range(3):
                i = figure.index[f"finger{finger}-{joint + 1}.{side}"]
                if not grip:
                    rotvec[i] = free[i]
                elif finger == 1:
                    rotvec[i] = np.radians(bends[3] * (0.5, 0.8, 1.0)[joint]) * THUMB * mirror
                else:
                    rotvec[i] = np.radians(bends[joint] * size) * KNUCKLES * mirror
