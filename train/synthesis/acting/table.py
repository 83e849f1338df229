"""Two people who talk across a table and pass a cup."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.acting.stage import Stage, between_keys, ease
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.built import Built, surface
from muybridge.train.synthesis.things.objects import seats, tables
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.shapes import lathe
from muybridge.train.synthesis.things.using.figure import SIGN, Figure
from muybridge.train.synthesis.things.using.hands import UP, thigh_top
from muybridge.train.synthesis.things.using.sitting import Feet, ahead, feet_on_floor, left, settle

_RADIUS, _HIGH = 0.038, 0.1  # of the cup, metres
# Seconds: the first hand is at the cup, the cup is in the middle, the second hand is at it, it has it before them.
_TAKEN, _PASSED, _FETCHED, _HAD = 0.9, 1.9, 2.5, 3.5
_LEAN = 9.0
# Where the second one faces, degrees: not quite opposite, since half a turn has no one rotation vector.
_OPPOSITE = 175.0


def _seat(f: Figure, yaw: float) -> tuple[Built, Feet]:
    """A chair with a person on it who faces `yaw`; what plants their feet."""
    chair = seats.chair(f.rng, f.u(0.95, 1.05) * f.seat, f.u(0.42, 0.5), f.u(0.4, 0.46)).placed(yaw)
    f.trunk(yaw, pitch=-3, lean=_LEAN, vary=0.0)
    feet = feet_on_floor(f, forward=(-0.1, 0.12))
    settle(f, chair.spots["seat"], feet, 0.06, chair.spots["back"])
    return chair, feet


def _cup(rng: np.random.Generator) -> Built:
    profile = [(0.8 * _RADIUS, 0), (_RADIUS, 0.01), (_RADIUS, _HIGH), (0.88 * _RADIUS, _HIGH), (0.8 * _RADIUS, 0.02)]
    return Built("cup", lathe(profile, (0, 0, 0), surface(rng, "white", "paint"), 14), {})


class _Sitter:
    """One of the two: rest places of the hands, and gestures."""

    def __init__(self, f: Figure, edge: FloatArray, phase: float) -> None:
        self.f, self.front, self.aside = f, ahead(f), left(f)
        self.rest = {s: edge + self.front * 0.13 + self.aside * SIGN[s] * 0.2 + UP * 0.012 for s in "LR"}
        self.root, self.phase = f.root.copy(), phase

    def lean(self, t: float, more: float) -> None:
        """Sit, leaning `more` degrees further over the table, nodding."""
        f = self.f
        sway = np.sin(2 * np.pi * 0.35 * t + self.phase)
        f.trunk(f.yaw, pitch=-3, lean=_LEAN + more + 2 * sway, twist=3 * sway, vary=0.0)
        f.head(4 + 5 * np.sin(2 * np.pi * 0.8 * t + self.phase), 3 * sway, 6 * sway)
        f.root = self.root.copy()
        f.move((0, 0, 0))

    def talk(self, side: str, t: float, much: float) -> None:
        """A hand in the air, moving as one speaks; `much` is 0 on the table."""
        w = 2 * np.pi * t + self.phase
        wave = UP * (0.2 + 0.05 * np.sin(1.1 * w)) + self.aside * SIGN[side] * (0.03 + 0.07 * np.sin(0.7 * w))
        self.place(side, self.rest[side] + (wave + self.front * 0.05 * np.cos(0.9 * w)) * self.f.k * much, 0.5 * much)

    def place(self, side: str, at: FloatArray, upright: float) -> None:
        """A palm at a place; `upright` 0 with the back of the hand up, 1 with the thumb up."""
        back = UP * (1 - upright) + self.aside * SIGN[side] * upright
        self.f.hand(side, at, back=back, elbow=(SIGN[side] * 0.9, 0.3, -0.3), grip="relaxed")


def two_at_table(body: BodyModel, rng: np.random.Generator, times: FloatArray) -> list[Scene]:
    """Both speak with a hand; the first takes a cup and puts it in the middle, the second fetches it."""
    one, two = Figure(body, rng, (0.6, 0.9)), Figure(body, rng, (0.6, 0.9))
    (chair, plant), (opposite, plant_opposite) = _seat(one, 0.0), _seat(two, _OPPOSITE)
    high = max(thigh_top(one), thigh_top(two)) + 0.06
    table = tables.table(rng, high, float(rng.uniform(1.3, 1.45)), 0.62)
    depth, made = table.spots["top"].size[1], [table]
    edges = []
    for f, seat, y in ((one, chair, 0.0), (two, opposite, -depth)):
        edge = np.array([0.0, y, 0.0])
        by = edge - (f.root + ahead(f) * (f.ahead(high - 0.12, high + 0.12) + 0.05))
        by[2] = 0.0
        f.move(by)
        made.append(seat.placed(0.0, by))
        edges.append(edge + UP * high)
    cup = _cup(rng)
    first, second = _Sitter(one, edges[0], 0.0), _Sitter(two, edges[1], 2.0)
    # Who faces -y has the right hand at -x; so has the other the left one.
    grip = _RADIUS + 0.012
    middle = np.array([-0.1, -depth / 2, high])
    start, end = middle + [-0.05, 0.5 * depth - 0.2, 0], middle + [0.02, -0.5 * depth + 0.2, 0]
    raised = [(start + middle) / 2 + UP * 0.09, (middle + end) / 2 + UP * 0.1]
    way = between_keys(
        (_TAKEN, (_TAKEN + _PASSED) / 2, _PASSED, _FETCHED, (_FETCHED + _HAD) / 2, _HAD),
        (start, raised[0], middle, middle, raised[1], end),
    )
    stage = Stage("two at a table", one, two)
    for t in times.tolist():
        at = way(t)
        give = ease(t, 0.1, _TAKEN) - ease(t, _PASSED + 0.1, _PASSED + 0.9)
        get = ease(t, _PASSED - 0.2, _FETCHED)
        first.lean(t, 14 * (ease(t, 0.8, _PASSED) - ease(t, _PASSED + 0.1, _PASSED + 0.9)))
        second.lean(t, 14 * (ease(t, _PASSED - 0.2, _FETCHED) - ease(t, _FETCHED, _HAD)))
        for sitter, hand, share in ((first, "R", give), (second, "L", get)):
            hold = at + UP * 0.5 * _HIGH + np.array([-grip, 0, 0])
            rest = sitter.rest[hand]
            sitter.place(hand, rest + (hold - rest) * share + UP * 0.1 * np.sin(np.pi * share), share)
        first.talk("L", t, ease(t, 1.6, 2.3))
        second.talk("R", t, 1 - ease(t, 1.9, 2.5))
        plant()
        plant_opposite()
        stage.shoot(*made, cup.placed(0.0, at))
    return stage.scenes()
