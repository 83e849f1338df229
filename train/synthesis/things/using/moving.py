"""People who walk with things: on treadmills, with walkers, crutches and canes, prams and dogs, behind wheelchairs."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, between, turn
from muybridge.train.synthesis.things.built import Built, Spot, surface
from muybridge.train.synthesis.things.objects import animals, mobility, sport
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.shapes import tube
from muybridge.train.synthesis.things.using.figure import Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, seated_hands
from muybridge.train.synthesis.things.using.sitting import in_wheelchair
from muybridge.train.synthesis.things.using.standing import Stance, bend_to, stride


def hold(f: Figure, spots: dict[str, Spot], name: str, elbow: tuple[float, float, float] = (0.4, 0.7, -0.6)) -> None:
    """Both hands on the handles `name` L and R."""
    for s, sign in SIDES:
        grip = spots[name + s]
        f.hand(s, grip.at, axis=grip.axis, elbow=np.array(elbow) * [sign, 1, 1])


def runner(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who walks or runs on a treadmill, holding its rails now and then."""
    f = Figure(body, rng)
    mill = sport.treadmill(rng, float(f.skeleton.rest[0, 2]) * f.u(0.95, 1.12))
    run = rng.random() < 0.5
    deck = mill.spots["deck"]
    stride(f, deck.at + [rng.normal(0, 0.03), rng.uniform(-0.22, 0.2) * deck.size[1], 0], rng.normal(0, 3), run)
    rails = {s: mill.spots["rail" + s] for s, _ in SIDES}
    for s, rail in rails.items():
        if not run and rng.random() < 0.45:
            place = rail.at * [1, 0, 1] + np.array([0, np.clip(f.root[1] - 0.25 * f.k, *_along(mill)), 0])
            if f.reach(s, place) < 1.0:
                f.hand(s, place, axis=rail.axis)
    return Scene("treadmill", posed(f), (mill.thing(),))


def _along(mill: Built) -> tuple[float, float]:
    y = float(mill.spots["railL"].at[1])
    return y - 0.15, y + 0.15


def walker_user(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a walking frame or a rollator."""
    f = Figure(body, rng, (0.6, 1.0))
    frame = mobility.walker(rng, f.u(0.47, 0.54) * f.skeleton.height)
    at = np.array([rng.normal(0, 0.02), f.u(0.1, 0.35) * f.k, 0])
    _walk_or_stand(f, at, {s: frame.spots["grip" + s].at for s, _ in SIDES}, f.u(0.75, 0.93))
    hold(f, frame.spots, "grip")
    return Scene("walker", posed(f), (frame.thing(),))


def _walk_or_stand(f: Figure, at: FloatArray, targets: dict[str, FloatArray], want: float, yaw: float = 0.0) -> None:
    if f.u(0, 1) < 0.6:
        stride(f, at, yaw)
        bend_to(f, yaw, targets, want, (-2, 55), 0.35)
    else:
        stance = Stance(f, at, yaw, split=f.rng.normal(0, 0.15))
        stance.plant()
        bend_to(f, yaw, targets, want, (-2, 55), 0.35)
        stance.plant()


def crutch_user(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on crutches, or with a cane."""
    f = Figure(body, rng)
    if rng.random() < 0.65:
        stride(f, np.zeros(3), rng.normal(0, 5))
    else:
        stance = Stance(f, np.zeros(3), 0.0)
        f.trunk(0.0, pitch=f.u(0, 8), lean=f.u(0, 14))
        stance.plant()
    sides = "LR" if rng.random() < 0.75 else "LR"[int(rng.integers(2))]
    things = []
    seed = int(rng.integers(1 << 31))
    for s, sign in SIDES:
        if s not in sides:
            continue
        grip = np.array([sign * f.u(0.2, 0.28), -f.u(-0.02, 0.2), 0.0]) * f.k + f.root * [1, 1, 0]
        grip[2] = f.u(0.45, 0.5) * f.skeleton.height
        tip = grip * [1, 1, 0] + np.array([sign * f.u(0.0, 0.12), -f.u(-0.1, 0.22), 0]) * f.k
        turned = turn(between(np.array([0, 0, 1.0]), grip - tip))
        # Both are of one pair.
        stick = mobility.crutch(np.random.default_rng(seed), float(np.linalg.norm(grip - tip))).carried(turned, tip)
        handle = stick.spots["grip"]
        f.hand(s, handle.at, axis=handle.axis, elbow=(sign * 0.4, 0.9, -0.3))
        things.append(stick.thing())
    return Scene("crutches", posed(f), tuple(things))


def pram_pusher(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone who pushes a pram."""
    f = Figure(body, rng, (0.6, 0.95))
    pram = mobility.pram(rng, f.u(0.54, 0.64) * f.skeleton.height)
    at = np.array([0, f.u(0.28, 0.5) * f.k, 0])
    _walk_or_stand(f, at, {s: pram.spots["grip" + s].at for s, _ in SIDES}, f.u(0.7, 0.9))
    hold(f, pram.spots, "grip", (0.7, 0.4, -0.6))
    return Scene("pram", posed(f), (pram.thing(),))


def wheelchair_pushed(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone in a wheelchair whom another person pushes."""
    f, other = Figure(body, rng), Figure(body, rng, (0.6, 0.95))
    chair = in_wheelchair(f)
    while "pushL" not in chair.spots or "pushR" not in chair.spots:
        chair = in_wheelchair(f)
    seated_hands(f, chair.spots)
    grips = {s: chair.spots["push" + s].at for s, _ in SIDES}
    at = np.array([0, float(grips["L"][1]) + other.u(0.28, 0.5) * other.k, 0])
    _walk_or_stand(other, at, grips, other.u(0.75, 0.92))
    hold(other, chair.spots, "push", (0.6, 0.6, -0.5))
    return Scene("wheelchair pushed", posed(f, other), (chair.thing(),))


def dog_walker(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a dog or a horse on a lead."""
    f = Figure(body, rng)
    stride(f, np.zeros(3), rng.normal(0, 5))
    side, sign = SIDES[int(rng.integers(2))]
    f.arm(side, f.u(0, 40), f.u(5, 25), f.u(10, 80))
    if rng.random() < 0.75:
        beast = animals.dog(rng).placed(rng.normal(0, 40), (sign * f.u(0.35, 0.9), -f.u(-0.3, 1.1), 0))
        to = beast.spots["collar"].at
    else:
        beast = animals.horse(rng).placed(rng.normal(0, 12), (sign * f.u(0.85, 1.2), f.u(0.3, 1.0), 0))
        to = beast.spots["halter"].at
    _, hand = f.grip(side)
    t = np.linspace(0, 1, 8)[:, None]
    line = hand + (to - hand) * t - UP * 0.25 * t * (1 - t) * f.u(0.1, 1)
    lead = Built("lead", tube(line, 0.006, surface(rng, "leather", "paint"), 5), {})
    return Scene("dog", posed(f), (beast.thing(), lead.thing()))
