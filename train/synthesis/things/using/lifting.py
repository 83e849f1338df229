"""People who lift and hold things: boxes, weights, bars, balls, rackets, tools."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, rot, unit
from muybridge.train.synthesis.things.objects import seats, sport
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import HIPS, SIGN, Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, gesture, hang
from muybridge.train.synthesis.things.using.sitting import ahead, left
from muybridge.train.synthesis.things.using.standing import Stance, stand_to


def box_lifter(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who lifts a box from the floor, or carries it."""
    f = Figure(body, rng)
    case = sport.carton(rng, float(np.clip(f.k, 0.6, 1.1)))
    deep = case.spots["top"].size[1]
    high = f.u(0, 0.25) if rng.random() < 0.4 else f.u(0.35, 0.85)
    at = np.array([0, -(0.16 * f.k + deep / 2 + f.u(0.02, 0.15)), high * f.skeleton.height * 0.9])
    case = case.placed(rng.normal(0, 6), at)
    # From below, or at the sides.
    name = "under" if rng.random() < 0.4 and high > 0.3 else "side"
    targets = {s: case.spots[name + s].at for s, _ in SIDES}
    stand_to(f, np.zeros(3), 0.0, targets, f.u(0.75, 0.95), f.rng.normal(0, 0.1), f.u(1.0, 1.9))
    for s, sign in SIDES:
        back = case.spots[name + s].normal
        f.hand(s, targets[s], back=back, elbow=(sign * 0.6, 0.5, -0.6), grip="relaxed")
    return Scene("box", posed(f), (case.thing(),))


def barbell_lifter(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a barbell: on or over the floor, at the hips, on the shoulders, overhead."""
    f, bar = Figure(body, rng, (0.6, 0.95)), sport.barbell(rng)
    wide, style = f.u(0.24, 0.42) * f.k, rng.random()
    if style < 0.45:
        z = f.u(0.2, 0.95) * float(f.skeleton.rest[0, 2])
        place = np.array([0, -f.u(0.13, 0.2) * f.k, z])
        targets = {s: place + [sign * wide, 0, 0] for s, sign in SIDES}
        stand_to(f, np.zeros(3), 0.0, targets, 0.985, width=f.u(1, 1.7), bends=(-4, 88))
        elbow: tuple[float, float, float] = (0.3, 0.9, 0.1)
    else:
        stance = Stance(f, np.zeros(3), 0.0, f.u(1.2, 2.2))
        crouch = f.u(0, 0.42) * f.k if rng.random() < 0.6 else 0.0
        bend = 90 * crouch / f.k if style < 0.75 else 30 * crouch / f.k
        f.trunk(0.0, pitch=0.55 * bend, lean=0.45 * bend, vary=0.3)
        stance.plant(crouch)
        neck, shoulder = f.at("neck01"), f.at("upperarm01.L")
        elbow = (0.5, 0.5, -0.8)
        if style < 0.7:
            place = neck - ahead(f) * 0.075 * f.k - UP * 0.045 * f.k
        elif style < 0.8:
            place, elbow = neck + ahead(f) * 0.09 * f.k - UP * 0.06 * f.k, (0.3, -0.9, -0.3)
        else:
            long = f.upper_arm + f.forearm + 0.05 * f.k
            place = np.array([0, neck[1], shoulder[2] + f.u(0.3, 0.93) * long])
        place[0] = 0.0
        targets = {s: place + [sign * max(wide, 0.3 * f.k), 0, 0] for s, sign in SIDES}
    f.head(-0.5 * f.bent, 0, 0)
    for s, sign in SIDES:
        f.hand(s, targets[s], axis=(1, 0, 0), elbow=np.array(elbow) * [sign, 1, 1])
    return Scene("barbell", posed(f), (bar.carried(rot(0, rng.uniform(0, 90)), place).thing(),))


def bench_presser(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on the back on a bench with a barbell or dumbbells."""
    f = Figure(body, rng, (0.6, 0.95))
    bench = seats.bench(rng, 0.85 * f.seat, f.u(1.1, 1.4)).placed(90)
    while "back" in bench.spots:
        bench = seats.bench(rng, 0.85 * f.seat, f.u(1.1, 1.4)).placed(90)
    top = bench.spots["seat"]
    f.trunk(0.0, pitch=-90, vary=0.2)
    f.root = top.at + [0, -top.size[0] / 2 + 0.12 * f.k, 0.11 * f.k]
    f.lie_on(top, *HIPS, "spine", "clavicle")
    for s, sign in SIDES:
        ground = np.array([sign * f.u(0.2, 0.3) * f.k, f.root[1] - (f.thigh + f.u(-0.2, 0.02) * f.k), 0])
        f.foot(s, ground, sign * 15, knee_out=10)
    press, wide = f.u(0.3, 0.93), f.u(0.28, 0.45) * f.k
    chest = (f.at("upperarm01.L") + f.at("upperarm01.R")) / 2
    place = chest + [0, -0.06 * f.k, press * (f.upper_arm + f.forearm)]
    for s, sign in SIDES:
        f.hand(s, place + [sign * wide, 0, 0], axis=(1, 0, 0), elbow=(sign * 0.9, 0, -0.5))
    things = [sport.barbell(rng).carried(np.eye(3), place)]
    if rng.random() < 0.35:
        seed = int(rng.integers(1 << 31))
        things = [
            sport.dumbbell(np.random.default_rng(seed)).carried(np.eye(3), place + [sign * wide, 0, 0])
            for _, sign in SIDES
        ]
    return Scene("bench press", posed(f), tuple(b.thing() for b in (bench, *things)))


def dumbbell_lifter(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who stands with dumbbells or kettlebells."""
    f = Figure(body, rng)
    stance = Stance(f, np.zeros(3), 0.0, f.u(1, 1.8), rng.normal(0, 0.15))
    crouch = max(0.0, rng.normal(0, 0.15)) * f.k
    f.trunk(0.0, pitch=60 * crouch, lean=f.u(0, 25))
    stance.plant(crouch)
    seed, things = int(rng.integers(1 << 31)), []
    for s, _ in SIDES:
        f.arm(s, f.u(-10, 160), f.u(5, 90), f.u(5, 120), f.u(-30, 30))
        turned, at = f.grip(s)
        turned = turned @ np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
        things.append(sport.dumbbell(np.random.default_rng(seed)).carried(turned, at).thing())
    return Scene("dumbbell", posed(f), tuple(things))


def puller(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who hangs from a bar."""
    f = Figure(body, rng)
    wide = f.u(0.16, 0.34) * f.k
    f.trunk(rng.normal(0, 4), pitch=f.u(-8, 8), lean=f.u(-6, 8))
    bend = f.u(0, 100)
    for s in "LR":
        f.leg(s, f.u(-5, 12) + 0.6 * max(0.0, bend - 60), bend + f.rng.normal(0, 4), out=f.u(-3, 6), ankle=f.u(0, 40))
    f.move((0, 0, f.u(0.05, 0.5) - float(f.skin()[:, 2].min())))
    shoulders = (f.at("upperarm01.L") + f.at("upperarm01.R")) / 2
    long = f.upper_arm + f.forearm + 0.08 * f.k
    place = shoulders + ahead(f) * f.u(0.02, 0.12) * f.k + UP * f.u(0.3, 0.97) * np.sqrt(long**2 - wide**2 * 0.3)
    bar = sport.pull_up_bar(rng, float(place[2])).placed(f.yaw, place * [1, 1, 0])
    for s, sign in SIDES:
        f.hand(s, place + left(f) * sign * wide, axis=left(f), elbow=(sign * 0.9, 0.1, -0.5))
    f.head(-f.u(0, 30), 0, 0)
    return Scene("pull-up bar", posed(f), (bar.thing(),))


def _athlete(f: Figure) -> None:
    """A standing, lunging or leaning player."""
    stance = Stance(f, np.zeros(3), 0.0, f.u(1.0, 2.6), f.u(-0.5, 0.5) * f.k)
    bend = f.u(0, 45)
    f.trunk(f.rng.normal(0, 15), pitch=0.5 * bend, roll=f.rng.normal(0, 5), lean=0.5 * bend, twist=f.rng.normal(0, 18))
    stance.plant(f.u(0, 0.22) * f.k)


def racket_player(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a racket or a bat, and a ball."""
    f = Figure(body, rng)
    _athlete(f)
    side, _ = SIDES[int(rng.random() < 0.85)]
    for s, _ in SIDES:
        f.arm(s, f.u(-30, 165), f.u(5, 90), f.u(10, 110), f.u(-40, 40))
    turned, at = f.grip(side)
    things = [sport.racket(rng).carried(turned, at)]
    if rng.random() < 0.5:
        where = f.root + ahead(f) * f.u(0.2, 0.9) + left(f) * f.u(-0.8, 0.8) + UP * f.u(-0.5, 1.0)
        things.append(sport.ball(rng).placed(0, where))
    return Scene("racket", posed(f), tuple(b.thing() for b in things))


def ball_player(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who holds, throws or heads a ball, or has a foot on it."""
    f, ball = Figure(body, rng), sport.ball(rng)
    while ball.spots["middle"].size[0] < 0.09:
        ball = sport.ball(rng)
    r, style = ball.spots["middle"].size[0], rng.random()
    _athlete(f)
    if style < 0.6:
        chest = f.at("spine02")
        place = chest + ahead(f) * f.u(0.25, 0.42) * f.k + UP * f.u(-0.25, 0.55) * f.k + left(f) * f.u(-0.15, 0.15)
        for s, sign in SIDES:
            way = unit(left(f) * sign * 0.9 - ahead(f) * f.u(0.0, 0.4) - UP * f.u(-0.2, 0.3))
            f.hand(s, place + way * r, back=way, elbow=(sign * 0.8, 0.2, -0.5), grip="relaxed")
    elif style < 0.8:
        side, sign = SIDES[int(rng.integers(2))]
        f.arm(side, f.u(20, 165), f.u(10, 80), f.u(5, 90))
        turned, at = f.grip(side)
        place = at - turned[:, 2] * (r - 0.02)
        (hang if rng.random() < 0.5 else gesture)(f, "LR".replace(side, ""))
    else:
        side, sign = SIDES[int(rng.integers(2))]
        place = f.root * [1, 1, 0] + ahead(f) * f.u(0.2, 0.45) + left(f) * sign * 0.1 + UP * r
        if rng.random() < 0.5:
            f.foot(side, place + UP * r, f.yaw, -10, part="ball")
        for s, _ in SIDES:
            f.arm(s, f.u(-20, 40), f.u(10, 60), f.u(10, 80))
    return Scene("ball", posed(f), (ball.placed(rng.uniform(0, 90), place).thing(),))


def tool_user(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a broom, a spade, a rake, or a tool in one hand."""
    f, tool = Figure(body, rng), sport.tool(rng)
    if tool.kind == "hand tool":
        _athlete(f)
        side, _ = SIDES[int(rng.random() < 0.85)]
        f.arm(side, f.u(0, 120), f.u(5, 50), f.u(30, 110))
        hang(f, "LR".replace(side, ""))
        turned, at = f.grip(side)
        made = tool.carried(turned @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), at)
        return Scene("tool", posed(f), (made.thing(),))
    first = "LR"[int(rng.integers(2))]
    tip = np.array([f.u(-0.25, 0.25), -f.u(0.4, 0.85), 0]) * f.k
    up = unit(np.array([f.u(-0.15, 0.15) - 0.5 * tip[0], f.u(0.15, 0.6), 1.0]))
    made = tool.carried(_upright(up), tip)
    targets = {first: made.spots["upper"].at, "LR".replace(first, ""): made.spots["lower"].at}
    stand_to(f, np.zeros(3), 0.0, targets, f.u(0.65, 0.85), split=f.u(-0.3, 0.3), width=f.u(1, 1.6))
    for s, at in targets.items():
        f.hand(s, at, axis=up, elbow=(SIGN[s] * 0.7, 0.4, -0.6))
    return Scene("tool", posed(f), (made.thing(),))


def _upright(up: FloatArray) -> FloatArray:
    """(3, 3) a turn that takes z to `up` (3,)."""
    x = unit(np.cross([0.0, 1, 0], up))
    return np.stack([x, np.cross(up, x), up], -1)
