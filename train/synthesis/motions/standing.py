"""Generators of motion on the feet: standing, walking, running, jumping, squatting, reaching, balancing, ...

A generator draws a style (amplitude, tempo, asymmetry) and fills the channels of a `Script`. At yaw 0 the person
faces -y; lengths are in metres, times in seconds, angles in degrees. Lengths scale with the leg.
"""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.motions.script import GRAVITY
from muybridge.train.synthesis.motions.stage import Stage, ease, spans


def stand(g: Stage) -> None:
    """Standing: shifts of weight, gestures, sometimes a step to another place."""
    g.s["balance"] = 1.0
    g.stance(turnout=10)
    g.alive(1.3)
    g.s["height"] = 0.985 + g.wander(-0.012, 0.008, 2)
    for s, _ in SIDES:
        if g.u(0, 1) < 0.6:
            g.gesture(s, g.u(0.4, 1))
    if g.end > 3 and g.u(0, 1) < 0.6:
        t, (x, y, yaw) = g.u(0.8, g.end - 2.2), (g.u(-0.15, 0.15), g.u(-0.25, 0.2), g.u(-30, 30))
        for i, (s, sign) in enumerate(SIDES if x > 0 else SIDES[::-1]):
            at, first = g.solver.ball_at_rest(s), t + 0.9 * i
            a = (-9.0, first, sign * g.width, float(at[1]), sign * g.u(2, 12))
            g.plan(s, [a, (first + 0.55, g.end + 9, a[2] + x, a[3] + y, a[4] + yaw)])
        g.s["yaw"] = g.s["yaw"] + g.keys([t, t + 1.4], [0, yaw])


def reach(g: Stage) -> None:
    """Reaching: high, low and far, the trunk following the hand, the knees giving way."""
    g.s["balance"] = 1.0
    g.stance(g.width * g.u(1, 1.6), g.u(0, 0.35))
    g.alive()
    times, n = [0.2], 0
    while times[-1] < g.end:
        times.append(times[-1] + g.u(0.7, 1.5))
        n += 1
    n, far = len(times), 1 - 0.5 * g.calm
    low = (g.rng.random(n) < 0.4) * far
    away = (g.rng.random(n) < 0.75) * far
    g.s["lean"] = 3 + g.keys(times, away * low * g.rng.uniform(20, 70, n) + away * g.rng.uniform(-5, 20, n))
    g.s["lateral"] = g.keys(times, away * g.rng.normal(0, 16, n).clip(-32, 32))
    g.s["twist"] = g.keys(times, away * g.rng.normal(0, 22, n).clip(-45, 45))
    g.s["pitch"] = 2 + g.keys(times, away * low * g.rng.uniform(0, 40, n))
    g.s["height"] = 0.98 - g.keys(times, away * low * g.rng.uniform(0, 0.4, n))
    both = g.u(0, 1) < 0.4
    for s, _ in SIDES:
        if s == g.act or both:
            g.s["flex" + s] = g.keys(times, away * g.rng.uniform(35, 165, n) * (1 - 0.4 * low))
            g.s["out" + s] = 12 + g.keys(times, away * g.rng.uniform(-5, 60, n))
            g.s["elbow" + s] = 20 + g.keys(times, (1 - away) * 30 - away * 8)
            g.s["pro" + s] = g.wander(-40, 40, 1)


def squat(g: Stage) -> None:
    """Squats of any depth and tempo, arms forward, hanging or wide."""
    g.s["balance"] = 1.0
    g.stance(g.width * g.u(1.0, 1.7), g.u(-0.05, 0.1), 14)
    g.alive(0.6)
    period, times, depth = g.u(1.6, 4), [0.1], [0.0]
    while times[-1] < g.end:
        times += [times[-1] + period * g.u(0.35, 0.5), times[-1] + period * g.u(0.55, 0.65), times[-1] + period]
        d = g.u(0.12, 0.62 - 0.2 * g.calm)
        depth += [d, d, 0.0]
    down = g.keys(times, depth)
    g.s["height"] = 0.985 - down
    g.s["lean"], g.s["pitch"] = 3 + down * g.u(20, 60), 2 + down * g.u(25, 60)
    g.s["nod"] = g.s["nod"] - down * g.u(0, 60)
    arms, bent = g.u(0, 1), g.u(5, 120)
    for s, _ in SIDES:
        g.s["abd" + s] = -3 + down * g.u(20, 50)
        if arms < 0.5:
            g.s["flex" + s] = g.s["flex" + s] + down * g.u(100, 190)
        elif arms < 0.75:
            g.s["out" + s] = 16 + down * g.u(40, 130)
        else:
            g.s["flex" + s], g.s["elbow" + s] = 50 + down * 30, np.full(len(g.t), bent)
        g.s["abd" + s] = np.clip(g.s["abd" + s], -10, 40)


def kick(g: Stage) -> None:
    """Kicks forward, sideways or back from a stance on one leg."""
    g.s["balance"] = 1.0
    g.stance(g.width)
    g.alive()
    g.arms_out()
    _lifts(g, 1.9, (("hip", -25, 85), ("abd", 0, 45), ("knee", 10, 60)), swing=True)


def balance(g: Stage) -> None:
    """Balancing on one leg, the other held before, beside or behind, the trunk tilting against it."""
    g.s["balance"] = 1.0
    g.stance(g.width * 0.9)
    g.alive()
    g.arms_out()
    _lifts(g, 4.5, (("hip", -30, 95), ("abd", -5, 50), ("knee", 5, 110)), swing=False)


def _lifts(g: Stage, period: float, ranges: Sequence[tuple[str, float, float]], swing: bool) -> None:
    """Lifts the acting leg again and again; a kick takes it back first and through fast."""
    side = g.act
    names = ("weight", "lean", "pitch", "roll", "lateral", *(n for n, _, _ in ranges))
    times, values = [0.0], {n: [0.0] for n in names}
    start, sign = {n: float(g.s[n + side][0]) for n, _, _ in ranges}, 1.0 if side == "L" else -1.0
    while times[-1] < g.end + 1:
        t, far = times[-1], 1 - 0.55 * g.calm
        goal = {n: far * (g.u(a, b) - start[n]) for n, a, b in ranges}
        hip, wide = goal["hip"], goal["abd"]
        goal |= {"weight": 1.0, "lean": g.u(-5, 10) + 0.1 * max(-hip, 0), "pitch": -0.8 * min(hip, 0) * g.u(0.5, 1.6),
                 "roll": -sign * wide * g.u(0, 0.5), "lateral": sign * wide * g.u(-0.3, 0.2)}  # fmt: skip
        if swing:
            wind = {n: v * 0.3 for n, v in goal.items()} | {"weight": 1.0, "hip": g.u(-25, -10), "knee": g.u(40, 85)}
            through = goal | {"knee": g.u(-2, 25)}
            marks = [(0.5, None), (0.95, wind), (0.95 + g.u(0.18, 0.3), through), (1.7, None)]
        else:
            marks = [(0.8, None), (1.8, goal), (period * g.u(0.6, 0.75), {n: v * g.u(0.8, 1) for n, v in goal.items()}
                                                | {"weight": 1.0}), (period, None)]  # fmt: skip
        for at, pose in marks:
            times.append(t + at)
            for n in names:
                values[n].append(0.0 if pose is None else pose[n])
        times.append(times[-1] + g.u(0.5, 0.9))
        for n in names:
            values[n].append(0.0)
    curve = {n: g.keys(times, v) for n, v in values.items()}
    g.free_leg(side, curve["weight"])
    for n in ("lean", "pitch", "roll", "lateral"):
        g.s[n] = g.s[n] + curve[n]
    for n, _, _ in ranges:
        g.s[n + side] = g.s[n + side] + curve[n]
    up = curve["weight"] * (1 - curve["weight"]) * 4
    g.s["bz" + side] = g.s["bz" + side] + 0.12 * up  # clear of the floor on the way
    g.s["ankle" + side] = ease(2 * curve["weight"] - 1) * g.u(-5, 45)
    g.s["height"] = 0.98 - 0.03 * curve["weight"]


def throw(g: Stage) -> None:
    """Throws: wind-up, release with a twist of the trunk, follow-through; over the shoulder, sidearm or underarm."""
    g.s["balance"] = 0.8
    sign = 1.0 if g.act == "L" else -1.0
    g.act, arm = g.rest, g.act  # the other foot in front
    g.stance(g.width * g.u(0.9, 1.3), g.u(0.15, 0.5))
    g.alive(0.7)
    style, t = g.u(0, 1), 0.0
    poses = {"flex": [0.0], "out": [12.0], "elbow": [25.0], "twist": [0.0], "lean": [3.0], "armtwist": [0.0]}
    times = [0.0]
    while t < g.end:
        wind, fly = g.u(0.5, 0.8), g.u(0.16, 0.28)
        far = 1 - 0.4 * g.calm
        if style < 0.55:
            key = [("flex", 40, 120, 45), ("out", 95, 40, 5), ("elbow", 100, 12, 25), ("armtwist", -50, 10, 20)]
        elif style < 0.8:
            key = [("flex", -5, 60, 70), ("out", 90, 60, -15), ("elbow", 50, 10, 40), ("armtwist", 0, 0, 10)]
        else:
            key = [("flex", -55, 65, 110), ("out", 12, 10, 8), ("elbow", 15, 8, 25), ("armtwist", 0, 0, 0)]
        body = [("twist", -sign * g.u(25, 48) * -1 * far, -sign * 18 * far, -sign * g.u(20, 40) * far),
                ("lean", -10 * far, 15 * far, g.u(15, 40) * far)]  # fmt: skip
        times += [t + wind, t + wind + 0.08, t + wind + 0.08 + fly, t + wind + 0.28 + fly, t + wind + 1.1]
        for name, a, b, c in key + body:
            poses[name] += [a, a, b, c, poses[name][0]]
        t = times[-1] + g.u(0.1, 0.6)
        times.append(t)
        for name in poses:
            poses[name].append(poses[name][0])
    for name, v in poses.items():
        channel = name if name in ("twist", "lean") else name + arm
        g.s[channel] = g.s[channel] * (0.4 if channel == name else 0.15) + g.keys(times, v)
    other = "R" if arm == "L" else "L"
    g.s["flex" + other], g.s["out" + other] = g.wander(0, 70, 0.9), g.wander(12, 60, 0.9)
    g.s["yaw"] = g.s["yaw"] + 0.5 * (g.s["twist"] - g.s["twist"].mean())
    g.s["height"] = 0.955 - 0.02 * g.wander(0, 2, 1)


def dance(g: Stage) -> None:
    """Dancing on the beat: steps about the place, swaying hips, bounces, arms through wide poses, turns."""
    beat = 60 / g.u(85, 140)
    n, far = int(g.end / beat) + 4, 1 - 0.5 * g.calm
    g.s["balance"] = 0.9
    drift = np.cumsum(g.rng.normal(0, 0.05, (n, 2)), 0)
    turning = np.cumsum(g.rng.normal(0, 9, n)) * far
    every = int(g.rng.choice([1, 2, 2, 4]))
    for j, (s, sign) in enumerate(SIDES):
        at, plants, last = g.solver.ball_at_rest(s), [], -9.0
        for b in range(j * every, n, 2 * every):
            yaw = turning[b]
            side = sign * g.width * g.u(0.8, 1.5)
            fore = float(at[1]) + g.u(-0.15, 0.15) * far
            c, d = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
            x, y = drift[b] + [c * side - d * fore, d * side + c * fore]
            plants.append((last, (b + 2 * every) * beat - 0.75 * beat, x, y, yaw + sign * 8))
            last = (b + 2 * every) * beat - 0.12 * beat
        g.plan(s, plants, lift=g.u(0.04, 0.14), roll_off=g.u(0, 18))
    phase = np.pi * g.t / beat
    g.s["yaw"] = CubicSpline(np.arange(n) * beat, turning)(g.t)
    g.s["height"] = 0.955 - g.u(0.005, 0.03) * (1 - np.cos(2 * phase)) - g.wander(0, 0.06, 3 * beat)
    g.alive(1.5)
    g.s["roll"] = g.s["roll"] + g.u(2, 8) * np.sin(phase)
    g.s["lateral"] = g.s["lateral"] - g.u(2, 13) * np.sin(phase + g.u(-0.5, 0.5))
    g.s["twist"] = g.s["twist"] + g.wander(-28, 28, 2 * beat)
    g.s["lean"] = g.s["lean"] + g.wander(-10, 25, 3 * beat)
    for s, _ in SIDES:
        g.gesture(s, g.u(0.6, 1.1), beat * float(g.rng.choice([1, 2])))


def _travel(g: Stage, speed: float, bend: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Path of the root at a speed, turning by `bend` degrees per second: x, y and yaw as functions sampled finely."""
    fine = np.arange(-2, g.end + 2, 1 / 240)
    yaw = np.radians(bend * fine + 8 * np.sin(fine * g.u(0.3, 0.9) + g.u(0, 6)))
    x, y = np.cumsum(np.sin(yaw)) / 240 * speed, np.cumsum(-np.cos(yaw)) / 240 * speed
    return fine, np.stack([x, y], -1), np.degrees(yaw)


def _gait(g: Stage, speed: float, stride: float, duty: float, lift: float, roll_off: float, strike: float,
          kick: float, swing: float) -> FloatArray:  # fmt: skip
    """Feet, path and arms of a walk or run; returns the phase of the left foot (0 where it comes down)."""
    fine, path, heading = _travel(g, speed, g.u(-25, 25) * (1 - g.calm))
    start, narrow = g.u(0, stride), g.u(0.35, 0.85) if duty > 0.5 else g.u(0.15, 0.4)
    for j, (s, sign) in enumerate(SIDES):
        plants = []
        for step in range(-2, int((g.end + 3) / stride) + 2):
            first = start + (step + 0.5 * j) * stride
            middle = first + duty * stride * 0.5
            at, yaw = np.array([np.interp(middle, fine, p) for p in path.T]), np.interp(middle, fine, heading)
            out, fore = sign * g.width * narrow, float(g.solver.ball_offset[1]) * (0.35 if strike else 0.1)
            c, d = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
            at = at + [c * out - d * fore, d * out + c * fore]
            plants.append((first, first + duty * stride, *at.tolist(), float(yaw) + sign * g.u(2, 7)))
        g.plan(s, plants, lift, roll_off, strike, kick)
    for i, name in enumerate("xy"):
        g.s[name] = np.interp(g.t, fine, path[:, i])
    g.s["yaw"] = np.interp(g.t, fine, heading)
    phase = (g.t - start) / stride
    turn, late = 2 * np.pi * phase, g.u(-0.4, 0.4)
    g.s["roll"], g.s["twist"] = -g.u(1, 4) * np.sin(turn), g.u(4, 12) * np.cos(turn + late)
    g.alive(0.8)
    g.s["yaw"] = g.s["yaw"] - g.u(2, 6) * np.cos(turn)
    for s, sign in SIDES:
        g.s["flex" + s] = 3 - sign * swing * g.u(0.85, 1.15) * np.cos(turn + late) + g.wander(-4, 4, 2)
    return np.asarray(phase)


def walk(g: Stage) -> None:
    """Walking, from a stroll to a march, straight or in a curve; arms swing, or carry on with gestures."""
    froude = g.u(0.25, 0.5) - 0.1 * g.calm
    speed = froude * np.sqrt(GRAVITY * g.leg)
    stride = g.u(0.95, 1.1) * (1.45 - 0.75 * froude) * np.sqrt(g.leg)
    phase = _gait(g, speed, stride, g.u(0.6, 0.66), g.u(0.03, 0.09), g.u(22, 38), g.u(4, 14), g.u(0, 12), g.u(6, 32))
    g.s["height"] = g.u(0.94, 0.965) + 0.012 * np.cos(4 * np.pi * (phase - 0.3))
    side = np.stack([np.cos(np.radians(g.s["yaw"])), np.sin(np.radians(g.s["yaw"]))])
    sway = g.u(0.01, 0.03) * np.cos(2 * np.pi * (phase - 0.3))
    g.s["x"], g.s["y"] = g.s["x"] + side[0] * sway, g.s["y"] + side[1] * sway
    g.s["lean"] = g.s["lean"] + g.u(-3, 12)
    for s, _ in SIDES:
        if g.u(0, 1) < 0.2:
            g.gesture(s, 0.8)


def run(g: Stage) -> None:
    """Running: a flight after every step, the foot kicked up behind, elbows bent."""
    speed = g.u(2.0, 4.2 - 1.2 * g.calm) * np.sqrt(g.leg / 0.95)
    stride = g.u(0.62, 0.74) * np.sqrt(g.leg / 0.95)
    duty = g.u(0.3, 0.38) * min(1.0, 2.9 / speed) ** 0.4
    phase = _gait(g, speed, stride, duty, g.u(0.14, 0.34), g.u(25, 38), 0.0, g.u(35, 70), g.u(22, 50))
    step = np.mod(2 * phase, 1.0)  # 0 where a foot comes down
    stance, flight = 2 * duty, 1 - 2 * duty
    rise = 0.5 * GRAVITY * flight * stride / 2  # vertical speed at take-off
    s, f = np.minimum(step / stance, 1), np.clip((step - stance) / flight, 0, 1)
    up = np.where(step < stance, rise * stance * stride / 2 * (s**2 - s),
                  0.5 * GRAVITY * (flight * stride / 2) ** 2 * f * (1 - f))  # fmt: skip
    g.s["height"] = g.u(0.92, 0.945) + up / g.solver.k.rest[0, 2]
    g.s["pitch"], g.s["lean"] = g.s["pitch"] + g.u(2, 8), g.s["lean"] + g.u(0, 10)
    for side, _ in SIDES:
        g.s["elbow" + side] = g.u(60, 105) + 0.35 * g.s["flex" + side]
        g.s["armtwist" + side] = g.s["armtwist" + side] + 15
    air = (g.s["contactL"] < 0.5) & (g.s["contactR"] < 0.5)
    g.s.flights += spans(air)
