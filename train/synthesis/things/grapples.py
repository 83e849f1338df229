"""People who wrestle, tackle or carry one another."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.floor import crawl, lie
from muybridge.train.synthesis.things.company import Member, bring_together
from muybridge.train.synthesis.things.pairs import CHILD, scene, sides
from muybridge.train.synthesis.things.scene import Scene

UPPER_ARMS = {"upperarm02.L": (0.05, 0.0, 0.0), "upperarm02.R": (-0.05, 0.0, 0.0), "neck01": (0.0, 0.08, 0.03)}


def wrestle(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two standing wrestlers, bent forward, who hold neck, arms or waist."""
    a, b = Member(body, rng), Member(body, rng)
    for m, heading in ((a, 0.0), (b, 180.0)):
        m.set(
            height=rng.uniform(0.72, 0.93), lean=rng.uniform(25, 60), pitch=rng.uniform(5, 25), nod=-rng.uniform(0, 40)
        )
        m.set(flex=70.0, out=35.0, elbow=60.0).vary()
        m.stand(0.0, 0.0, heading + rng.normal(0, 12), 1.4, rng.uniform(-0.5, 0.5)).settle()
    b.move(np.array([rng.choice([-1, 1]) * rng.uniform(0.05, 0.25), 0.0, 0.0]))
    bring_together(b, (a,), (0, -1, 0), 1.4, soft=0.03)
    for m, o in ((a, b), (b, a)):
        for s in "LR":
            same = "R" if s == "L" else "L"
            bone = str(rng.choice(["upperarm02." + same, "neck01", "waist"]))
            across = 1.0 if same == "L" else -1.0
            m.reach(**{s: o.spot("spine03", (0.7 * across, 1, 0)) if bone == "waist" else o.at(bone, UPPER_ARMS[bone])})
    return scene("wrestle", (a, b), rng)


def floor_wrestle(body: BodyModel, rng: np.random.Generator) -> Scene:
    """One on the floor, the other astride, across or behind."""
    a, b = Member(body, rng), Member(body, rng)
    turtle = rng.random() < 0.3
    a.play(crawl if turtle else lie).settle(exact=True)
    hips, chest = a.at("root"), a.at("spine01")
    middle = hips + rng.uniform(0.0, 1.0) * (chest - hips)
    head = a.at("neck01") - hips
    toward = float(np.degrees(np.arctan2(head[0], -head[1])))  # the heading of somebody who faces the head
    astride = rng.random() < 0.5
    if astride:
        b.set(pitch=rng.uniform(5, 45), lean=rng.uniform(0, 45), abd=rng.uniform(30, 45))
        b.set(hip=rng.uniform(35, 70), knee=rng.uniform(50, 100) if turtle else rng.uniform(105, 140))
        b.carried(*_apart(middle, 0.9), toward + rng.normal(0, 20))
    else:  # across, on the front
        b.set(pitch=rng.uniform(60, 85), lean=rng.uniform(0, 25), abd=rng.uniform(0, 30))
        for s in "LR":
            b.set(**{"hip" + s: rng.uniform(25, 65), "knee" + s: rng.uniform(5, 70)})
        angle = toward + rng.choice([-90, 90]) + rng.normal(0, 30)
        back = np.array([-np.sin(np.radians(angle)), np.cos(np.radians(angle)), 0]) * rng.uniform(0.2, 0.45)
        b.carried(*_apart(middle + back, 0.9), angle)
    b.set(flex=rng.uniform(50, 90), out=rng.uniform(15, 50), elbow=50.0).vary().lift()
    bring_together(b, (a,), (0, 0, 1), 0.3, -1.2, soft=0.035, legs=not astride)
    holds = ["upperarm02.L", "upperarm02.R", "wrist.L", "wrist.R", "neck01"]
    for s, bone in zip("LR", rng.permutation(holds)[:2], strict=True):
        b.reach(**{s: a.at(str(bone), (0.0, 0.0, 0.0)) + [0, 0, 0.05]})
    if not turtle and rng.random() < 0.6:
        a.reach(**{s: b.spot("spine02", (0.6 if s == "R" else -0.6, rng.uniform(-1, 1), 0)) for s in "LR"})
    return scene("floor_wrestle", (a, b), rng)


def tackle(body: BodyModel, rng: np.random.Generator) -> Scene:
    """One runs a shoulder into the other's waist and holds the thighs."""
    a, b = Member(body, rng), Member(body, rng)
    side = float(rng.choice([180.0, 90.0, -90.0, 0.0], p=[0.55, 0.15, 0.15, 0.15])) + rng.normal(0, 15)
    a.set(pitch=rng.uniform(-20, 10), lean=rng.uniform(-10, 30), flex=rng.uniform(-10, 100), out=40.0).vary()
    a.stand(0.0, 0.0, 0.0, 1.1, rng.uniform(-0.7, 0.7)).set(balance=0.0).settle()
    b.set(height=rng.uniform(0.6, 0.8), pitch=rng.uniform(35, 60), lean=rng.uniform(15, 40), nod=-rng.uniform(10, 50))
    b.set(flex=80.0, out=45.0, elbow=50.0).vary().stand(0.0, 0.0, side, 1.1, rng.uniform(-0.9, 0.9))
    b.set(balance=0.0).settle()
    back = np.array([-np.sin(np.radians(side)), np.cos(np.radians(side)), 0.0])
    aside = np.cross(back, [0, 0, 1]) * rng.choice([-1, 1]) * rng.uniform(0.16, 0.24)
    b.move((a.root[0] - b.root[0]) * [1, 1, 0] + aside)
    bring_together(b, (a,), back, 1.5, soft=0.03)
    for s in "LR":
        thigh = a.spot("upperleg02." + rng.choice(["L", "R"]), (0, 0, 0) + back @ _turn(a) * -1, 0.03)
        b.reach(**{s: thigh if rng.random() < 0.6 else a.spot("spine05", -back @ _turn(a))})
    return scene("tackle", (a, b), rng)


def _apart(place: FloatArray, height: float) -> tuple[float, float, float]:
    """A place `height` metres above another."""
    return float(place[0]), float(place[1]), float(place[2]) + height


def _turn(m: Member) -> FloatArray:
    """(3, 3) world from the axes of the body at rest, by its heading."""
    c, s = np.cos(np.radians(m.script["yaw"][0])), np.sin(np.radians(m.script["yaw"][0]))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def piggyback(body: BodyModel, rng: np.random.Generator) -> Scene:
    """One rides on the other's back."""
    a = Member(body, rng, (0.6, 1.0))
    b = Member(body, rng, CHILD if rng.random() < 0.4 else None)
    a.set(lean=rng.uniform(8, 30), pitch=rng.uniform(0, 12), flex=-25.0, out=35.0, elbow=90.0).vary(0.6)
    a.stand(0.0, 0.0, 0.0, split=rng.uniform(-0.5, 0.5)).settle()
    b.set(hip=rng.uniform(65, 95), abd=rng.uniform(38, 50), knee=rng.uniform(60, 110), pitch=rng.uniform(0, 25))
    b.set(lean=rng.uniform(0, 20), flex=75.0, out=25.0, elbow=60.0).vary(0.7)
    height = a.at("root")[2] + rng.uniform(0.08, 0.25)
    b.carried(rng.uniform(-0.03, 0.03), float(a.root[0, 1]), float(height), rng.normal(0, 5)).lift()
    bring_together(b, (a,), (0, 1, 0), 0.9, soft=0.03, legs=False)
    b.reach(**{s: a.spot("spine01", (0.4 * x, -1, 0.5 * rng.random())) for s, x in (("L", -1), ("R", 1))})
    a.reach(**{s: b.at("lowerleg01." + s, (0.0, 0.07, 0.09)) for s in "LR"})
    return scene("carry", (a, b), rng)


def in_the_arms(body: BodyModel, rng: np.random.Generator) -> Scene:
    """One lies across the other's arms."""
    a = Member(body, rng, (0.6, 1.0))
    b = Member(body, rng, CHILD if rng.random() < 0.4 else None)
    a.set(lean=rng.uniform(-12, 8), flex=45.0, out=20.0, elbow=90.0).vary(0.6)
    a.stand(0.0, 0.0, 0.0, split=rng.uniform(-0.3, 0.3)).settle()
    head, feet = sides(rng)  # of the carrier, where the other's head and feet are
    sign = 1.0 if head == "R" else -1.0
    b.set(pitch=-rng.uniform(55, 85), lean=rng.uniform(0, 25), hip=rng.uniform(45, 90), knee=rng.uniform(40, 100))
    b.set(abd=-4.0, flex=20.0, out=15.0, elbow=50.0).vary(0.7)
    height = float(a.at("spine04")[2]) + rng.uniform(-0.05, 0.1)
    b.carried(0.12 * sign, float(a.root[0, 1]), height, 90.0 * sign).lift()
    bring_together(b, (a,), (0, -1, 0), 0.9, soft=0.03)
    near = "L" if head == "R" else "R"  # the arm next to the carrier
    a.reach(**{head: b.spot("spine02", (0, 1, 0), 0.05), feet: b.at("lowerleg01." + near, (0, 0.08, 0.08))})
    if rng.random() < 0.6:
        b.reach(**{near: a.at("neck01", (0.0, 0.09, 0.0))})
    return scene("carry", (a, b), rng)


def carried_child(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A small child on an arm, at the chest, or on the shoulders."""
    a, c = Member(body, rng, (0.62, 1.0)), Member(body, rng, (0.08, 0.3))
    side, other = sides(rng)
    sign = 1.0 if side == "L" else -1.0
    a.set(lean=rng.uniform(-8, 4), flex=35.0, out=25.0, elbow=90.0).vary(0.6)
    a.stand(0.0, 0.0, 0.0, split=rng.uniform(-0.4, 0.4)).settle()
    c.set(hip=rng.uniform(60, 95), abd=rng.uniform(25, 40), knee=rng.uniform(50, 100), lean=rng.uniform(0, 20))
    c.set(flex=50.0, out=30.0, elbow=50.0).vary(0.7)
    if rng.random() < 0.35:
        neck = a.at("neck01")
        c.carried(float(neck[0]), float(neck[1]) + 0.07, float(neck[2]) + 0.5, rng.normal(0, 6)).lift()
        bring_together(c, (a,), (0, 0, 1), 0.1, -0.5, soft=0.045, legs=False)
        a.reach(**{s: c.at("foot." + s, (0.0, -0.03, 0.08)) for s in "LR"})
        c.reach(**{s: a.spot("head", (0.5 if s == "L" else -0.5, -0.2, 1)) for s in "LR"})
        return scene("carry", (a, c), rng)
    height = float(a.at("spine04")[2]) + rng.uniform(0.05, 0.2)
    chest = rng.random() < 0.4
    way = np.array([0.0 if chest else sign * rng.uniform(0.5, 1.5), -1.0, 0.0])
    heading = 180.0 + (0.0 if chest else sign * rng.uniform(10, 60))
    c.carried(float(a.root[0, 0]) + way[0] * 0.1, float(a.root[0, 1]), height, heading).lift()
    bring_together(c, (a,), tuple(way), 0.7, soft=0.03, legs=chest)
    a.reach(**{side: c.spot("root", (0, 1, -1)), other: c.spot("spine02", (0.3, 1, 0))})
    c.reach(**{s: a.at("upperarm01." + ("R" if s == "L" else "L"), (0, -0.02, 0.08)) for s in "LR"})
    return scene("carry", (a, c), rng)


def carry(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Somebody carried: on the back, in the arms, a child on an arm or on the shoulders."""
    return (piggyback, in_the_arms, carried_child)[int(rng.choice(3, p=[0.4, 0.25, 0.35]))](body, rng)
