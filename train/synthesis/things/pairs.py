"""People who stand in contact: hugs, dances, handshakes, arms around shoulders, a child by the hand, a crowd."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.company import Member, bring_together, push_apart
from muybridge.train.synthesis.things.scene import Scene

UP = np.array([0.0, 0.0, 1.0])
CHILD = (0.16, 0.42)  # anny's age: about 2 to 11 years


def scene(kind: str, people: Sequence[Member], rng: np.random.Generator) -> Scene:
    """The scene of settled people, in random order."""
    return Scene(kind, tuple(people[int(i)].posed() for i in rng.permutation(len(people))))


def sides(rng: np.random.Generator) -> tuple[str, str]:
    """Left and right, or right and left."""
    return ("L", "R") if rng.random() < 0.5 else ("R", "L")


def hug(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two people in each other's arms, or one who embraces the other from behind."""
    behind = rng.random() < 0.25
    a, b = Member(body, rng), Member(body, rng)
    for m, x, heading in ((a, 0.0, 0.0), (b, rng.choice([-1, 1]) * rng.uniform(0.04, 0.12), 0.0 if behind else 180.0)):
        m.set(lean=rng.uniform(2, 14), flex=rng.uniform(30, 75), out=rng.uniform(20, 50), elbow=60.0).vary(0.7)
        m.stand(x, 0.0, heading + rng.normal(0, 8), split=rng.uniform(-0.15, 0.15)).settle()
    bring_together(b, (a,), (0, 1, 0) if behind else (0, -1, 0), 0.8)
    high, _ = sides(rng)
    for m, o in ((b, a),) if behind else ((a, b), (b, a)):
        places = {}
        for s, sign in (("L", 1.0), ("R", -1.0)):
            across = rng.uniform(0.1, 0.9)
            way = (sign * (0.3 + across), -1.0, 0.0) if behind else (-sign * across, 1.0, 0.1)
            places[s] = o.spot("spine01" if s == high else "spine04", way)
        m.reach(**places)
    return scene("hug", (a, b), rng)


def dance(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A couple: in a closed hold, holding both hands at arm's length, or turning under an arm."""
    a, b = Member(body, rng), Member(body, rng)
    style = rng.choice(["closed", "open", "turn"], p=[0.5, 0.3, 0.2])
    for m, heading in ((a, 0.0), (b, 180.0)):
        if style == "turn" and m is b:
            heading = float(rng.uniform(0, 360))
        m.set(lean=rng.uniform(-6, 8), flex=50.0, out=50.0, elbow=70.0, height=rng.uniform(0.93, 0.99)).vary()
        m.stand(rng.uniform(-0.08, 0.08), 0.0, heading + rng.normal(0, 10), split=rng.uniform(-0.35, 0.35)).settle()
    apart = {"closed": rng.uniform(0, 0.3), "open": rng.uniform(0.55, 0.85), "turn": rng.uniform(0.3, 0.6)}[style]
    bring_together(b, (a,), (0, -1, 0), 1.0, apart)
    middle = (a.at("spine01") + b.at("spine01")) / 2
    low = min(a.k, b.k)
    if style == "closed":
        joined = middle + [rng.uniform(0.45, 0.62) * low, 0.0, rng.uniform(-0.1, 0.25) * low]
        a.reach(L=joined + [0, 0.05, 0], R=b.spot("spine01", (0.6, 1.0, rng.uniform(-0.8, 0.3))))
        b.reach(R=joined - [0, 0.05, 0], L=a.at("upperarm01.R", (-0.02, 0.03, 0.09)))
    elif style == "open":
        for s, o, sign in (("L", "R", 1.0), ("R", "L", -1.0)):
            joined = middle + [sign * rng.uniform(0.15, 0.5) * low, 0.0, rng.uniform(-0.35, 0.3) * low]
            a.reach(**{s: joined + [0, 0.06, 0]})
            b.reach(**{o: joined - [0, 0.06, 0]})
    else:
        joined = b.at("head") + UP * rng.uniform(0.25, 0.4)
        a.reach(**{sides(rng)[0]: joined})
        b.reach(**{sides(rng)[0]: joined - UP * 0.08})
    return scene("dance", (a, b), rng)


def handshake(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two people who shake hands, or clasp them; one may hold the other's arm too."""
    a, b = Member(body, rng), Member(body, rng)
    for m, heading in ((a, 0.0), (b, 180.0)):
        m.set(lean=rng.uniform(2, 22), flex=35.0, out=15.0, elbow=70.0).vary()
        m.stand(0.0, 0.0, heading + rng.normal(0, 12), split=rng.uniform(-0.3, 0.3)).settle()
    b.move(np.array([rng.uniform(-0.2, 0.2), 0.0, 0.0]))
    bring_together(b, (a,), (0, -1, 0), 1.5, rng.uniform(0.5, 0.8))
    s, _ = sides(rng) if rng.random() < 0.15 else ("R", "L")
    middle = (a.at("upperarm01." + s) + b.at("upperarm01." + s)) / 2
    middle[2] = rng.uniform(0.55, 0.8) * min(a.at("neck01")[2], b.at("neck01")[2]) + rng.choice([0, 0.25], p=[0.8, 0.2])
    along = (b.root[0] - a.root[0]) * [1, 1, 0]
    along = along / np.linalg.norm(along) * 0.05
    a.reach(**{s: middle - along})
    b.reach(**{s: middle + along})
    if rng.random() < 0.3:
        other = "L" if s == "R" else "R"
        a.reach(**{other: b.at("lowerarm01." + s, (0, -0.06, 0.0))})
    return scene("handshake", (a, b), rng)


def arm_around(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two or three side by side, with arms around shoulders and waists, as for a photograph."""
    people = [Member(body, rng) for _ in range(int(rng.integers(2, 4)))]
    for i, m in enumerate(people):
        m.set(flex=5.0, out=25.0, lean=rng.uniform(-3, 8)).vary()
        m.stand(0.0, rng.uniform(-0.06, 0.06), rng.normal(0, 10)).settle()
        if i:
            m.move(people[i - 1].root[0] * [1, 0, 0])
            bring_together(m, people[:i], (1, 0, 0), 0.7, soft=0.03)
    for m, o in zip(people[:-1], people[1:], strict=True):  # `o` stands at the left of `m`
        shoulders = m.k > o.k * 0.93
        if rng.random() < 0.8:
            m.set(outL=85.0, flexL=-12.0) if shoulders else m.set(outL=35.0, flexL=-25.0)
            m.reach(L=o.at("upperarm01.L", (0.0, 0.06, 0.07)) if shoulders else o.spot("spine05", (0.5, 1.0, 0)))
        if rng.random() < 0.8:
            o.set(outR=35.0, flexR=-25.0)
            o.reach(R=m.spot("spine04", (-0.5, 1.0, 0)))
    return scene("arm_around", people, rng)


def child_by_the_hand(body: BodyModel, rng: np.random.Generator) -> Scene:
    """An adult who walks or stands with a child by the hand, or bends down to a child."""
    a, c = Member(body, rng, (0.62, 1.0)), Member(body, rng, CHILD)
    side, other = sides(rng)
    sign = 1.0 if side == "L" else -1.0
    facing = rng.random() < 0.35
    bend = rng.uniform(0.5, 0.8) if facing else rng.uniform(0.95, 0.99)
    a.set(height=bend, lean=45 * (1 - bend) + rng.uniform(0, 12), pitch=30 * (1 - bend), flex=45.0 if facing else 10.0)
    a.vary().stand(0.0, 0.0, 0.0, split=rng.uniform(-0.5, 0.5)).settle()
    c.set(flex=40.0, out=30.0).vary().stand(
        0.0, 0.0, 180.0 if facing else rng.normal(0, 15), split=rng.uniform(-0.3, 0.3)
    )
    c.settle()
    if facing:
        bring_together(c, (a,), (0, -1, 0), 1.2, rng.uniform(0.2, 0.4))
        low = rng.random() < 0.5  # hands in hands, or on the child's arms
        for s, o, across in (("L", "R", 1.0), ("R", "L", -1.0)):
            place = c.at("spine02") + [across * 0.25, 0.2, 0.05] if low else c.at("upperarm02." + o)
            a.reach(**{s: place + [across * 0.03, 0.03, 0.04]})
            if low:
                c.reach(**{o: place - [0, 0.03, 0.03]})
        return scene("parent_child", (a, c), rng)
    bring_together(c, (a,), (sign, rng.uniform(-0.4, 0.2), 0), 0.9, rng.uniform(0.25, 0.45))
    place = (a.at("upperarm01." + side) + c.at("upperarm01." + other)) / 2
    place[2] = min(max(c.at("neck01")[2] * rng.uniform(0.75, 1.15), a.at("upperarm01." + side)[2] - 0.62 * a.k),
                   c.at("neck01")[2] + 0.3 * c.k)  # fmt: skip
    a.reach(**{side: place + UP * 0.05})
    c.reach(**{other: place - UP * 0.04})
    return scene("parent_child", (a, c), rng)


def crowd(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Three or four close together who stand, walk, gesture or crouch."""
    people: list[Member] = []
    for _ in range(int(rng.integers(3, 5))):
        m = Member(body, rng)
        pose = rng.uniform(0.6, 0.98) if rng.random() < 0.25 else 0.98
        m.set(height=pose, lean=5 + 60 * (0.98 - pose) + rng.uniform(0, 15))
        for s in "LR":
            m.set(
                **{"flex" + s: rng.uniform(-20, 120), "out" + s: rng.uniform(5, 70), "elbow" + s: rng.uniform(5, 130)}
            )
        m.vary().stand(0.0, 0.0, rng.uniform(0, 360), split=rng.uniform(-0.6, 0.6)).settle()
        if people:
            push_apart(m, people, direction(rng), rng.uniform(0.0, 0.3))
        people.append(m)
    return scene("crowd", people, rng)


def direction(rng: np.random.Generator) -> FloatArray:
    """(3,) a random horizontal direction."""
    angle = rng.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])
