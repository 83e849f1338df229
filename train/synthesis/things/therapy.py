"""A therapist who guides a patient: lying on a couch, sitting, or standing."""

from dataclasses import replace

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.floor import lie
from muybridge.train.synthesis.things.company import Member, bring_together
from muybridge.train.synthesis.things.pairs import scene, sides
from muybridge.train.synthesis.things.scene import Scene, Thing

_CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float32)
_FACES = np.array([[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3], [0, 4, 6],
                   [0, 6, 2], [1, 3, 7], [1, 7, 5]])  # fmt: skip


def _boxes(
    kind: str, boxes: list[tuple[list[float], list[float]]], colour: np.ndarray, pattern: int, gloss: float
) -> Thing:
    """Boxes from their low and high corners."""
    points = [np.array(low) + _CUBE * (np.array(high) - np.array(low)) for low, high in boxes]
    faces = np.concatenate([_FACES + 8 * i for i in range(len(boxes))])
    count = len(faces)
    return Thing(
        kind, np.concatenate(points).astype(np.float32), faces, np.tile(colour.astype(np.float32), (count, 1)),
        np.full(count, pattern), np.full(count, gloss, np.float32),
    )  # fmt: skip


def _furniture(
    kind: str, low: list[float], high: list[float], rng: np.random.Generator, thick: float = 0.08
) -> tuple[Thing, Thing]:
    """A padded top between two corners, and four legs or a block below it."""
    top = _boxes(
        kind,
        [([*low, high[2] - thick], high)],
        rng.uniform(0.03, 0.6) * rng.uniform(0.6, 1, 3),
        int(rng.choice([0, 1, 3])),
        0.3,
    )
    inset, wide = rng.uniform(0.02, 0.12), rng.uniform(0.03, 0.08)
    floor = high[2] - thick
    if rng.random() < 0.3:
        legs = [([low[0] + inset, low[1] + inset, 0.0], [high[0] - inset, high[1] - inset, floor])]
    else:
        legs = [
            ([x, y, 0.0], [x + wide, y + wide, floor])
            for x in (low[0] + inset, high[0] - inset - wide) for y in (low[1] + inset, high[1] - inset - wide)
        ]  # fmt: skip
    return top, _boxes(kind, legs, rng.uniform(0.02, 0.7) * np.ones(3), int(rng.choice([0, 2, 4])), rng.uniform(0, 0.6))


def _beside(m: Member, heading: float, x: float, y: float, rng: np.random.Generator, low: float = 0.8) -> Member:
    """A therapist who bends over at (x, y)."""
    bend = rng.uniform(low, 0.98)
    m.set(height=bend, lean=rng.uniform(5, 40), pitch=25 * (1 - bend), nod=15.0, flex=50.0, out=25.0, elbow=40.0)
    return m.vary(0.7).stand(x, y, heading, split=rng.uniform(-0.4, 0.4)).settle()


def lying(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A patient on a couch whose limb or back the therapist holds."""
    p, t = Member(body, rng), Member(body, rng, (0.62, 0.95))
    p.play(lie, 0.6).settle(exact=True)
    side = float(rng.choice([-1.0, 1.0]))
    couch, half = rng.uniform(0.45, 0.85), rng.uniform(0.3, 0.4)
    middle = (p.skin.min(0) + p.skin.max(0)) / 2
    long = np.ptp(p.skin[:, 1]) / 2 + rng.uniform(-0.1, 0.15)
    low, high = [-half + middle[0], middle[1] - long], [half + middle[0], middle[1] + long, couch]
    p.move(np.array([0, 0, couch]))
    at = p.at(str(rng.choice(["spine02", "lowerleg01.L", "upperarm01.L", "spine05"])))
    _beside(t, 90.0 * -side + rng.normal(0, 12), 0.0, float(at[1]), rng)
    t.move(np.array([middle[0] + side * (half + 0.05 - 0.0), 0.0, 0.0]) - t.root[0] * [1, 0, 0])
    bring_together(t, (p,), (side, 0, 0), 0.5, 0.12)
    near = [b for b in ("foot.L", "foot.R", "lowerleg01.L", "lowerleg01.R", "wrist.L", "wrist.R", "lowerarm01.L",
                        "lowerarm01.R", "upperarm01.L", "upperarm01.R", "spine02", "spine04", "head")]  # fmt: skip
    shoulder = (t.at("upperarm01.L") + t.at("upperarm01.R")) / 2
    near.sort(key=lambda b: float(np.linalg.norm(p.at(b) - shoulder)))
    for s, bone in zip("LR", rng.permutation(near[:4]), strict=False):
        t.reach(**{s: p.at(str(bone)) + [side * 0.03, 0, 0.09]})
    return replace(scene("therapy", (p, t), rng), things=_furniture("couch", low, high, rng))


def sitting(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A sitting patient, the therapist behind, beside or in front."""
    p, t = Member(body, rng), Member(body, rng, (0.62, 0.95))
    seat = rng.uniform(0.36, 0.55) * p.k
    p.set(flex=rng.uniform(10, 60), out=20.0, elbow=rng.uniform(30, 90)).vary().sit(0.0, 0.0, 0.0, seat).settle()
    where = str(rng.choice(["behind", "beside", "front"]))
    s, o = sides(rng)
    if where == "behind":
        _beside(t, rng.normal(0, 10), 0.0, 0.0, rng)
        bring_together(t, (p,), (0, 1, 0), 0.9, rng.uniform(0.2, 0.32))
        t.reach(**{h: p.at("upperarm01." + h, (0, 0.03, 0.09)) for h in "LR"})
    elif where == "beside":
        sign = 1.0 if s == "L" else -1.0
        _beside(t, -90.0 * sign + rng.normal(0, 20), 0.0, 0.0, rng, 0.65)
        bring_together(t, (p,), (sign, rng.uniform(-0.4, 0.2), 0), 1.2, 0.25)
        t.reach(**{o: p.at("lowerarm01." + s, (0, 0, 0.06)), s: p.at("wrist." + s, (0, 0, 0.05))})
        if rng.random() < 0.5:
            t.reach(**{o: p.at("upperarm01." + s, (0.0, 0.03, 0.08))})
    else:
        _beside(t, 180.0 + rng.normal(0, 15), 0.0, 0.0, rng, 0.5)
        bring_together(t, (p,), (0, -1, 0), 1.6, 0.3)
        t.reach(**{o: p.at("lowerleg01." + s, (0.0, -0.07, 0.03)), s: p.at("foot." + s, (0.0, 0.03, 0.08))})
    sat = p.skin[p.skin[:, 2] > 0.3 * seat]
    under = float(np.quantile(sat[np.abs(sat[:, 1]) < 0.1 * p.k, 2], 0.0)) + 0.015
    half = rng.uniform(0.18, 0.3)
    low, high = [-half, -rng.uniform(0.08, 0.2)], [half, rng.uniform(0.15, 0.3), under]
    return replace(scene("therapy", (p, t), rng), things=_furniture("stool", low, high, rng, 0.05))


def standing(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A patient who learns to stand or walk, held at waist, arm or shoulder."""
    p, t = Member(body, rng), Member(body, rng, (0.62, 0.95))
    p.set(lean=rng.uniform(0, 25), height=rng.uniform(0.9, 0.98), flex=20.0, out=rng.uniform(10, 60)).vary()
    p.stand(0.0, 0.0, 0.0, split=rng.uniform(-0.5, 0.5)).settle()
    s, o = sides(rng)
    sign = 1.0 if s == "L" else -1.0
    if rng.random() < 0.4:
        _beside(t, rng.normal(0, 10), 0.0, 0.0, rng)
        bring_together(t, (p,), (0, 1, 0), 0.9, rng.uniform(0.1, 0.3))
        t.reach(**{h: p.spot("spine05", (x, 0.4, 0)) for h, x in (("L", 1.0), ("R", -1.0))})
    else:
        _beside(t, rng.uniform(-100, 10) * sign, 0.0, 0.0, rng)
        bring_together(t, (p,), (sign, rng.uniform(-0.2, 0.4), 0), 1.0, rng.uniform(0.1, 0.2))
        t.reach(**{o: p.spot("spine05", (0.4 * sign, 1, 0)), s: p.at("lowerarm01." + s, (0, -0.02, -0.05))})
    return scene("therapy", (p, t), rng)


def therapy(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A patient who lies, sits or stands, and a therapist."""
    return (lying, sitting, standing)[int(rng.choice(3, p=[0.4, 0.35, 0.25]))](body, rng)
