"""Riders: on bicycles, on rollers, on motorbikes and horses."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.things.built import Built, Spot
from muybridge.train.synthesis.things.objects import animals, cycles
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, gesture, on_thigh
from muybridge.train.synthesis.things.using.sitting import Feet
from muybridge.train.synthesis.things.using.standing import bend_to


def mount(f: Figure, saddle: Spot, feet: Feet, grips: dict[str, FloatArray], want: float, bends: tuple[float, float],
          share: float = 0.6, soft: float = 0.03) -> None:  # fmt: skip
    """Put a person on a saddle, facing -y, bent so that the hands reach the grips."""
    f.root = saddle.at + UP * 0.1 * f.k
    for _ in range(2):
        bend_to(f, f.rng.normal(0, 2), grips, want, bends, share)
        for _ in range(2):
            feet()
            f.lie_on(saddle, "root", "pelvis", soft=soft)
    feet()


def _grip(f: Figure, grips: dict[str, Spot], elbow: tuple[float, float, float] = (0.5, 0.5, -0.7)) -> None:
    free = f.u(0, 1) < 0.12
    idle = "LR"[int(f.rng.integers(2))]
    for s, sign in SIDES:
        if free and s == idle:
            (gesture if f.u(0, 1) < 0.6 else on_thigh)(f, s)
        else:
            f.hand(s, grips[s].at, axis=grips[s].axis, elbow=np.array(elbow) * [sign, 1, 1])


def ride_bicycle(f: Figure, rollers: bool) -> Built:
    """Put a person on a bicycle of a fitting size."""
    rng, leg = f.rng, f.thigh + f.shank
    size = float(np.clip(f.k, 0.6, 1.08))
    fit = cycles.Fit(f.u(0.9, 0.98) * leg + 0.03 * f.k - 0.172 * size, f.u(0.38, 0.6) * f.k, f.u(-0.1, 0.2) * f.k, size)
    bike = cycles.bicycle(rng, fit)
    if rollers:
        bike = cycles.on_rollers(rng, bike)
    tip = f.u(4, 26)

    def pedal() -> None:
        for s, sign in SIDES:
            f.foot(s, bike.spots["pedal" + s].at, sign * 3.0, tip, knee_out=1.0)

    grips = {s: bike.spots["grip" + s] for s, _ in SIDES}
    mount(f, bike.spots["saddle"], pedal, {s: g.at for s, g in grips.items()}, f.u(0.8, 0.95), (0, 72), 0.55)
    out_of_saddle = f.u(0, 1) < 0.12
    if out_of_saddle:
        f.move((0, -f.u(0.08, 0.2) * f.k, f.u(0.05, 0.12) * f.k))
        pedal()
    _grip(f, grips)
    return bike


def cyclist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on a bicycle."""
    f = Figure(body, rng)
    bike = ride_bicycle(f, False)
    return Scene("bicycle", posed(f), (bike.thing(),))


def cyclist_on_rollers(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on a bicycle that stands on rollers or in a trainer."""
    f = Figure(body, rng)
    bike = ride_bicycle(f, True)
    return Scene("bicycle on rollers", posed(f), (bike.thing(),))


def motorcyclist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on a motorbike or a scooter; a foot on the ground now and then."""
    f = Figure(body, rng, (0.55, 1.0))
    bike = cycles.motorbike(rng, f.u(0.88, 1.05) * (f.seat + 0.28 * f.k), float(np.clip(f.k, 0.85, 1.1)))
    grounded = [s for s, _ in SIDES if f.u(0, 1) < 0.25]

    def rest() -> None:
        for s, sign in SIDES:
            at = bike.spots["foot" + s].at
            if s in grounded:
                f.foot(s, np.array([sign * 0.38, at[1] - 0.08, 0.0]), sign * 15, knee_out=15)
            else:
                f.foot(s, at, sign * 8, knee_out=16, part="middle")

    grips = {s: bike.spots["grip" + s] for s, _ in SIDES}
    mount(f, bike.spots["saddle"], rest, {s: g.at for s, g in grips.items()}, f.u(0.8, 0.94), (-4, 60), 0.5)
    _grip(f, grips, (0.8, 0.4, -0.4))
    return Scene("motorbike", posed(f), (bike.thing(),))


def horse_rider(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on a horse or a pony."""
    f = Figure(body, rng)
    leg = f.thigh + f.shank
    horse = animals.horse(rng, f.u(0.75, 1.0) * f.skeleton.height, f.u(0.68, 0.9) * leg)
    knees, heels = f.u(12, 28), f.u(-12, -2)

    def rest() -> None:
        for s, sign in SIDES:
            f.foot(s, horse.spots["stirrup" + s].at, sign * 14, heels, knee_out=knees)

    reins = {s: horse.spots["rein" + s] for s, _ in SIDES}
    mount(f, horse.spots["saddle"], rest, {s: g.at for s, g in reins.items()}, f.u(0.55, 0.75), (-6, 35), 0.3, 0.04)
    _grip(f, reins, (0.35, 0.6, -0.7))
    return Scene("horse", posed(f), (horse.thing(),))
