"""People on seats: alone, in wheelchairs, at tables and desks."""

from collections.abc import Callable

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, rot
from muybridge.train.synthesis.things.built import Built, Spot
from muybridge.train.synthesis.things.objects import seats, tables
from muybridge.train.synthesis.things.objects.mobility import wheelchair
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.shapes import Mesh
from muybridge.train.synthesis.things.using.figure import HIPS, Figure, posed
from muybridge.train.synthesis.things.using.hands import on_top, seated_hands, thigh_top

Feet = Callable[[], None]
UP = np.array([0.0, 0.0, 1.0])


def yaw_of(axis: FloatArray) -> float:
    """Degrees by which someone who faces -y turns to face along `axis` (3,)."""
    return float(np.degrees(np.arctan2(axis[0], -axis[1])))


def ahead(f: Figure) -> FloatArray:
    """(3,) where the person's pelvis faces, level."""
    return np.asarray(-rot(2, f.yaw)[:, 1])


def left(f: Figure) -> FloatArray:
    """(3,) to the person's left, level."""
    return np.asarray(rot(2, f.yaw)[:, 0])


def feet_on_floor(f: Figure, floor: float = 0.0, forward: tuple[float, float] = (-0.12, 0.3)) -> Feet:
    """Feet before a seat, at one height; they hang where the floor is too far. Drawn once, planted at each call."""
    wide, crossed = f.u(0.4, 1.6), f.u(0, 1) < 0.1
    plan = {s: (f.u(*forward), f.u(0.85, 1.15), f.u(-4, 20), f.u(0, 1)) for s, _ in SIDES}
    together = plan["L"][0]

    def plant() -> None:
        for s, sign in SIDES:
            far, width, out, tip = plan[s]
            far = together + 0.35 * (far - together)
            aside = (-0.06 if crossed else 0.1 * wide * width) * f.k
            knee = f.root + ahead(f) * (f.thigh + far * f.k) + left(f) * sign * aside
            at = np.array([*knee[:2], floor])
            pitch = 30.0 * (tip - 0.8) / 0.2 if tip > 0.8 else 0.0
            if f.foot(s, at, f.yaw + sign * out, pitch, knee_out=out * 0.5 + (wide - 0.8) * 12) > 0.02:
                f.leg(s, 84 + f.pitch, 60 + 40 * tip, out=6 * wide, ankle=18)

    return plant


def settle(f: Figure, seat: Spot, feet: Feet, perch: float = 0.0, back: Spot | None = None) -> None:
    """Put a person whose trunk is posed onto a seat.

    Args:
        f: the person.
        seat: where.
        feet: puts the feet where they belong.
        perch: metres between the seat's rear edge and the buttocks.
        back: a back rest that the trunk stays before.
    """
    f.root = seat.at + seat.axis * (0.14 * f.k + perch - seat.size[1] / 2) + UP * 0.11 * f.k
    f.move((0, 0, 0))
    for _ in range(3):
        feet()
        f.lie_on(seat, *HIPS)
        if back is not None:
            depth = f.depth(back, "root", "pelvis", "spine", "clavicle", margin=0.05)
            if depth > 0.012:
                f.move(ahead(f) * (depth - 0.012))
    feet()


def clear_floor(f: Figure, floor: float = 0.0) -> None:
    """Lift what is below the floor."""
    low = float(f.skin()[:, 2].min()) - floor
    if low < -0.02:
        f.move((0, 0, -low - 0.02))


def on_chair(f: Figure, chair: Built, lean_back: float | None = None, feet: Feet | None = None) -> None:
    """Sit on a chair, upright, leaning back or bent forward."""
    seat, back = chair.spots["seat"], chair.spots.get("back")
    style = f.u(0, 1) if lean_back is None else lean_back
    yaw = yaw_of(seat.axis) + f.rng.normal(0, 5)
    room = max(0.0, seat.size[1] - 0.3 * f.k)
    if style < 0.45 and back is not None:
        f.trunk(yaw, pitch=f.u(-16, -4), lean=f.u(-2, 10))
        perch = f.u(0, 0.08)
    elif style < 0.8:
        f.trunk(yaw, pitch=f.u(-8, 6), roll=f.rng.normal(0, 2), lean=f.u(0, 18))
        perch = f.u(0, 1) * room
    else:
        f.trunk(yaw, pitch=f.u(0, 14), lean=f.u(18, 45))
        perch = f.u(0.3, 1) * room
    rests = [chair.spots.get("foot" + s) for s, _ in SIDES]
    if feet is None and rests[0] is not None and rests[1] is not None:
        feet = feet_on_rests(f, chair.spots)
    settle(f, seat, feet or feet_on_floor(f), perch, back)


def feet_on_rests(f: Figure, spots: dict[str, Spot], part: str = "middle") -> Feet:
    """Feet on the thing's places for them."""
    out = f.u(0, 12)

    def plant() -> None:
        for s, sign in SIDES:
            f.foot(s, spots["foot" + s].at, f.yaw + sign * out, knee_out=2.0, part=part)

    return plant


def _seat_for(f: Figure, name: str) -> Built:
    rng, fit = f.rng, f.u(0.86, 1.12) * f.seat
    if name == "chair":
        return seats.chair(rng, fit)
    if name == "office chair":
        return seats.office_chair(rng, fit)
    if name == "stool":
        return seats.stool(rng, None if f.u(0, 1) < 0.5 else fit)
    if name == "bench":
        return seats.bench(rng, fit)
    if name == "sofa":
        return seats.sofa(rng, 0.92 * fit)
    if name == "ball":
        return seats.exercise_ball(rng, fit)
    return seats.cushion(rng)


def seated(*names: str) -> Callable[[BodyModel, np.random.Generator], Scene]:
    """A maker of scenes of someone on a seat, one of `names`."""

    def make(body: BodyModel, rng: np.random.Generator) -> Scene:
        f = Figure(body, rng)
        chair = _seat_for(f, names[int(rng.integers(len(names)))])
        on_chair(f, chair)
        seated_hands(f, chair.spots)
        return Scene(chair.kind, posed(f), (chair.thing(),))

    return make


def floor_seat(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone on a cushion or a low block, legs crossed, drawn up or stretched out."""
    f, pad = Figure(body, rng), seats.cushion(rng)
    seat, style = pad.spots["seat"], rng.random()
    f.trunk(yaw_of(seat.axis) + rng.normal(0, 8), pitch=rng.uniform(-14, 2), lean=rng.uniform(0, 30))
    drawn = (rng.uniform(0.42, 0.6), rng.uniform(0.62, 0.8), rng.uniform(0.9, 1.0))[int(3 * style)] * (
        f.thigh + f.shank
    )

    def plant() -> None:
        for s, sign in SIDES:
            aside = (-0.08 if style < 1 / 3 else 0.14) * sign * f.k
            at = f.root * [1, 1, 0] + ahead(f) * drawn + left(f) * aside
            if style < 1 / 3:
                f.foot(s, at + [0, 0, 0.02 * f.k], f.yaw + 40 * sign, 30, knee_out=68)
            else:
                f.foot(s, at, f.yaw + 8 * sign, -60 if style > 2 / 3 else 0, part="heel" if style > 2 / 3 else "ball")

    settle(f, seat, plant, perch=rng.uniform(0, 0.05))
    seated_hands(f, {})
    return Scene("floor cushion", posed(f), (pad.thing(),))


def in_wheelchair(f: Figure) -> Built:
    """Seat a person in a wheelchair; hands are left."""
    chair = wheelchair(f.rng, max(0.4, f.seat + f.u(-0.02, 0.08)), f.u(0.38, 0.48), f.u(0.38, 0.46))
    on_chair(f, chair, f.u(0, 0.75), feet_on_rests(f, chair.spots))
    return chair


def wheelchair_user(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone in a wheelchair with hands on the rims, on arm rests, or in the lap; pushed by somebody now and then."""
    f = Figure(body, rng)
    chair = in_wheelchair(f)
    if rng.random() < 0.45:
        spin = f.u(-25, 25)
        for s, sign in SIDES:
            rim = chair.spots["rim" + s]
            hub = rim.at - rim.normal * 0.27
            place = hub + rot(0, spin + f.rng.normal(0, 6)) @ (rim.at - hub)
            f.hand(s, place, axis=rim.axis, elbow=(sign * 0.8, 0.8, 0.1))
    else:
        seated_hands(f, chair.spots)
    return Scene("wheelchair", posed(f), (chair.thing(),))


def at_table(f: Figure, desk: bool) -> list[Built]:
    """Put a table before a seated person, with what lies on it, and the hands on it."""
    rng, front = f.rng, ahead(f)
    clearance = thigh_top(f) + 0.035
    top = clearance + f.u(0.01, 0.09)
    table = tables.table(rng, top, f.u(0.9, 1.7))
    gap = f.ahead(top - 0.12, top + 0.12) + f.u(0.02, 0.14)
    at = np.array([*(f.root + front * gap)[:2], 0.0])
    aside = left(f) * f.u(-0.2, 0.2)
    table = table.placed(f.yaw + rng.normal(0, 2), at + aside)
    middle = at + UP * top
    made = [table]
    if desk:
        keys = (tables.laptop if rng.random() < 0.65 else tables.keyboard)(rng)
        away = f.u(0.05, 0.2) + (0.07 if keys.kind == "keyboard" else 0.0)
        keys = keys.placed(f.yaw + rng.normal(0, 5), middle + front * away)
        made.append(keys)
        if keys.kind == "keyboard":
            screen = tables.monitor(rng)
            made.append(screen.placed(f.yaw + rng.normal(0, 8), middle + front * (away + f.u(0.3, 0.5))))
        if rng.random() < 0.7:
            place = keys.spots["keys"].at
            for s, sign in SIDES:
                on = place + left(f) * sign * f.u(0.05, 0.11) - front * f.u(0, 0.06)
                f.hand(s, on + UP * 0.01, back=UP - 0.15 * front, elbow=(sign * 0.8, 0.4, -0.3), grip="relaxed")
        else:
            on_top(f, middle, front)
        f.head(f.u(5, 25) - 0.3 * f.bent, f.rng.normal(0, 4), f.rng.normal(0, 12))
    else:
        on_top(f, middle, front)
    lies = tables.clutter(
        rng, 0.7 * table.spots["top"].size[0], 0.6 * table.spots["top"].size[1], int(rng.integers(0, 6))
    )
    if lies is not None:
        made.append(_lying(lies, table, f.yaw))
    return made


def _lying(lies: Mesh, table: Built, yaw: float) -> Built:
    top = table.spots["top"]
    return Built("things on a table", lies, {}).placed(yaw, top.at)


def table_user(desk: bool) -> Callable[[BodyModel, np.random.Generator], Scene]:
    """A maker of scenes of someone seated at a table, or at a desk with a computer."""

    def make(body: BodyModel, rng: np.random.Generator) -> Scene:
        f = Figure(body, rng)
        if rng.random() < 0.12:
            chair = in_wheelchair(f)
        else:
            chair = _seat_for(f, ("chair", "office chair", "chair", "bench")[int(rng.integers(4))])
            on_chair(f, chair, f.u(0.3, 1.0), feet_on_floor(f, forward=(-0.15, 0.15)))
        made = at_table(f, desk)
        return Scene("desk" if desk else "table", posed(f), tuple(b.thing() for b in (chair, *made)))

    return make


def two_at_table(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two people who face one another across a table."""
    one, two = Figure(body, rng), Figure(body, rng)
    chairs = []
    for f in (one, two):
        chair = _seat_for(f, ("chair", "office chair", "stool")[int(rng.integers(2))])
        on_chair(f, chair, f.u(0.3, 0.95), feet_on_floor(f, forward=(-0.15, 0.1)))
        chairs.append(chair)
    top = max(thigh_top(one), thigh_top(two)) + f.u(0.045, 0.1)
    depth = f.u(0.6, 0.85)
    table = tables.table(rng, top, f.u(0.8, 1.6), depth)
    depth = table.spots["top"].size[1]
    made = [table]
    gaps = [f.ahead(top - 0.12, top + 0.12) + f.u(0.02, 0.12) for f in (one, two)]
    side = f.u(-0.15, 0.15)
    one_by = np.array([0, 0, 0]) - [*(one.root + ahead(one) * gaps[0])[:2], 0]
    one.move(one_by)
    made.append(chairs[0].placed(0, one_by))
    turned = rot(2, 180)
    target = np.array([side, -depth, 0.0])
    place = turned @ np.array([*(two.root + ahead(two) * gaps[1])[:2], 0])
    _turn_round(two, target - place)
    made.append(chairs[1].placed(180, target - place))
    for f, at in ((one, np.zeros(3)), (two, target)):
        on_top(f, at + UP * top, ahead(f))
    lies = tables.clutter(rng, 0.8, 0.5, int(rng.integers(0, 6)))
    if lies is not None:
        made.append(_lying(lies, table, 0.0))
    return Scene("two at a table", posed(one, two), tuple(b.thing() for b in made))


def _turn_round(f: Figure, by: FloatArray) -> None:
    """Turn a person by half a turn about the origin and move them by (3,)."""
    turned = rot(2, 180)
    f.local[0] = turned @ f.local[0]
    f.yaw += 180
    f.root = turned @ f.root
    f.move(by)
