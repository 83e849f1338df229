"""People who lie on beds and treatment tables, and the therapists who treat them."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.ground_contact import sink_limbs
from muybridge.train.synthesis.motions.rig import SIDES
from muybridge.train.synthesis.things.built import Built, Spot
from muybridge.train.synthesis.things.objects import seats, tables
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import SIGN, Figure, posed
from muybridge.train.synthesis.things.using.hands import UP, above, habit, seated_hands
from muybridge.train.synthesis.things.using.sitting import ahead, settle
from muybridge.train.synthesis.things.using.standing import stand_to

_TRUNK = ("root", "pelvis", "spine", "clavicle", "breast")


def lie(f: Figure, top: Spot, style: str, lifted: str = "") -> None:
    """Lie on a surface along y, the head at +y.

    Args:
        f: the person.
        top: the surface.
        style: `back`, `front` or `side`.
        lifted: side of a leg that somebody holds up, or "".
    """
    roll = {"back": 0.0, "front": 180.0, "side": 90.0 if f.u(0, 1) < 0.5 else -90.0}[style] + f.rng.normal(0, 5)
    f.trunk(f.rng.normal(0, 3), pitch=-90 + f.u(-2, 4), roll=roll, lean=f.u(-2, 8) * (style != "front"), vary=0.4)
    f.head(f.u(-4, 14) if style != "front" else -8, f.u(-6, 6), f.u(-35, 35) if style != "front" else f.u(40, 62))
    sink = {"head": 1.0}
    bent = f.u(0, 1) < 0.35
    for s, _ in SIDES:
        sink["arm" + s] = sink["leg" + s] = 1.0
        sink |= _leg(f, s, style, bent and f.u(0, 1) < 0.75, s == lifted)
        _arm(f, s, style, sink)
    f.root = top.at + [0, top.size[1] / 2 - f.u(0.06, 0.2) - (f.skeleton.height - float(f.skeleton.rest[0, 2])), 0.12]
    f.move((0, 0, 0))
    f.lie_on(top, *_TRUNK, soft=0.02)
    limbs = [name + s for name in ("arm", "leg", "shank") for s, _ in SIDES] + ["head"]
    free = {k: np.full(1, float(k in sink)) for k in limbs}
    lain = {k: np.full(1, sink.get(k, 0.0)) for k in limbs}
    f.local = sink_limbs(f.skeleton, f.local[None], f.root[None] - top.at * [0, 0, 1], 1.0, lain, free)[0]
    f.move((0, 0, 0))


def _leg(f: Figure, s: str, style: str, bent: bool, lifted: bool) -> dict[str, float]:
    if style == "back" and lifted:
        hip = f.u(25, 85)
        f.leg(s, hip, f.u(10, 95) if hip > 45 else f.u(0, 30), out=f.u(-5, 20), ankle=f.u(-5, 20))
        return {"leg" + s: 0.0}
    if style == "front" and lifted:
        f.leg(s, f.u(-12, 2), f.u(50, 115), out=f.u(0, 10), ankle=f.u(0, 25))
        return {"leg" + s: 0.0}
    if style == "back" and bent:
        hip = f.u(30, 55)
        knee = hip + np.degrees(np.arcsin(np.clip(f.thigh * np.sin(np.radians(hip)) / f.shank, -1, 1)))
        f.leg(s, hip, knee, out=f.u(0, 10), ankle=90 - (knee - hip))
        return {"leg" + s: 0.0}
    if style == "side":
        f.leg(s, f.u(10, 60), f.u(20, 85), out=f.u(-6, 4), ankle=20)
    else:
        f.leg(s, f.u(-2, 8), f.u(0, 14), out=f.u(-2, 10), inward=f.u(-15, 0), ankle=f.u(15, 45))
    return {}


def _arm(f: Figure, s: str, style: str, sink: dict[str, float]) -> None:
    draw = f.u(0, 1)
    if style == "back":
        if draw < 0.65:
            f.arm(s, f.u(-6, 10), f.u(8, 24), f.u(5, 35))
        elif draw < 0.85:
            habit(f, "clasped", s)
            sink["arm" + s] = 0.0
        else:
            habit(f, "nape", s)
            sink["arm" + s] = 0.0
    elif style == "front":
        if draw < 0.5:
            f.arm(s, f.u(-12, 0), f.u(8, 24), f.u(5, 30))
        else:
            f.arm(s, f.u(140, 170), f.u(15, 50), f.u(60, 110))
    else:
        f.arm(s, f.u(20, 80), f.u(-5, 15), f.u(40, 110))
        sink["arm" + s] = 0.5


def resting(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Someone alone on a bed or a treatment table."""
    f = Figure(body, rng)
    couch = tables.bed(rng) if rng.random() < 0.6 else tables.treatment_table(rng)
    lie(f, couch.spots["top"], _style(f))
    return Scene("bed", posed(f), (couch.thing(),))


def _style(f: Figure) -> str:
    return str(f.rng.choice(["back", "back", "front", "side"]))


def _places(p: Figure, style: str, near: str, what: int) -> tuple[dict[str, FloatArray], str]:
    """Where a therapist's hands touch the patient, by hand `a` nearer to the patient's head and `b`; and from where:
    `side`, `head` or `feet`."""
    leg = "upperleg", "lowerleg", "foot"
    if what == 0:  # the leg that is nearer
        knee, ankle = p.at("lowerleg01." + near), p.at("foot." + near)
        hip = p.at("upperleg01." + near)
        return {
            "a": above(p, knee + (hip - knee) * p.u(0, 0.3), *leg),
            "b": _under(p, ankle + (knee - ankle) * p.u(0.05, 0.3)),
        }, "side"
    if what == 1:  # shoulder and arm
        shoulder, wrist, elbow = (p.at(b + near) for b in ("upperarm01.", "wrist.", "lowerarm01."))
        lower = elbow + (wrist - elbow) * p.u(0.1, 0.9)
        return {
            "a": above(p, shoulder, "upperarm", "shoulder", "clavicle"),
            "b": above(p, lower, "lowerarm", "wrist"),
        }, "side"
    if what == 2:  # back or belly
        high, low = p.at("spine02"), p.at("spine04")
        return {"a": above(p, high, *_TRUNK), "b": above(p, low, *_TRUNK)}, "side"
    if what == 3:  # the head
        head = p.at("head", (0, 0, 0.02))
        return {"a": head + np.array([0.075, 0.02, 0]) * p.k, "b": head + np.array([-0.075, 0.02, 0]) * p.k}, "head"
    feet = [p.at("foot." + s) for s in "LR"]
    return {"a": above(p, feet[0], "foot", "lowerleg02"), "b": above(p, feet[1], "foot", "lowerleg02")}, "feet"


def _under(p: Figure, at: FloatArray) -> FloatArray:
    return np.asarray(above(p, at, "lowerleg", "foot"))


def treatment(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A patient on a treatment table in a therapist's hands."""
    p, t = Figure(body, rng), Figure(body, rng, (0.65, 0.9))
    couch = tables.treatment_table(rng, t.u(0.4, 0.5) * t.skeleton.height)
    top = couch.spots["top"]
    if rng.random() < 0.2:
        return _on_the_edge(p, t, couch)
    style, side = ("back", "front", "back", "side")[int(rng.integers(4))], float(rng.choice([-1, 1]))
    on_left = (side > 0) == (style != "front")
    near, what = "L" if on_left else "R", int(rng.choice(5, p=[0.4, 0.22, 0.2, 0.1, 0.08]))
    lie(p, top, style, near if what == 0 and rng.random() < 0.75 else "")
    places, where = _places(p, style, near, what)
    middle = np.mean(list(places.values()), 0)
    if where == "side":
        # The therapist faces across the table; the hand towards the patient's head is the left one at +x.
        yaw, a = -90.0 * side, "R" if side > 0 else "L"
        at = np.array([side * (top.size[0] / 2 + 0.13 * t.k), middle[1] + rng.normal(0, 0.1), 0])
    elif where == "head":
        yaw, a = 0.0, "L"
        at = np.array([0, max(top.size[1] / 2, middle[1] + 0.1) + 0.15 * t.k, 0])
    else:
        yaw, a = 180.0, "R"
        at = np.array([0, -top.size[1] / 2 - 0.15 * t.k, 0])
    hands = {a: places["a"], "LR".replace(a, ""): places["b"]}
    stand_to(t, at, yaw + rng.normal(0, 10), hands, t.u(0.72, 0.88), split=rng.uniform(-0.3, 0.3))
    for s, place in hands.items():
        t.hand(s, place, back=UP, elbow=(SIGN[s] * 0.8, 0.3, -0.3), grip="relaxed")
    t.head(t.u(8, 28) - 0.3 * t.bent, 0, t.rng.normal(0, 12))
    return Scene("treatment", posed(p, t), (couch.thing(),))


def _on_the_edge(p: Figure, t: Figure, couch: Built) -> Scene:
    """The patient sits on the table's long side, the therapist stands or sits before them and holds an arm, the
    shoulders or a knee."""
    rng, top = p.rng, couch.spots["top"]
    edge = Spot(top.at, np.array([1.0, 0, 0]), top.normal, (top.size[1], top.size[0]))
    p.trunk(90.0 + rng.normal(0, 6), pitch=p.u(-6, 6), lean=p.u(0, 14))

    def hang() -> None:
        for s, _ in SIDES:
            p.leg(s, 86 + p.pitch, 78, out=3, ankle=25)

    settle(p, edge, hang, perch=top.size[0] - 0.14 * p.k - 0.6 * p.thigh)
    seated_hands(p, {})
    what, near = int(rng.integers(3)), "LR"[int(rng.integers(2))]
    other = "LR".replace(near, "")
    if what == 0:
        places = [p.at("upperarm01." + near, (0, 0, 0.06)), p.at("wrist." + near)]
    elif what == 1:
        places = [p.at("upperarm01.L", (0, 0, 0.06)), p.at("upperarm01.R", (0, 0, 0.06))]
    else:
        knee = p.at("lowerleg01." + near)
        places = [knee + UP * 0.07, p.at("foot." + near) + ahead(p) * 0.03]
    # Face to face, the patient's left is at the therapist's right hand.
    hands = {other: places[0], near: places[1]} if what != 1 else {"R": places[0], "L": places[1]}
    at = np.array([float(p.at("lowerleg01.L")[0]) + 0.22 * t.k, float(np.mean([h[1] for h in places])), 0])
    stool = seats.stool(rng, 0.9 * t.seat)
    things = [couch]
    if what == 2:
        at = at + np.array([0.3 * t.k, 0, 0])
        placed = stool.placed(-90, at)
        things.append(placed)
        t.trunk(-90, pitch=10, lean=20)

        def plant() -> None:
            for s, sign in SIDES:
                t.foot(
                    s,
                    at * [1, 1, 0] + ahead(t) * 0.2 * t.k + np.array([0, -sign, 0]) * -0.24 * t.k,
                    -90 + 25 * sign,
                    knee_out=25,
                )

        settle(t, placed.spots["seat"], plant)
    else:
        stand_to(t, at, -90 + rng.normal(0, 8), hands, 0.8)
    for s, place in hands.items():
        t.hand(s, place, elbow=(SIGN[s] * 0.7, 0.3, -0.6), grip="relaxed")
    return Scene("treatment", posed(p, t), tuple(b.thing() for b in things))
