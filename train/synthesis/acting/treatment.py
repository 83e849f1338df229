"""A therapist who bends and moves a patient's leg on a treatment table."""

from functools import partial

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.acting.stage import Stage, best_bend, between_keys
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import unit
from muybridge.train.synthesis.things.objects import tables
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import SIGN, Figure
from muybridge.train.synthesis.things.using.lying import lie
from muybridge.train.synthesis.things.using.standing import Stance

_KEYS = (0.0, 0.4, 1.7, 2.1, 3.2, 3.6, 4.6)
# Hip, knee and how far out the leg is, degrees.
_LEG = ((14, 12, 4), (14, 12, 4), (82, 92, 4), (82, 92, 4), (60, 70, 20), (60, 70, 20), (18, 16, 4))
_WANT = 0.86  # distance of the hands from the shoulders as a share of an arm


def _holds(p: Figure, side: str) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Places on the skin under the knee's hollow and behind the ankle, and where the hands' backs point there."""
    shank, _ = p.frame("lowerleg01." + side)
    behind = unit(shank @ np.array([0.0, 1.0, 0.0]))
    knee = p.at("lowerleg01." + side, (0.0, 0.055, 0.03))
    ankle = p.at("foot." + side, (0.0, 0.045, 0.035))
    return {"knee": knee, "ankle": ankle}, {"knee": behind, "ankle": behind}


def _bend(t: Figure, yaw: float, total: float) -> None:
    t.trunk(yaw, pitch=0.5 * total, lean=0.5 * total, vary=0.0)


def therapist(body: BodyModel, rng: np.random.Generator, times: FloatArray) -> list[Scene]:
    """A therapist at the table's side bends the nearer leg of a patient, moves it out, and lays it down; one hand
    under the knee, one behind the ankle."""
    p, t = Figure(body, rng, (0.6, 0.95)), Figure(body, rng, (0.65, 0.85))
    couch = tables.treatment_table(rng, 0.46 * t.skeleton.height)
    top, side = couch.spots["top"], float(rng.choice([-1, 1]))
    near = "L" if side > 0 else "R"
    lie(p, top, "back", near)
    leg = between_keys(_KEYS, _LEG)

    def set_leg(s: float) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
        hip, knee, out = leg(s).tolist()
        p.leg(near, hip, knee, out=out, ankle=12)
        return _holds(p, near)

    # The hand towards the patient's head holds the knee.
    hands = {"R" if side > 0 else "L": "knee", "L" if side > 0 else "R": "ankle"}
    keys = np.linspace(times[0], max(times[-1], times[0] + 0.5), 12)
    holds = [set_leg(s)[0] for s in keys]
    middle = float(np.mean([[h["knee"][1], h["ankle"][1]] for h in holds]))
    yaw = -90.0 * side
    stance = Stance(t, np.array([side * (top.size[0] / 2 + 0.16 * t.k), middle, 0]), yaw, width=1.6)
    bends = []
    for hold in holds:
        stance.plant()
        bends.append(best_bend(t, partial(_bend, t, yaw), {s: hold[name] for s, name in hands.items()}, _WANT))
        _bend(t, yaw, bends[-1])
    total = between_keys(keys.tolist(), bends)
    stage = Stage("treatment", p, t)
    for s in times.tolist():
        places, backs = set_leg(s)
        _bend(t, yaw, float(total(s)))
        t.head(20 - 0.3 * t.bent, 0, 0)
        stance.plant()
        for hand, name in hands.items():
            t.hand(hand, places[name], back=backs[name], elbow=(SIGN[hand] * 0.8, 0.5, -0.4), grip="relaxed")
        stage.shoot(couch)
    return stage.scenes()
