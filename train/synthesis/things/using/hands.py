"""What hands do when they have nothing to hold: in the lap, on arm rests, on a table, in gestures."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.hands import HABITS
from muybridge.train.synthesis.motions.rig import SIDES, forward
from muybridge.train.synthesis.motions.self_collision import penetrates
from muybridge.train.synthesis.things.built import Spot
from muybridge.train.synthesis.things.using.figure import SIGN, Figure

UP = np.array([0.0, 0.0, 1.0])


def thigh_top(f: Figure) -> float:
    """Height of the highest point of thighs and knees ahead of the trunk."""
    return f.top("upperleg02", "lowerleg01")


def above(f: Figure, at: FloatArray, *bones: str) -> FloatArray:
    """(3,) the point of the skin of bones over or under `at`."""
    points = f.skin()[f.chosen(*bones)]
    near = np.linalg.norm(points[:, :2] - at[:2], axis=1) < 0.07 * f.k
    height = points[near, 2].max() if near.any() else at[2]
    return np.array([at[0], at[1], height])


def on_thigh(f: Figure, side: str, of: str = "") -> None:
    """A hand on a thigh or knee, its own or that of side `of`."""
    leg = of or side
    hip, knee = f.at("upperleg01." + leg), f.at("lowerleg01." + leg)
    place = above(f, hip + (knee - hip) * f.u(0.45, 0.95), "upperleg", "lowerleg01")
    f.hand(side, place, back=UP, elbow=(SIGN[side] * 0.7, 0.6, -0.3), grip="relaxed")


def habit(f: Figure, name: str, sides: str = "LR") -> None:
    """Hands as in one of the habits of people who stand or sit about."""
    way = HABITS[name]
    first = sides[0]
    for side in sides if way.hands == 2 else first:
        sign = SIGN[side]
        bone, anchor = ((b + side if b.endswith(".") else b) for b in (way.bone, way.anchor))
        offset = way.place if side == first or way.other is None else way.other
        drawn = np.array(offset) + f.rng.normal(0, 1, 3).clip(-1.5, 1.5) * way.spread
        k = f.skeleton
        rest = k.at(anchor) + drawn * 1e-3 * k.height * [sign, 1, 1]
        rotation, origin = f.frame(bone)
        elbow = (
            rotation @ (np.array(way.elbow) * [sign, 1, 1]) if bone == "root" else np.array(way.elbow) * [sign, 1, 1]
        )
        f.hand(side, origin + rotation @ (rest - k.at(bone)), elbow=elbow, grip="", palm=0.0)


def gesture(f: Figure, side: str) -> None:
    """An arm in the air."""
    f.arm(side, f.u(5, 85), f.u(5, 45), f.u(35, 125), f.u(-40, 30))


def hang(f: Figure, side: str) -> None:
    """An arm that hangs."""
    f.arm(side, f.u(-8, 18) + f.bent, f.u(9, 18), f.u(8, 35), f.u(-10, 15))


def clashes(f: Figure) -> bool:
    """Whether limbs run through the body."""
    _, at = forward(f.skeleton, f.local[None], f.root[None])
    return bool(penetrates(f.skeleton.bones, at, np.array([f.skeleton.height]))[0])


def seated_hands(f: Figure, spots: dict[str, Spot]) -> None:
    """Hands of a seated person: on arm rests or thighs, in the lap, holding something, at the face, in gestures."""
    for _ in range(3):
        _seated_hands(f, spots)
        if not clashes(f):
            return


def _seated_hands(f: Figure, spots: dict[str, Spot]) -> None:
    draw = f.u(0, 1)
    if draw < 0.3:
        habit(f, ("clasped", "clasped", "folded", "holding")[int(f.rng.integers(4))], "LR" if f.u(0, 1) < 0.5 else "RL")
        return
    for side, _ in SIDES:
        rest, draw = spots.get("arm" + side), f.u(0, 1)
        if rest is not None and draw < 0.6:
            place = rest.at + rest.axis * f.u(-0.08, 0.04)
            f.hand(side, place, back=UP, elbow=(SIGN[side] * 0.6, 0.9, -0.2), grip="relaxed")
        elif draw < 0.72:
            on_thigh(f, side)
        elif draw < 0.82:
            habit(f, ("phone", "chin", "ear", "nape")[int(f.rng.integers(4))], side)
        elif draw < 0.94:
            gesture(f, side)
        else:
            hang(f, side)


def on_top(f: Figure, edge: FloatArray, front: FloatArray) -> None:
    """Hands on a table whose near edge is at `edge` (3,); one of them elsewhere now and then."""
    near = f.u(0.06, 0.26)
    across = np.cross(front, UP) * -1.0
    for side, sign in SIDES:
        draw = f.u(0, 1)
        if draw < 0.8:
            place = edge + front * (near + f.u(-0.05, 0.1)) + across * sign * f.u(0.0, 0.28)
            back = UP if f.u(0, 1) < 0.6 else UP + across * sign
            f.hand(side, place + UP * 0.01, back=back, elbow=(sign * 0.9, 0.3, -0.25), grip="relaxed")
        elif draw < 0.88:
            on_thigh(f, side)
        elif draw < 0.95:
            habit(f, ("chin", "ear", "phone")[int(f.rng.integers(3))], side)
        else:
            gesture(f, side)
