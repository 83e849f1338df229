"""The stage on which a generator writes its script: random style, curves over time, plans of the feet.

At yaw 0 the person faces -y; lengths are in metres, times in seconds, angles in degrees.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from muybridge.arrays import BoolArray, FloatArray
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.motions.script import Script
from muybridge.train.synthesis.motions.solve import Solver

Plant = tuple[float, float, float, float, float]  # first and last second, x, y of the ball, yaw


def ease(x: FloatArray) -> FloatArray:
    """Minimum-jerk step from 0 to 1."""
    x = np.clip(x, 0, 1)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


class Stage:
    """A script being written, with the tools that generators share.

    Attributes:
        calm: 0 to 1; later tries at a motion are calmer.
    """

    def __init__(self, solver: Solver, time: FloatArray, rng: np.random.Generator, calm: float) -> None:
        self.solver, self.t, self.rng, self.calm = solver, time, rng, calm
        self.s = Script(time)
        self.end = float(time[-1])
        self.leg = solver.k.leg
        self.act = str(rng.choice(["L", "R"]))
        self.rest = "R" if self.act == "L" else "L"
        self.width = float(rng.uniform(0.75, 1.15)) * abs(float(solver.ball_at_rest("L")[0]))

    def u(self, low: float, high: float) -> float:
        """A uniform draw."""
        return float(self.rng.uniform(low, high))

    def keys(self, times: Sequence[float] | FloatArray, values: Sequence[float] | FloatArray) -> FloatArray:
        """Through the values at the times, at rest at each."""
        t, v = np.asarray(times, np.float64), np.asarray(values, np.float64)
        out = np.full(len(self.t), v[0])
        for i in range(len(t) - 1):
            out = out + (v[i + 1] - v[i]) * ease((self.t - t[i]) / max(t[i + 1] - t[i], 1e-3))
        return out

    def wander(self, low: float, high: float, hold: float) -> FloatArray:
        """A C2 curve through random values, a new one about every `hold` seconds."""
        hold *= self.u(0.8, 1.2)
        n = int(self.end / hold) + 3
        middle, half = (low + high) / 2, (high - low) / 2 * (1 - 0.6 * self.calm)
        at = (np.arange(n) - self.u(0, 1)) * hold
        curve = CubicSpline(at, self.rng.uniform(middle - half, middle + half, n), bc_type="clamped")(self.t)
        return np.asarray(middle + half * 1.1 * np.tanh((curve - middle) / max(half * 1.1, 1e-6)))

    def noise(self, channels: Sequence[str], size: float, hold: float = 1.6) -> None:
        """Slow wandering on top of what the channels hold."""
        for name in channels:
            self.s[name] = self.s[name] + self.wander(-size, size, hold)

    def alive(self, size: float = 1.0) -> None:
        """What a body never stops doing: sway, looking about, small movements of the arms."""
        self.noise(("lean", "lateral", "twist", "roll", "pitch", "yaw"), 2.0 * size)
        self.noise(("nod", "tilt"), 7 * size)
        self.noise(("look",), 22 * size, 1.2)
        for s, _ in SIDES:
            self.noise(("flex" + s, "out" + s), 5 * size)
            self.noise(("elbow" + s, "armtwist" + s, "pro" + s, "wrist" + s), 9 * size)
            self.s["curl" + s] = self.wander(0, 75, 2.5)

    def gesture(self, side: str, size: float = 1.0, hold: float = 1.1) -> None:
        """An arm that moves through wide random poses, in front of and beside the body."""
        style = self.u(0, 1)
        self.s["flex" + side] = self.wander(-20, (70 if style < 0.6 else 150) * size, hold)
        self.s["out" + side] = self.wander(12, (45 if style < 0.5 else 105) * size, hold)
        self.s["elbow" + side] = self.wander(12, 115 if style < 0.7 else 60, hold)
        self.s["armtwist" + side] = self.wander(-35, 40, hold)
        self.s["pro" + side] = self.wander(-50, 50, hold)
        self.s["wrist" + side] = self.wander(-35, 35, hold)

    def arms_out(self) -> None:
        """Both arms beside the body for balance."""
        for s, _ in SIDES:
            self.s["out" + s] = self.wander(25, 100, 1.3)
            self.s["flex" + s] = self.wander(-15, 45, 1.3)
            self.s["elbow" + s] = self.wander(8, 50, 1.3)

    def stance(self, width: float | None = None, split: float = 0.0, turnout: float = 8.0) -> dict[str, Plant]:
        """Both feet planted for all time, `split` metres apart fore and aft (the acting foot in front)."""
        plants = {}
        for s, sign in SIDES:
            fore = (-0.5 if s == self.act else 0.5) * split
            y = float(self.solver.ball_at_rest(s)[1]) + fore
            plants[s] = (-9.0, self.end + 9, sign * (width or self.width), y, sign * self.u(0.3, 1.6) * turnout)
            self.plan(s, [plants[s]])
        return plants

    def plan(self, side: str, plants: Sequence[Plant], lift: float = 0.08, roll_off: float = 0.0,
             strike: float = 0.0, kick: float = 12.0) -> None:  # fmt: skip
        """A foot that stands where and when `plants` say and swings between; the heel rises by `roll_off` degrees
        before a swing, the foot comes down with the toes up by `strike`."""
        t, p = self.t, plants
        x, y, yaw = (np.full(len(t), p[0][i]) for i in (2, 3, 4))
        z, pitch, contact = np.zeros(len(t)), np.zeros(len(t)), np.ones(len(t))
        for a, b in zip(p[:-1], p[1:], strict=True):
            gap = max(b[0] - a[1], 1e-3)
            phase = (t - a[1]) / gap
            move = ease(phase)
            x, y, yaw = x + (b[2] - a[2]) * move, y + (b[3] - a[3]) * move, yaw + (b[4] - a[4]) * move
            inside = (phase > 0) & (phase < 1)
            q = np.where(inside, phase, 0)
            z = z + lift * 64 * (q * (1 - q)) ** 3 * (1.35 - 0.7 * q)
            rise = min(0.45 * (a[1] - a[0]), 0.8 * gap)
            up = ease((t - a[1] + rise) / rise) * (1 - ease(phase / 0.75))
            down = ease((phase - 0.5) / 0.45) * (1 - ease((t - b[0]) / (0.25 * gap)))
            pitch = pitch + roll_off * up - strike * down + kick * 64 * (q * (1 - q)) ** 3
            contact = np.where((phase > 0) & (t < b[0] + (0.25 * gap if strike else 0)), 0.0, contact)
        for name, value in zip(("bx", "by", "bz", "byaw", "bpitch", "contact"), (x, y, z, yaw, pitch, contact),
                               strict=True):  # fmt: skip
            self.s[name + side] = value

    def free_leg(self, side: str, weight: FloatArray) -> None:
        """Lets a leg go by its angles where `weight` is 1; there it touches nothing."""
        self.s["plant" + side] = 1 - weight
        self.s["contact" + side] = np.where(weight > 1e-6, 0.0, self.s["contact" + side])


def spans(mask: BoolArray) -> list[tuple[int, int]]:
    """First and last frames about the runs of true, the frames of contact on either side included."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    out = []
    for a, b in zip(np.nonzero(edges == 1)[0], np.nonzero(edges == -1)[0], strict=True):
        if a > 0 and b < len(mask):
            out.append((int(a) - 1, int(b)))
    return out
