"""What people do with their hands while they do something else: on the hips, in pockets, folded, at the face, ...

Random angles of the arms never find these, since they need both hands, or a hand and the body, to meet; and they are
how people stand about in most pictures.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import SIDES, SPINE
from muybridge.train.synthesis.motions.script import Hold
from muybridge.train.synthesis.motions.stage import Stage

CHEST, PELVIS = SPINE[-1], "root"


@dataclass(frozen=True)
class _Habit:
    """Where wrists are, for the left hand; the right one is its mirror image.

    Attributes:
        share: how often, standing and seated.
        bone: that carries the place; a trailing dot stands for the side's own.
        anchor: bone from whose place at rest `place` counts.
        place: the wrist's offset from it, in thousandths of the body's height: left, back, up.
        spread: standard deviation of each.
        elbow: where it points, left, back, up.
        hands: 2 both, 1 the acting one.
        other: offset of the second hand where it is no mirror image.
    """

    share: tuple[float, float]
    bone: str
    anchor: str
    place: tuple[float, float, float]
    spread: tuple[float, float, float]
    elbow: tuple[float, float, float]
    hands: int = 2
    other: tuple[float, float, float] | None = None


HABITS: dict[str, _Habit] = {
    "folded": _Habit((0.2, 0.12), CHEST, CHEST, (-58, -150, -12), (12, 6, 12), (1, 0.1, -0.6), 2, (-45, -108, -92)),
    "hips": _Habit((0.13, 0.03), PELVIS, PELVIS, (128, 5, 66), (10, 14, 14), (1, 0.5, 0)),
    "hip": _Habit((0.06, 0.03), PELVIS, PELVIS, (128, 5, 66), (10, 14, 14), (1, 0.5, 0), 1),
    "pockets": _Habit((0.13, 0.0), PELVIS, PELVIS, (112, -22, 6), (8, 14, 12), (0.5, 0.9, 0)),
    "pocket": _Habit((0.06, 0.0), PELVIS, PELVIS, (112, -22, 6), (8, 14, 12), (0.5, 0.9, 0), 1),
    "clasped": _Habit((0.1, 0.14), PELVIS, PELVIS, (30, -125, 10), (5, 14, 22), (0.8, 0.5, 0)),
    "behind": _Habit((0.06, 0.0), PELVIS, PELVIS, (28, 108, 38), (6, 10, 22), (1, 0.4, 0)),
    "holding": _Habit((0.1, 0.2), CHEST, CHEST, (65, -195, -70), (28, 28, 45), (0.7, 0.3, -0.7)),
    "phone": _Habit((0.06, 0.07), CHEST, CHEST, (20, -190, -20), (22, 25, 35), (0.5, 0.2, -0.8), 1),
    "ear": _Habit((0.03, 0.03), CHEST, "head", (86, -45, 5), (8, 12, 10), (0.7, -0.4, -0.7), 1),
    "chin": _Habit((0.03, 0.06), CHEST, "head", (22, -108, -50), (12, 8, 14), (0.3, -0.5, -0.8), 1),
    "across": _Habit((0.03, 0.04), CHEST, CHEST, (-72, -135, -75), (12, 10, 20), (0.7, 0.2, -0.7), 1),
    "nape": _Habit((0.01, 0.03), CHEST, "head", (66, 56, 25), (8, 8, 10), (1, -0.2, 0.4)),
    "thighs": _Habit((0.0, 0.25), "upperleg01.", "lowerleg01.", (10, -62, 62), (14, 10, 34), (0.7, 0.6, 0)),
}  # fmt: skip


def hands_at_rest(g: Stage, seated: bool = False) -> None:
    """One habit for the clip, held all the time, or taken up or given up during it; the other hand, where the habit
    takes one, stays with what it does."""
    names = list(HABITS)
    share = np.array([h.share[seated] for h in HABITS.values()])
    name = names[int(g.rng.choice(len(names), p=share / share.sum()))]
    weight = _when(g)
    first = g.act
    for side, sign in SIDES:
        if HABITS[name].hands == 2 or side == first:
            _hold(g, HABITS[name], side, sign, side == first, weight)


def _when(g: Stage) -> FloatArray:
    """All the time, from some moment on, or up to some moment."""
    style, start = g.u(0, 1), g.u(0.3, max(0.5, g.end - 1.5))
    if style < 0.7 or g.end < 2.5:
        return np.ones(len(g.t))
    move = g.keys([start, start + g.u(0.7, 1.1)], [0, 1])
    return move if style < 0.85 else 1 - move


def _hold(g: Stage, habit: _Habit, side: str, sign: float, first: bool, weight: FloatArray) -> None:
    k = g.solver.k
    bone, anchor = ((b + side if b.endswith(".") else b) for b in (habit.bone, habit.anchor))
    offset = habit.place if first or habit.other is None else habit.other
    drawn = np.array(offset) + g.rng.normal(0, 1, 3).clip(-1.8, 1.8) * habit.spread
    place = k.at(anchor) + drawn * 1e-3 * k.height * [sign, 1, 1]
    for name, value in zip(("hx", "hy", "hz"), place, strict=True):
        g.s[name + side] = value + g.wander(-0.006, 0.006, 1.5)
    elbow = np.array(habit.elbow) * [sign, 1, 1] + g.rng.normal(0, 0.15, 3)
    g.s.holds[side] = Hold(bone, elbow / np.linalg.norm(elbow))
    g.s["hand" + side] = weight
    g.s["pro" + side] = g.wander(-45, 45, 3.0)
    g.s["wrist" + side] = g.wander(-30, 30, 3.0)
