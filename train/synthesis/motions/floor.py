"""Generators of motion that leaves the feet: jumping, kneeling, sitting, crawling, lying, getting up; two people."""

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.ground_contact import KNEE_BONES, TRUNK_BONES
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.motions.script import GRAVITY
from muybridge.train.synthesis.motions.stage import Plant, Stage, ease, spans


def jump(g: Stage, flight: tuple[float, float] = (0.26, 0.52)) -> None:
    """Jumps on the spot, forward, back or to a side, with legs straight, tucked or astride; in the air for `flight`
    seconds at least and at most."""
    g.s["balance"] = 1.0
    g.stance(g.width * g.u(0.9, 1.5))
    g.alive(0.5)
    root, far = float(g.solver.k.rest[0, 2]), 1 - 0.4 * g.calm
    z0, t = 0.985 * root + 0.055, g.u(0.1, 0.5)
    marks, heights, slopes = [0.0, t], [0.985 * root] * 2, [0.0] * 2
    leaps, at = [], np.zeros(2)
    place = {s: [(-9.0, 9.0, sign * g.width, float(g.solver.ball_at_rest(s)[1]), sign * 6)] for s, sign in SIDES}
    while t < g.end:
        fly, deep, low = g.u(*flight) * (0.6 + 0.4 * far), g.u(0.12, 0.33), g.u(0.1, 0.3)
        v = 0.5 * GRAVITY * fly
        down, push, land = g.u(0.35, 0.6), 1.9 * (deep + 0.06) / v + 0.05, 1.6 * (low + 0.06) / v + 0.06
        a = t + down + push
        b = a + fly
        marks += [t + down, a, b, b + land, b + land + 0.55]
        heights += [0.985 * root - deep, z0, z0, 0.985 * root - low, 0.985 * root]
        slopes += [0.0, v, -v, 0.0, 0.0]
        step = np.array([g.u(-0.25, 0.25), g.u(-0.55, 0.25)]) * far * (g.u(0, 1) < 0.6)
        at = at + step
        for s, _ in SIDES:
            last = place[s][-1]
            place[s][-1] = (last[0], a, *last[2:])
            place[s].append((b, 99.0, last[2] + step[0], last[3] + step[1], last[4]))
        leaps.append((t, t + down, a, b, b + land))
        t = b + land + 0.55 + g.u(0.05, 0.7)
        marks.append(t)
        heights.append(0.985 * root)
        slopes.append(0.0)
    g.s["height"] = CubicHermiteSpline(marks, heights, slopes)(g.t) / root
    for s, _ in SIDES:
        g.plan(s, place[s], lift=0.0, kick=0.0)
    _leap_style(g, leaps)


def _leap_style(g: Stage, leaps: list[tuple[float, float, float, float, float]]) -> None:
    """What legs, arms and trunk do about the leaps: (start, crouch, take-off, landing, absorbed)."""
    weight, crouch, heel, up = (np.zeros(len(g.t)) for _ in range(4))
    air = np.zeros(len(g.t), bool)
    for start, low, a, b, soft in leaps:
        weight += ease((g.t - a) / (0.4 * (b - a))) * ease((b - g.t) / (0.4 * (b - a)))
        crouch += ease((g.t - start) / (low - start)) * (1 - ease((g.t - low) / (a - low)))
        crouch += 0.8 * ease((g.t - b) / (soft - b)) * (1 - ease((g.t - soft) / 0.5))
        heel += ease((g.t - low) / (a - low)) * (1 - ease((g.t - b) / (0.6 * (soft - b))))
        up += ease((g.t - low) / (a - low)) * (1 - ease((g.t - b) / 0.5))
        air |= (g.t > a) & (g.t < b)
    style, amount = g.u(0, 1), g.u(0.3, 1)
    arms = g.u(30, 165)
    for s, _ in SIDES:
        g.free_leg(s, weight)
        g.s["contact" + s] = np.where(air, 0.0, 1.0)
        g.s["bpitch" + s] = 38 * heel
        g.s["ankle" + s] = 35 * np.ones(len(g.t))
        tuck = weight * amount * (1.0 if style < 0.4 else 0.25)
        g.s["hip" + s], g.s["knee" + s] = 8 + 65 * tuck, 12 + 85 * tuck
        if style > 0.7:
            g.s["abd" + s] = -3 + 32 * weight * amount
        g.s["flex" + s] = g.s["flex" + s] - 40 * crouch + arms * up
        g.s["out" + s] = g.s["out" + s] + 20 * up
    g.s["lean"], g.s["pitch"] = g.s["lean"] + 25 * crouch, g.s["pitch"] + 18 * crouch
    g.s.flights += spans(air)


def kneel(g: Stage) -> None:
    """Down on one knee or both and up again, with gestures while there."""
    k, leg = g.solver.k, g.leg
    back, both = (0.76 - 0.08 * g.calm) * leg, g.u(0, 1) < 0.5
    side = g.act
    rate = max(g.end / 9.0, 0.45)
    stay = [1.1 * rate, 2.4 * rate, g.end + 9] if g.u(0, 1) < 0.5 else [1.1 * rate, 2.4 * rate, 7.2 * rate]
    t0, t1, t2 = stay
    sign = 1.0 if side == "L" else -1.0
    y = float(g.solver.ball_at_rest(side)[1])
    rear: Plant = (t0, 99.0, sign * g.width * 0.9, y + back, sign * 4)
    g.alive(0.8)
    g.plan(side, [(-9.0, t0 - 0.8 * rate, sign * g.width, y, sign * 6), rear], lift=0.05)
    other: list[Plant] = [(-9.0, t1 + 0.3, -sign * g.width, y, -sign * 6)]
    down = g.keys([t0 - 0.2, t1, t2, t2 + 1.4], [0, 1, 1, 0])
    two = np.zeros(len(g.t))
    if both and t2 > g.end:
        other.append((t1 + 1.2 * rate, 99.0, -sign * g.width * 0.9, y + back, -sign * 4))
        two = g.keys([t1 + 0.2, t1 + 1.3 * rate], [0, 1])
    g.plan(g.rest, other, lift=0.05)
    g.s["bpitch" + side] = g.keys([t0 - 0.8 * rate, t0], [0, 48]) + 14 * down
    g.s["bpitch" + g.rest] = g.s["bpitch" + g.rest] + 62 * two
    g.s["balance"] = 1 - two
    heels = two * g.wander(0, 1, 3.0)
    g.s["y"] = two * (y + back - 0.44 * leg + 0.17 * leg * heels)
    thigh = float(np.linalg.norm(k.at("upperleg01.L") - k.at("lowerleg01.L")))
    low = (thigh + 0.03) / float(k.rest[0, 2])
    g.s["height"] = 0.965 - down * (0.965 - low) - 0.12 * heels
    g.s["pitch"] = g.s["pitch"] + g.keys([t0 - 0.8 * rate, t0 - 0.1, t1, t2, t2 + 1.4], [0, 20, 4, 4, 20])
    g.s["lean"] = g.s["lean"] + 12 * down * (1 - down) * 4 + g.wander(-5, 30, 2.5) * down
    for s, _ in SIDES:
        if g.u(0, 1) < 0.7:
            g.gesture(s, 0.8)


def sit(g: Stage) -> None:
    """Sitting down on a seat, sitting with gestures, getting up; or seated all the time."""
    leg, high = g.leg, float(g.solver.k.rest[0, 2])
    g.act = g.act if g.u(0, 1) < 0.5 else g.rest
    g.stance(g.width * g.u(0.8, 1.4), g.u(0, 0.12), 10)
    g.alive(1.1)
    a, b = g.u(0.4, 1.2), g.u(0.9, 1.5)
    style = g.u(0, 1)
    if style < 0.45 or g.end < 3:
        seated = np.ones(len(g.t))
        moving = np.zeros(len(g.t))
    elif style < 0.75:
        seated, moving = g.keys([a, a + b], [0, 1]), g.keys([a - 0.3, a + 0.5 * b, a + b + 0.3], [0, 1, 0])
    else:
        c = g.end - g.u(1.6, 2.2)
        seated = g.keys([a, a + b, max(c, a + b), c + b], [0, 1, 1, 0])
        moving = g.keys([a - 0.3, a + 0.5 * b, a + b + 0.3, max(c - 0.3, a + b + 0.3), c + 0.5 * b, c + b + 0.4],
                        [0, 1, 0, 0, 1, 0])  # fmt: skip
    seat = g.u(0.40, 0.56) * leg / high + 0.03
    g.s["balance"] = 1 - seated
    ball = float(g.solver.ball_at_rest("L")[1])
    g.s["y"] = seated * (ball + g.u(0.5, 0.62) * leg)
    g.s["height"] = 0.975 - seated * (0.975 - seat)
    g.s["pitch"] = 2 + g.u(-18, 8) * seated + 25 * moving
    g.s["lean"] = 3 + 22 * moving + seated * g.wander(-8, 38, 2.2)
    for s, _ in SIDES:
        g.gesture(s, 0.9, 1.6)
        g.s["flex" + s] = g.s["flex" + s] * (1 - 0.3 * seated) + 22 * seated
        g.s["abd" + s] = -3 + seated * g.u(-2, 16)


def _off_the_feet(g: Stage, bearing: tuple[str, ...]) -> None:
    g.s["ground"], g.s.bearing = 1.0, bearing
    for s, _ in SIDES:
        g.s["plant" + s], g.s["contact" + s] = 0.0, 0.0


def crawl(g: Stage) -> None:
    """On hands and knees: diagonal steps, the hands and the bearing knees staying where they are."""
    k = g.solver.k
    period, duty = g.u(0.9, 1.7), g.u(0.55, 0.68)
    thigh = float(np.linalg.norm(k.at("upperleg01.L") - k.at("lowerleg01.L")))
    shoulders = float(np.linalg.norm(k.at("upperarm01.L") - k.rest[0]))
    arm = sum(float(np.linalg.norm(k.at(a) - k.at(b))) for a, b in (("upperarm01.L", "lowerarm01.L"),
                                                                    ("lowerarm01.L", "wrist.L")))  # fmt: skip
    rise = (g.u(0.74, 0.9) * arm - thigh) / shoulders  # of the trunk, so that the arms reach the floor, nearly straight
    pitch = np.degrees(np.arccos(np.clip(rise, -0.1, 0.5)))
    reach = thigh * np.sin(np.radians(g.u(8, 22) * (1 - 0.4 * g.calm)))
    speed = 2 * reach / (duty * period)
    g.s["y"] = -speed * g.t
    g.s["pitch"], g.s["lean"] = pitch, g.u(-8, 14)
    g.noise(("lateral", "twist", "roll", "yaw"), 2.5)
    g.s["nod"], g.s["look"] = -g.u(5, 50) + g.wander(-10, 10, 1), g.wander(-35, 35, 1.3)
    start, width = g.u(0, period), g.u(0.13, 0.24)
    for j, (s, sign) in enumerate(SIDES):
        plants = []
        for step in range(-3, int((g.end + 3) / period) + 3):
            first = start + (step + 0.5 * (1 - j)) * period
            y = -speed * (first + 0.5 * duty * period) - shoulders * np.sin(np.radians(pitch + 3)) * 0.93
            plants.append((first, first + duty * period, sign * width, y, 0.0))
        g.plan(s, plants, lift=g.u(0.05, 0.12))
        for hand, foot in (("hx", "bx"), ("hy", "by"), ("hz", "bz")):
            g.s[hand + s] = g.s[foot + s]
        g.s["hz" + s] = g.s["hz" + s] + g.solver.palm[s][1]
        g.s["hand" + s], g.s["palm" + s], g.s["flex" + s], g.s["out" + s], g.s["elbow" + s] = 1.0, 1.0, 85.0, 5.0, 8.0
        g.s["armtwist" + s], g.s["wrist" + s], g.s["curl" + s] = -10.0, -70.0, 0.0
        phase = np.mod((g.t - start) / period - 0.5 * j, 1.0)
        swung = (phase - duty) / (1 - duty)
        fore = np.where(phase < duty, reach * (1 - 2 * phase / duty), reach * (2 * ease(swung) - 1))
        fore = gaussian_filter1d(fore, 2.5 if len(g.t) > 10 else 0.1, mode="nearest")
        lifted = np.clip(swung, 0, 1)
        lifted = 64 * (lifted * (1 - lifted)) ** 3
        g.s["hip" + s] = pitch + np.degrees(np.arcsin(fore / thigh)) + 7 * lifted
        g.s["knee" + s] = 86 + np.degrees(np.arcsin(fore / thigh)) + 12 * lifted
        g.s["ankle" + s] = g.u(30, 52)
        g.s["abd" + s] = -8 + g.wander(-2, 4, 2)
    _off_the_feet(g, KNEE_BONES)
    g.s["kneelL"] = g.s["kneelR"] = 1.0
    g.s["height"] = (thigh + 0.06) / float(k.rest[0, 2])


def lie(g: Stage) -> None:
    """Lying on the back, front or side; limbs move, sometimes the body rolls over."""
    _off_the_feet(g, TRUNK_BONES)
    base = float(g.rng.choice([0.0, 90.0, -90.0, 180.0])) + g.u(-12, 12)
    roll = np.full(len(g.t), base)
    if g.end > 3 and g.u(0, 1) < 0.5:
        a = g.u(0.4, g.end - 2.4)
        roll = g.keys([a, a + g.u(1.2, 2.2)], [base, base + float(g.rng.choice([-90, 90, 180, -180]))])
    g.s["roll"], g.s["pitch"] = roll + g.wander(-4, 4, 2), -90 + g.wander(-3, 3, 2)
    g.s["height"], g.s["x"] = 0.15, np.radians(roll - base) * 0.07 * float(g.solver.k.height)  # rolls, does not slide
    g.s["headsink"] = 1 - g.wander(0, 0.3, 2)
    up = 0.5 * (1 + np.cos(np.radians(roll)))  # 1 on the back, 0 on the front
    flat = np.abs(np.cos(np.radians(roll)))  # 0 on a side
    g.s["lean"], g.s["lateral"] = g.wander(-4, 10, 2) * up, g.wander(-12, 12, 2) * flat
    g.s["twist"], g.s["look"] = g.wander(-12, 12, 2), g.wander(-50, 50, 1.6)
    g.s["nod"] = g.wander(-5, 25, 2) * up - 15 * (1 - up)
    drawn_up = 12.0 if g.u(0, 1) < 0.35 else 75 - 30 * g.calm
    for s, sign in SIDES:
        bent, hip = g.wander(0, 1, 1.8), g.wander(0, drawn_up, 1.8)
        g.s["hip" + s] = 4 + hip * up
        g.s["knee" + s] = 6 + up * hip * (0.8 + bent) + (1 - up) * bent * 70
        g.s["abd" + s] = g.wander(-3, 25, 2)
        g.s["ankle" + s] = 15 + 25 * (1 - up)
        g.s["flex" + s] = up * g.wander(2, 70, 1.6) - 8 * (1 - up)
        g.s["out" + s] = g.wander(15, 115, 1.8) * (1 - 0.3 * up)
        g.s["elbow" + s], g.s["pro" + s] = g.wander(8, 95, 1.6), g.wander(-40, 40, 1.5)
        g.s["curl" + s] = g.wander(0, 60, 2)
        # On a side, the limbs below lie along the floor and those above rest on them.
        below = (np.sin(np.radians(roll)) * sign).clip(0, 1) ** 2
        above = (-np.sin(np.radians(roll)) * sign).clip(0, 1) ** 2
        for name, low, high in (("abd", -4.0, -9.0), ("out", -8.0, 4.0), ("flex", g.u(55, 150), g.u(10, 80)),
                                ("armtwist", 0.0, 0.0)):  # fmt: skip
            g.s[name + s] = g.s[name + s] * (1 - below - above) + low * below + high * above
        g.s["elbow" + s] = g.s["elbow" + s] * (1 - above) + above * g.u(10, 60)
        for limb, idle in (("arm", 0.6), ("leg", 0.75)):
            lazy = np.ones(len(g.t)) if g.u(0, 1) < idle else np.clip(g.wander(-0.3, 1.3, 1.8), 0, 1)
            g.s[f"{limb}sink{s}"] = lazy * (1 - above)


def get_up(g: Stage) -> None:
    """From lying on the back through sitting and squatting to standing; the other way round as often."""
    rate = min(max(g.end / 7.0, 0.5), 1.3) * g.u(0.85, 1.1)
    lying, sitting, squatting, standing = (np.array([0.5, 1.8, 3.1, 4.5]) * rate).tolist()
    leg, high = g.leg, float(g.solver.k.rest[0, 2])
    key = [lying, sitting, squatting, standing]
    wide = g.width * g.u(1.0, 1.5)
    g.stance(wide, 0.0, 14)
    g.alive(0.7)
    feet = g.keys([sitting - 0.55 * rate, sitting + 0.15 * rate], [0, 1])
    g.s["ground"] = 1 - g.keys([sitting - 0.5 * rate, sitting + 0.3 * rate], [0, 1])
    g.s.bearing = TRUNK_BONES
    down = 1 - g.keys([lying, 0.5 * (lying + sitting)], [0, 1])
    g.s["headsink"] = down
    g.s["balance"] = g.keys([sitting, squatting], [0, 1])
    ball = float(g.solver.ball_at_rest("L")[1])
    back = ball + 0.54 * leg
    g.s["y"] = g.keys(key, [back + 0.2, back, ball + 0.1, 0.0])
    deep = g.u(0.34, 0.42)
    g.s["height"] = g.keys(key, [0.12, 0.12, deep, 0.985]) * (0.985 * high / high)
    g.s["pitch"] = g.s["pitch"] + g.keys(key, [-90, g.u(-28, -12), 10, 0])
    g.s["lean"] = g.s["lean"] + g.keys(key, [0, g.u(25, 45), 40, 0])
    g.s["nod"] = g.keys(key, [5, 10, -25, 3])
    for s, _ in SIDES:
        g.s["plant" + s], g.s["armsink" + s], g.s["legsink" + s] = feet, down * g.u(0.5, 1), 1.0
        g.s["contact" + s] = np.where((feet > 1 - 1e-6) & (g.s["ground"] < 1e-6), 1.0, 0.0)
        g.s["hip" + s] = g.keys(key, [g.u(3, 30), g.u(85, 100), 115, 5])
        g.s["knee" + s] = g.keys(key, [g.u(8, 50), g.u(80, 105), 120, 8])
        g.s["abd" + s] = g.keys(key, [3, 8, 18, -3])
        late = g.u(-0.15, 0.15) * rate
        times = np.array(key) + late
        g.s["flex" + s] = g.keys(times, [g.u(5, 20), g.u(0, 70), g.u(30, 75), g.u(-5, 10)])
        g.s["out" + s] = g.keys(times, [g.u(20, 60), g.u(20, 35), g.u(12, 40), 14])
        g.s["elbow" + s] = g.keys(times, [g.u(10, 50), g.u(10, 40), 30, 22])
    if g.u(0, 1) < 0.5:
        for name, value in g.s.channels.items():
            g.s.channels[name] = value[::-1].copy()


def partner(g: Stage, meet: FloatArray, hands: tuple[float, float], gap: float) -> None:
    """Standing before another person `gap` metres away, hands going to `meet` (T, 3) by the shares `hands` (left,
    right)."""
    g.s["balance"] = 1.0
    g.stance(g.width, g.u(0, 0.25))
    g.alive()
    g.s["height"] = 0.975 + g.wander(-0.015, 0.005, 2)
    g.s["lean"] = g.s["lean"] + g.u(0, 10)
    for (s, _), share in zip(SIDES, hands, strict=True):
        if share > 0:
            mirrored = meet * ([1, 1, 1] if s == "L" else [-1, 1, 1])
            for i, name in enumerate(("hx", "hy", "hz")):
                g.s[name + s] = mirrored[:, i]
            g.s["hand" + s] = share * g.keys([0.2, 1.0, max(g.end - 1, 1.2), max(g.end, 2.0)], [0, 1, 1, 0.2])
            g.s["flex" + s], g.s["elbow" + s] = 35.0, 60.0
        else:
            g.gesture(s, 0.5)
            g.s["flex" + s] = np.minimum(g.s["flex" + s], 40 if gap > 0.7 else 15)
