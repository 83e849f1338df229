"""People behind, against and on things: counters, walls, cars, fences, knees on a seat; drivers."""

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.things.built import Built, Spot
from muybridge.train.synthesis.things.objects import cars, household, seats, sport, tables
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import SIGN, Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, gesture, habit, hang, on_thigh
from muybridge.train.synthesis.things.using.sitting import ahead, feet_on_rests, left, on_chair
from muybridge.train.synthesis.things.using.standing import Stance, stand_to


def standing_hands(f: Figure) -> None:
    """Hands of someone who stands about."""
    draw = f.u(0, 1)
    if draw < 0.35:
        names = ("folded", "hips", "pockets", "clasped", "behind", "holding")
        habit(f, names[int(f.rng.integers(len(names)))], "LR" if f.u(0, 1) < 0.5 else "RL")
        return
    for s in "LR":
        (gesture, hang, hang)[int(f.rng.integers(3))](f, s)


def behind(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who stands behind a counter, a table, a fence, a car or a hurdle, which hides the legs."""
    f, style = Figure(body, rng), int(rng.integers(5))
    gap = f.u(0.18, 0.4) * f.k
    if style == 0:
        block = tables.counter(rng, f.u(0.5, 0.66) * f.skeleton.height)
    elif style == 1:
        block = tables.table(rng)
    elif style == 2:
        block = household.fence(rng)
    elif style == 3:
        block = cars.car(rng).placed(90.0 * float(rng.choice([-1, 1])))
        gap += 0.9
    else:
        block = sport.hurdle(rng)
    stance = Stance(f, np.array([0, gap, 0]), rng.normal(0, 20), split=rng.normal(0, 0.12))
    f.trunk(f.yaw, lean=f.u(0, 14))
    stance.plant()
    standing_hands(f)
    return Scene("behind", posed(f), (block.thing(),))


def leaning(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who leans with the hands on a counter, a table, a fence or a car, or against a wall."""
    f, style = Figure(body, rng), rng.random()
    if style < 0.3:
        return _against_wall(f)
    if style < 0.6:
        block = tables.counter(rng, f.u(0.48, 0.68) * f.skeleton.height)
        edge = block.spots["edge"].at - [0, f.u(0.04, 0.2), 0]
    elif style < 0.8:
        block = tables.table(rng, f.u(0.4, 0.5) * f.skeleton.height)
        edge = block.spots["edge"].at - [0, f.u(0.05, 0.3), 0]
    elif style < 0.92:
        block = household.fence(rng)
        edge = block.spots["top"].at
    else:
        block = cars.car(rng).placed(90)
        edge = np.array([0, block.spots["side"].at[1] - 0.05, block.spots["side"].at[2]])
        block = block.placed(0, (0, -block.spots["side"].at[1] - 0.02, 0))
        edge[1] = -0.07
    targets = {s: edge + [sign * f.u(0.12, 0.35), 0, 0] for s, sign in SIDES}
    stand_to(f, np.array([0, f.u(0.2, 0.45) * f.k, 0]), rng.normal(0, 8), targets, f.u(0.7, 0.95), rng.normal(0, 0.15))
    for s, sign in SIDES:
        if rng.random() < 0.85:
            f.hand(s, targets[s], back=UP, elbow=(sign * 0.8, 0.5, -0.1), grip="flat")
        else:
            hang(f, s)
    return Scene("leaning", posed(f), (block.thing(),))


def _against_wall(f: Figure) -> Scene:
    """The back against a wall, or a hand on it."""
    rng, wall = f.rng, household.wall(f.rng)
    if rng.random() < 0.55:
        stance = Stance(f, np.array([0, f.u(0.1, 0.35) * f.k, 0]), 180 + rng.normal(0, 5))
        f.trunk(f.yaw, pitch=-f.u(2, 14), lean=f.u(-6, 4), vary=0.5)
        stance.plant(balance=False)
        front = Spot(np.array([0, 0, 1.0]), UP, np.array([0, 1.0, 0]), (3.0, 3.0))
        f.move(front.normal * (f.depth(front, "root", "pelvis", "spine", "clavicle", "head") - 0.015))
        stance.plant(balance=False)
        standing_hands(f)
    else:
        places = {s: np.array([sign * f.u(0.1, 0.4), 0, f.u(0.6, 0.95) * f.skeleton.height]) for s, sign in SIDES}
        stand_to(f, np.array([0, f.u(0.35, 0.6) * f.k, 0]), rng.normal(0, 10), places, 0.93, bends=(-3, 40))
        for s in "LR" if rng.random() < 0.5 else "LR"[int(rng.integers(2))]:
            f.hand(s, places[s], back=(0, 1, 0), elbow=(SIGN[s] * 0.5, 0.2, -0.8), grip="flat")
    return Scene("leaning", posed(f), (wall.thing(),))


def kneeling(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with one knee or both on a bench, a box or a cushion."""
    f, style = Figure(body, rng), int(rng.integers(3))
    low: Built = seats.cushion(rng) if style == 0 else seats.bench(rng, f.u(0.25, 0.45))
    seat = low.spots["seat"]
    both = style == 0 or rng.random() < 0.4
    bend = f.u(0, 55) if both else f.u(0, 30)
    f.trunk(rng.normal(0, 5), pitch=0.5 * bend, lean=0.5 * bend)
    near = "LR"[int(rng.integers(2))]
    for s in "LR" if both else near:
        hip = f.u(-5, 35)
        f.leg(s, hip + f.pitch, 90 + hip + f.u(-8, 10), out=f.u(0, 10), ankle=f.u(20, 55))
    f.root = seat.at + [0, 0, f.thigh + 0.06]
    f.move((0, 0, 0))
    knee = f.at("lowerleg01." + near)
    f.move(seat.at * [1, 1, 0] - knee * [1, 1, 0] + [0, -0.02, 0])
    wide = Spot(seat.at, seat.axis, seat.normal, (1.0, 1.0))
    f.lie_on(wide, *(b + s for b in ("lowerleg01.", "upperleg02.") for s in ("LR" if both else near)), soft=0.02)
    if not both:
        other = "LR".replace(near, "")
        at = f.root * [1, 1, 0] + left(f) * SIGN[other] * 0.17 * f.k + ahead(f) * f.u(-0.1, 0.3) * f.k
        if f.foot(other, at, f.yaw + 8 * SIGN[other]) > 0:
            f.foot(other, f.root * [1, 1, 0] + left(f) * SIGN[other] * 0.15 * f.k, f.yaw)
    for s, _ in SIDES:
        (gesture, hang, on_thigh)[int(rng.integers(3))](f, s)
    return Scene("kneeling", posed(f), (low.thing(),))


def driver(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone in a car's seat with the hands on the wheel, in the lap or on the door."""
    f = Figure(body, rng, (0.55, 1.0))
    inside = cars.car_inside(rng, f.k, f.u(0.5, 0.72) * f.seat)
    on_chair(f, inside, 0.0, feet_on_rests(f, inside.spots, "heel"))
    for s, sign in SIDES:
        draw = f.u(0, 1)
        wheel = inside.spots["wheel" + s]
        if draw < 0.72 and f.reach(s, wheel.at) < 1.05:
            f.hand(s, wheel.at, axis=wheel.axis, elbow=(sign * 0.7, 0.3, -0.7))
        elif draw < 0.85 and s == "L":
            f.hand(s, inside.spots["sill"].at, back=UP, elbow=(0.6, 0.7, -0.3), grip="relaxed")
        else:
            on_thigh(f, s)
    return Scene("car seat", posed(f), (inside.thing(),))
