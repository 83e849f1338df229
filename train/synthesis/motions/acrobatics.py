"""Generators of motion on the hands, upside down, or sitting on the floor, as of gymnasts, dancers and patients."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.floor import jump
from muybridge.train.synthesis.motions.ground_contact import TRUNK_BONES
from muybridge.train.synthesis.motions.rig import SIDES, apply, rot
from muybridge.train.synthesis.motions.stage import Stage, ease


def floor_sit(g: Stage) -> None:
    """Sitting on the floor: legs stretched, crossed or drawn up, leaning back on the hands or gesturing."""
    g.s["ground"], g.s.bearing, g.s["height"] = 1.0, TRUNK_BONES, 0.14
    g.alive(0.8)
    style = g.rng.choice(["stretched", "crossed", "drawn up", "one drawn up"])
    back = g.u(0, 1) < 0.4
    g.s["pitch"] = g.s["pitch"] + (g.u(-38, -18) if back else g.u(-22, 2))
    g.s["lean"] = g.s["lean"] + (g.u(0, 18) if back else g.u(8, 40))
    for s, _ in SIDES:
        g.s["plant" + s], g.s["contact" + s], g.s["legsink" + s] = 0.0, 0.0, 1.0
        up = style == "drawn up" or (style == "one drawn up" and s == g.act)
        if style == "crossed":
            hip, knee, abd, turned = g.u(65, 85), g.u(105, 125), g.u(38, 52), g.u(28, 42)
        elif up:
            hip, knee, abd, turned = g.u(85, 112), g.u(85, 128), g.u(-2, 14), 4.0
        else:
            hip, knee, abd, turned = g.u(70, 92), g.u(2, 25), g.u(0, 28), 6.0
        g.s["hip" + s], g.s["knee" + s] = hip + g.wander(-4, 4, 2), knee + g.wander(-6, 6, 2)
        g.s["abd" + s], g.s["hiprot" + s] = abd + g.wander(-3, 3, 2), turned
        g.s["ankle" + s] = g.u(0, 30)
        if back:
            g.s["flex" + s], g.s["out" + s] = g.u(-60, -35), g.u(10, 30) + g.wander(-3, 3, 2)
            g.s["elbow" + s], g.s["wrist" + s], g.s["armsink" + s] = g.u(5, 18), -60.0, 1.0
        elif g.u(0, 1) < 0.6:
            g.gesture(s, 0.8, 1.6)
        else:
            g.s["flex" + s], g.s["out" + s], g.s["elbow" + s] = g.u(15, 50), g.u(8, 25), g.u(30, 80)


def _arm_length(g: Stage) -> float:
    at = [g.solver.k.at(b) for b in ("upperarm01.L", "lowerarm01.L", "wrist.L")]
    return float(np.linalg.norm(at[0] - at[1]) + np.linalg.norm(at[1] - at[2]))


def _on_hands(g: Stage, wide: FloatArray | float, shoulder: FloatArray, pitch: FloatArray, roll: FloatArray) -> None:
    """Hands flat on the floor beside x = 0, y = 0, and the trunk at such a place that the shoulders' middle is at
    `shoulder` (T, 3) while it is turned by `pitch` and `roll`, degrees."""
    k = g.solver.k
    offset = 0.5 * (k.at("upperarm01.L") + k.at("upperarm01.R")) - k.rest[0]
    root = shoulder - apply(rot(1, roll) @ rot(0, pitch), np.broadcast_to(offset, shoulder.shape))
    g.s["pitch"], g.s["roll"], g.s["lean"] = pitch, roll, 0.0
    g.s["x"], g.s["y"], g.s["height"] = root[:, 0], root[:, 1], root[:, 2] / float(k.rest[0, 2])
    for s, sign in SIDES:
        g.s["hx" + s], g.s["hy" + s], g.s["hz" + s] = sign * wide, 0.0, g.solver.palm[s][1]
        g.s["hand" + s], g.s["palm" + s], g.s["curl" + s] = 1.0, 1.0, 0.0


def plank(g: Stage) -> None:
    """On hands and toes, held or as push-ups, now and then with a leg in the air."""
    k, arm = g.solver.k, _arm_length(g)
    chest = abs(float(k.at("upperarm01.L")[0]))
    g.noise(("look",), 20)
    low = np.full(len(g.t), g.u(0.9, 0.97))
    if g.u(0, 1) < 0.6:
        period, deep = g.u(1.3, 3.0), g.u(0.35, 0.7)
        low = low - (low - deep) * 0.5 * (1 - np.cos(2 * np.pi * np.maximum(g.t - g.u(0, 1), 0) / period))
    toes = g.u(58, 72)  # degrees, how far the heels are up
    ankle = float(np.interp(toes, *g.solver.ankle_heights))
    shoulder = np.zeros((len(g.t), 3))
    shoulder[:, 2] = g.solver.palm["L"][1] + arm * low
    body = float(np.linalg.norm(k.at("upperarm01.L") - k.at("foot.L")))
    slope = np.degrees(np.arcsin((shoulder[:, 2] - ankle) / body))
    _on_hands(g, chest * g.u(1.0, 1.4), shoulder, 90 - slope + g.u(-3, 3), np.zeros(len(g.t)))
    behind = float(np.mean(np.cos(np.radians(slope)))) * body * 0.985
    lifted = g.act if g.u(0, 1) < 0.3 else ""
    for s, sign in SIDES:
        offset = g.solver.ball_offset * ([1, 1, 1] if s == "L" else [-1, 1, 1])
        ball = behind + float((rot(0, toes) @ offset)[1])
        g.plan(s, [(-9.0, g.end + 9, sign * g.width, ball, 0.0)])
        g.s["bpitch" + s], g.s["ankle" + s], g.s["hip" + s], g.s["knee" + s] = toes, -10.0, 2.0, 3.0
        g.s["flex" + s], g.s["out" + s], g.s["elbow" + s] = 85.0, 25.0, 20.0
        if s == lifted:
            up = np.clip(g.wander(-0.5, 1.5, 1.5), 0, 1)
            g.free_leg(s, ease(4 * up))
            g.s["hip" + s], g.s["ankle" + s] = 2 - 22 * up, 30.0
    g.s["nod"] = -g.u(0, 30) + g.wander(-8, 8, 2)


def handstand(g: Stage) -> None:
    """On the hands, legs together, split or bent, swaying."""
    arm, chest = _arm_length(g), abs(float(g.solver.k.at("upperarm01.L")[0]))
    pitch, roll = 180 + g.u(-6, 6) + g.wander(-5, 5, 1.2), g.wander(-4, 4, 1.4)
    shoulder = np.zeros((len(g.t), 3))
    shoulder[:, 2] = g.solver.palm["L"][1] + arm * 0.97
    shoulder[:, 1] = 0.012 * (pitch - 180)
    _on_hands(g, chest * g.u(0.95, 1.25), shoulder, pitch, roll)
    g.s["nod"] = -g.u(0, 45) + g.wander(-5, 5, 2)
    style = g.rng.choice(["together", "split", "astride", "bent"])
    for s, _ in SIDES:
        g.s["plant" + s], g.s["contact" + s], g.s["ankle" + s] = 0.0, 0.0, g.u(10, 45)
        fore = (1 if s == g.act else -0.35) * g.wander(20, 75, 2.0)
        g.s["hip" + s] = g.wander(-3, 8, 1.5) + (fore if style == "split" else 0) + (30 if style == "bent" else 0)
        g.s["knee" + s] = g.wander(0, 12, 1.5) + (g.wander(30, 90, 1.8) if style == "bent" else 0)
        g.s["abd" + s] = g.wander(-4, 4, 1.5) + (g.wander(15, 50, 1.8) if style == "astride" else 0)
        g.s["flex" + s], g.s["out" + s], g.s["elbow" + s] = 174.0, 8.0, 6.0
    g.s["lateral"] = g.wander(-3, 3, 1.5)


def cartwheel(g: Stage) -> None:
    """Cartwheels to a side, arms and legs spread, from standing and to standing."""
    g.stance(g.width * 2.2, 0.0, 20)
    take, sign, begin = g.u(1.1, 1.7), 1.0 if g.act == "L" else -1.0, g.u(0.3, 0.8)
    turned, raised = np.zeros(len(g.t)), np.zeros(len(g.t))
    while begin < g.end - 0.4:
        turned = turned + ease((g.t - begin) / take)
        raised = raised + ease((g.t - begin + 0.6) / 0.6) * (1 - ease((g.t - begin - take) / 0.6))
        begin += take + g.u(1.3, 2.2)
    g.s["roll"] = sign * 360 * turned + g.wander(-2, 2, 2)
    far = g.u(1.15, 1.35) * g.solver.k.height
    g.s["x"], g.s["height"] = sign * far * turned, 0.95
    phase = np.mod(turned, 1.0)
    wheel = ease(phase / 0.06) * ease((1 - phase) / 0.06) * ((phase > 0) & (phase < 1))
    spread, out = g.u(28, 48), g.u(148, 162)
    g.s["ground"], g.s.settling = 1.0, 0.025  # a wheel of stiff spokes would jolt: the arms and legs give way
    for s, _ in SIDES:
        g.s["plant" + s], g.s["contact" + s] = 0.0, 0.0
        g.s["abd" + s], g.s["hip" + s] = 14 + (spread - 14) * wheel, g.wander(0, 8, 1)
        g.s["knee" + s], g.s["ankle" + s] = 4 + g.wander(0, 6, 1), 30 * wheel
        g.s["out" + s], g.s["flex" + s] = 16 + (out - 16) * raised, g.wander(-6, 8, 1)
        g.s["elbow" + s], g.s["curl" + s], g.s["wrist" + s] = 6.0, 0.0, -20.0
    g.s["nod"] = g.wander(-20, 5, 1.5)


def somersault(g: Stage) -> None:
    """Jumps in which the body turns over, tucked, forward or backward; low ones stay jumps."""
    jump(g, (0.5, 0.7))
    way = 1.0 if g.u(0, 1) < 0.4 else -1.0
    for a, b in g.s.flights:
        start, end = float(g.t[a]), float(g.t[b])
        if end - start < 0.44:
            continue
        phase = (g.t - start) / (end - start)
        over = np.clip((phase - 0.18) / 0.64, 0, 1)  # legs first leave the floor, then the trunk turns
        g.s["pitch"] = g.s["pitch"] + way * 360 * (over**2 * (3 - 2 * over) - (phase >= 1))
        free = ease(phase / 0.25) * ease((1 - phase) / 0.25)
        tuck = ease((phase - 0.1) / 0.45) * ease((0.9 - phase) / 0.45)
        for s, _ in SIDES:
            g.s["plant" + s] = np.where((phase > 0) & (phase < 1), 1 - free, g.s["plant" + s])
            for name, there in (("hip", 100.0), ("knee", 120.0), ("flex", 55.0), ("elbow", 60.0)):
                g.s[name + s] = g.s[name + s] * (1 - tuck) + there * tuck
        g.s["lean"] = g.s["lean"] + 25 * tuck
