"""Someone who propels a wheelchair and then reaches for something."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.acting.stage import Stage, between_keys, ease
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, turn
from muybridge.train.synthesis.things.built import Built
from muybridge.train.synthesis.things.objects.mobility import wheelchair
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import Figure
from muybridge.train.synthesis.things.using.hands import UP
from muybridge.train.synthesis.things.using.sitting import feet_on_rests, settle

# Seconds, and metres that the chair has rolled; hands are on the rims in the second and fourth interval.
_KEYS = (0.0, 0.35, 0.95, 1.6, 2.2, 3.1)
_ROLLED = (0.0, 0.0, 0.34, 0.66, 1.04, 1.3)
_CATCH = -28.0  # degrees ahead of the rim's top
_REACH = (2.9, 3.6, 4.1, 4.7)  # seconds: leaves the rim, is there, leaves, is back


class _Rims:
    """Where the hands are on the rims or over them, by time."""

    def __init__(self, chair: Built) -> None:
        self.rolled = between_keys(_KEYS, _ROLLED)
        self.hubs = {s: chair.pivots["wheel" + s] for s, _ in SIDES}
        self.rims = {s: chair.spots["rim" + s].at - self.hubs[s].at for s, _ in SIDES}
        self.radius = float(self.hubs["L"].at[2])
        pushed = [self._degrees(_KEYS[2]) - self._degrees(_KEYS[1]), self._degrees(_KEYS[4]) - self._degrees(_KEYS[3])]
        speed = [self._speed(t) for t in _KEYS[1:5]]
        ends = (_CATCH, _CATCH + pushed[0], _CATCH, _CATCH + pushed[1], 10.0)
        self._back = [
            CubicHermiteSpline((_KEYS[2], _KEYS[3]), ends[1:3], (speed[1], speed[2])),
            CubicHermiteSpline((_KEYS[4], _REACH[0]), ends[3:5], (speed[3], 0.0)),
        ]

    def _degrees(self, t: float) -> float:
        return float(np.degrees(self.rolled(t) / self.radius))

    def _speed(self, t: float) -> float:
        return (self._degrees(t + 1e-3) - self._degrees(t - 1e-3)) / 2e-3

    def angle(self, t: float) -> tuple[float, float]:
        """Degrees of the hands ahead of the rims' tops, and how far they are off the rims, metres."""
        if t < _KEYS[2]:
            return _CATCH + self._degrees(t) - self._degrees(_KEYS[1]), 0.0
        if _KEYS[3] <= t < _KEYS[4]:
            return _CATCH + self._degrees(t) - self._degrees(_KEYS[3]), 0.0
        way = self._back[int(t >= _KEYS[4])]
        first, last = way.x
        share = float(np.clip((t - first) / (last - first), 0, 1))
        return float(way(np.clip(t, first, last))), 0.06 * np.sin(np.pi * share) ** 2

    def place(self, side: str, t: float) -> tuple[FloatArray, FloatArray]:
        """Place (3,) of the palm, the chair unmoved, and the rim's direction (3,) there."""
        hub, rim, (degrees, off) = self.hubs[side], self.rims[side], self.angle(t)
        now = np.degrees(np.arctan2(-rim[1], rim[2]))
        spoke = turn(np.radians(degrees - now) * hub.axis) @ rim
        way = np.cross(hub.axis, spoke)
        return hub.at + spoke * (1 + off / np.linalg.norm(rim)), way / np.linalg.norm(way)


def wheelchair_user(body: BodyModel, rng: np.random.Generator, times: FloatArray) -> list[Scene]:
    """Two pushes on the rims, hands on them all the way, then a hand reaches forward, up and aside."""
    f = Figure(body, rng, (0.6, 0.9))
    chair = wheelchair(rng, max(0.42, f.seat + f.u(0.0, 0.05)), f.u(0.4, 0.44), f.u(0.4, 0.45))
    lean = between_keys((*_KEYS, *_REACH[1:]), (6, 6, 17, 8, 19, 8, 22, 22, 6))
    look = between_keys((0.0, 2.8, 3.4, 4.2, 4.7), ((8, 0), (4, 0), (-8, -25), (-8, -25), (5, 0)))
    f.trunk(0.0, pitch=-6, lean=float(lean(0)), vary=0.0)
    settle(f, chair.spots["seat"], feet_on_rests(f, chair.spots), 0.04, chair.spots["back"])
    seat, rims = f.root.copy(), _Rims(chair)
    goal = seat + np.array([-0.32, -0.62, 0.55]) * f.k
    stage = Stage("wheelchair", f)
    for t in times.tolist():
        rolled = float(rims.rolled(t))
        ahead = np.array([0.0, -rolled, 0.0])
        reached = ease(t, *_REACH[:2]) - ease(t, *_REACH[2:])
        f.trunk(0.0, pitch=-6, lean=float(lean(t)), twist=18 * reached, vary=0.0)
        nod, turned = look(t)
        f.head(float(nod), 0.0, float(turned))
        f.root = seat + ahead
        f.move((0, 0, 0))
        for s, sign in SIDES:
            at, way = rims.place(s, t)
            free = reached if s == "R" else 0.0
            at = at + (goal - at) * free + UP * 0.12 * np.sin(np.pi * free)
            elbow = np.array([0.8, 0.8, 0.1]) + (np.array([0.5, 0.5, -0.7]) - [0.8, 0.8, 0.1]) * free
            f.hand(
                s, at + ahead, axis=way if free == 0 else None, back=_back(way, free, sign), elbow=elbow * [sign, 1, 1]
            )
        now = chair.spun("wheelL", np.degrees(rolled / rims.radius)).spun("wheelR", np.degrees(rolled / rims.radius))
        stage.shoot(now.placed(0.0, ahead))
    return stage.scenes()


def _back(way: FloatArray, free: float, sign: float) -> FloatArray:
    """Where the back of a hand points: out and up on a rim, up in the air."""
    return np.array([sign * 0.75 * (1 - free), 0.0, 0.65 + 0.35 * free])
