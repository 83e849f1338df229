"""A cyclist who pedals on rollers."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.acting.stage import Stage
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, log, rot, turn
from muybridge.train.synthesis.things.built import Built
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using.figure import SIGN, Figure
from muybridge.train.synthesis.things.using.riding import fitting_bicycle, mount

_CADENCE = 75.0  # turns of the crank a minute
_TIP, _ANKLING = 14.0, 9.0  # degrees: mean pitch of the feet, and its swing
_GEAR = 2.6


def _pedalled(bike: Built, turned: float) -> tuple[Built, dict[str, float]]:
    """The bicycle with its crank turned by degrees and the wheels with it; pitch of each pedal, which is the foot's."""
    now = bike.spun("crank", turned)
    pitches = {}
    for s, _ in SIDES:
        arm = now.pivots["pedal" + s].at - now.pivots["crank"].at
        forward = float(np.arctan2(-arm[1], arm[2]))  # of the pedal from the top
        pitches[s] = _TIP - _ANKLING * np.sin(forward - 0.6)
        now = now.spun("pedal" + s, pitches[s] - turned)
    for name in ("rear", "front"):
        now = now.spun(name, _GEAR * turned)
    return now, pitches


def cyclist(body: BodyModel, rng: np.random.Generator, times: FloatArray) -> list[Scene]:
    """Someone who pedals evenly; feet stay on the pedals, hands on the bar, the trunk sways a little."""
    f = Figure(body, rng, (0.6, 0.85))
    bike = fitting_bicycle(f, True)

    def feet(at: Built, pitches: dict[str, float]) -> None:
        for s, sign in SIDES:
            f.foot(s, at.spots["pedal" + s].at, sign * 3.0, pitches[s], knee_out=1.0)

    grips = {s: bike.spots["grip" + s] for s, _ in SIDES}
    start = _pedalled(bike, 0.0)
    mount(f, bike.spots["saddle"], lambda: feet(*start), {s: g.at for s, g in grips.items()}, 0.88, (0, 72), 0.55)
    local, seat = f.local.copy(), f.root.copy()
    spine = f.index["spine03"]
    stage = Stage("bicycle on rollers", f)
    for t in times.tolist():
        phase = 2 * np.pi * _CADENCE / 60 * t
        now, pitches = _pedalled(bike, float(np.degrees(phase)))
        sway = 2.0 * np.sin(phase)
        f.local = local.copy()
        f.local[0] = rot(1, sway) @ local[0]
        f.local[spine] = turn(log(local[spine]) + np.radians([0, -1.5 * sway, 0.8 * sway]))
        f.root = seat + np.array([0.008 * np.sin(phase), 0.0, 0.004 * np.cos(2 * phase)])
        f.move((0, 0, 0))
        feet(now, pitches)
        for s, grip in grips.items():
            f.hand(s, grip.at, axis=grip.axis, elbow=np.array([0.5, 0.5, -0.7]) * [SIGN[s], 1, 1])
        stage.shoot(now)
    return stage.scenes()
