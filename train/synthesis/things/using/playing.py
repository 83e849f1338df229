"""People who play instruments."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, unit
from muybridge.train.synthesis.things.built import Built, surface
from muybridge.train.synthesis.things.objects import music, seats
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.shapes import rod
from muybridge.train.synthesis.things.using.figure import Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, thigh_top
from muybridge.train.synthesis.things.using.sitting import Feet, ahead, feet_on_floor, left, on_chair
from muybridge.train.synthesis.things.using.standing import Stance


def _turn(y: FloatArray, z: FloatArray) -> FloatArray:
    """(3, 3) a turn that takes y to `y` and z as near to `z` as can be."""
    along = unit(y)
    out = unit(z - (z @ along) * along)
    return np.stack([np.cross(along, out), along, out], -1)


def _sit_or_stand(f: Figure, sit: float, feet: Feet | None = None) -> list[Built]:
    if f.u(0, 1) < sit:
        chair = (seats.chair, seats.stool)[int(f.rng.integers(2))](f.rng, f.u(0.92, 1.1) * f.seat)
        while "armL" in chair.spots:
            chair = seats.chair(f.rng, f.u(0.92, 1.1) * f.seat)
        on_chair(f, chair, f.u(0.45, 0.8), feet or feet_on_floor(f))
        return [chair]
    stance = Stance(f, np.zeros(3), 0.0, split=f.rng.normal(0, 0.1))
    f.trunk(f.rng.normal(0, 5), lean=f.u(0, 10))
    stance.plant()
    return []


def _with_stand(f: Figure, things: list[Built]) -> list[Built]:
    if f.u(0, 1) < 0.35:
        at = f.root * [1, 1, 0] + ahead(f) * f.u(0.7, 1.1) + left(f) * f.u(-0.3, 0.3)
        things.append(music.music_stand(f.rng).placed(f.yaw, at))
    return things


def guitarist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a guitar, seated or standing."""
    f, guitar = Figure(body, rng), music.fiddle(rng, "guitar")
    things = _sit_or_stand(f, 0.55)
    low = thigh_top(f) if things else float(f.root[2]) + f.u(-0.08, 0.08) * f.k
    size = float(np.ptp(guitar.mesh.vertices[:, 0]))
    middle = f.root + ahead(f) * (f.ahead(low, low + 0.3) + 0.07) - left(f) * 0.08 * f.k
    middle[2] = low + 0.5 * size
    turned = _turn(left(f) + UP * f.u(0.1, 0.6) + ahead(f) * f.u(0, 0.3), ahead(f) + UP * f.u(0, 0.3))
    guitar = guitar.carried(turned, middle + turned[:, 1] * 0.25)
    neck, strings = guitar.spots["neck"], guitar.spots["strings"]
    f.hand("L", neck.at - neck.normal * 0.01, axis=neck.axis, elbow=(0.6, 0.2, -0.8))
    f.hand("R", strings.at, back=strings.normal, elbow=(-0.9, 0.2, -0.1), grip="relaxed")
    f.head(f.u(0, 30) - 0.3 * f.bent, 0, f.u(-10, 40))
    return Scene("guitar", posed(f), tuple(b.thing() for b in _with_stand(f, [guitar, *things])))


def _bow(f: Figure, fiddle: Built, level: FloatArray) -> Built:
    """A bow on the strings, its grip in the right hand."""
    strings = fiddle.spots["strings"]
    way = unit(level - (level @ fiddle.spots["neck"].axis) * fiddle.spots["neck"].axis)
    grip = strings.at + strings.normal * 0.02 + way * f.u(0.08, 0.5) * f.k
    turned = np.stack([way, np.cross(strings.normal, way), strings.normal], -1)
    f.hand("R", grip, axis=way, elbow=(-0.8, 0.3, -0.3))
    # Where the hand came to: the bow is in it.
    return music.bow(f.rng).carried(turned, f.grip("R")[1])


def violinist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a violin."""
    f, violin = Figure(body, rng), music.fiddle(rng, "violin")
    things = _sit_or_stand(f, 0.35)
    f.head(f.u(0, 14) - 0.3 * f.bent, f.u(0, 16), f.u(15, 45))
    turned = _turn(left(f) * f.u(0.5, 0.9) + ahead(f) * 0.8 + UP * f.u(-0.2, 0.15), UP + left(f) * -0.25)
    length = float(np.linalg.norm(violin.spots["tail"].at))
    tail = f.at("neck01", (0.075, -0.05, 0.0))
    violin = violin.carried(turned, tail + turned[:, 1] * length)
    neck = violin.spots["neck"]
    f.hand("L", neck.at - neck.normal * 0.02, axis=neck.axis, elbow=(0.4, -0.2, -1))
    bow = _bow(f, violin, -left(f) + ahead(f) * 0.5 - UP * 0.2)
    return Scene("violin", posed(f), tuple(b.thing() for b in _with_stand(f, [violin, bow, *things])))


def cellist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone with a cello between the knees."""
    f, cello = Figure(body, rng), music.fiddle(rng, "cello")

    def feet() -> None:
        for s, sign in SIDES:
            at = f.root * [1, 1, 0] + ahead(f) * 0.95 * f.thigh + left(f) * sign * 0.3 * f.k
            f.foot(s, at, f.yaw + 28 * sign, knee_out=22)

    things = _sit_or_stand(f, 1.0, feet)
    pin = f.root * [1, 1, 0] + ahead(f) * (f.thigh + 0.18 * f.k)
    neck_by = f.at("neck01", (0.1, -0.12, 0.05))
    chest = neck_by - (neck_by - pin) * 0.12
    turned = _turn(chest - pin, ahead(f) + left(f) * -0.2)
    length = float(np.linalg.norm(cello.spots["foot"].at))
    cello = cello.carried(turned, pin + turned[:, 1] * length)
    neck = cello.spots["neck"]
    f.hand("L", neck.at - neck.normal * 0.02, axis=neck.axis, elbow=(0.9, 0.1, -0.3))
    bow = _bow(f, cello, -left(f))
    return Scene("cello", posed(f), tuple(b.thing() for b in _with_stand(f, [cello, bow, *things])))


def drummer(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone at drums, with sticks or bare hands."""
    f = Figure(body, rng)
    things = _sit_or_stand(f, 0.75)
    top = thigh_top(f) + f.u(0.0, 0.12) if things else f.u(0.5, 0.56) * f.skeleton.height
    gap = f.ahead(top - 0.15, top + 0.15) + (f.thigh * 0.5 if things else f.u(0.0, 0.1))
    kit = music.drum(rng, top).placed(f.yaw, (f.root + ahead(f) * gap) * [1, 1, 0])
    heads = [s.at for s in kit.spots.values()]
    sticks = rng.random() < 0.75
    made = [kit, *things]
    for s, sign in SIDES:
        head = min(heads, key=lambda at: float(np.linalg.norm(at - f.at("upperarm01." + s))))
        place = head + UP * (f.u(0.06, 0.4) if sticks else f.u(0.0, 0.2)) + left(f) * sign * f.u(0.02, 0.14)
        if sticks:
            f.hand(s, place - ahead(f) * 0.3, elbow=(sign * 0.8, 0.4, -0.5), axis=ahead(f) + left(f) * -sign * 0.4)
            turned, at = f.grip(s)
            stick = Built("drumstick", rod((0, 0.08, 0), (0, -0.33, 0), 0.008, surface(rng, "wood")), {})
            made.append(stick.carried(turned, at))
        else:
            f.hand(s, place, back=UP, elbow=(sign * 0.8, 0.4, -0.5), grip="flat")
    f.head(f.u(0, 30) - 0.3 * f.bent, 0, f.rng.normal(0, 15))
    return Scene("drum", posed(f), tuple(b.thing() for b in made))


def pianist(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone at a piano or a keyboard."""
    f = Figure(body, rng)
    things = _sit_or_stand(f, 0.85)
    top = max(thigh_top(f) + 0.12, f.u(0.62, 0.74)) if things else f.u(0.53, 0.58) * f.skeleton.height
    gap = f.ahead(top - 0.15, top + 0.15) + f.u(0.08, 0.2) * f.k
    made = music.piano(rng, top).placed(f.yaw, (f.root + ahead(f) * gap) * [1, 1, 0])
    keys = made.spots["keys"]
    for s, sign in SIDES:
        place = keys.at + left(f) * (sign * f.u(0.04, 0.3)) + ahead(f) * f.u(-0.04, 0.02)
        f.hand(s, place + UP * 0.015, back=UP, elbow=(sign * 0.7, 0.5, -0.4), grip="relaxed")
    f.head(f.u(5, 30) - 0.3 * f.bent, 0, f.rng.normal(0, 12))
    return Scene("piano", posed(f), (made.thing(), *(b.thing() for b in things)))
