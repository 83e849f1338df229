"""Scenes of two to four people in contact: who stands where, and what their hands hold."""

from collections.abc import Callable

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.company import Member, bring_together
from muybridge.train.synthesis.things.scene import Posed, Scene


def _hug(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Two people in each other's arms."""
    a, b = Member(body, rng), Member(body, rng)
    for m, x, y, heading in ((a, 0.0, 0.0, 0.0), (b, rng.uniform(-0.08, 0.08), 0.0, 180.0)):
        m.set(lean=rng.uniform(2, 14), flex=rng.uniform(40, 75), out=rng.uniform(25, 50), elbow=60.0).vary(0.7)
        m.stand(x, y, heading + rng.normal(0, 8), split=rng.uniform(-0.15, 0.15)).settle()
    bring_together(b, (a,), (0, -1, 0), 0.8)
    high = "L" if rng.random() < 0.5 else "R"
    for m, o in ((a, b), (b, a)):
        for s, sign in (("L", 1.0), ("R", -1.0)):
            bone = "spine01" if s == high else "spine04"
            m.reach(s, o.spot(bone, (-sign * rng.uniform(0.1, 0.8), 1.0, 0.1)))
    return Scene("hug", (a.posed(), b.posed()))


def _crowd(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Three or four people close together who do different things."""
    count = int(rng.integers(3, 5))
    batch = body.sample(count)
    people = []
    for i in range(count):
        angle, c = rng.uniform(0, 2 * np.pi), rng.uniform(-np.pi, np.pi)
        turn = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
        place = np.array([np.cos(angle), np.sin(angle), 0]) * rng.uniform(0.2, 0.7)
        people.append(
            Posed(
                (batch.vertices[i] @ turn.T + place).astype(np.float32),
                (batch.landmarks[i] @ turn.T + place).astype(np.float32),
                float(batch.gender[i]),
            )
        )
    return Scene("crowd", tuple(people))


TOGETHER: dict[str, Callable[[BodyModel, np.random.Generator], Scene]] = {"hug": _hug, "crowd": _crowd}
