"""Standing people: feet planted, trunk bent so that hands reach what they do, walking."""

from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.skeleton.mass import centre_of_mass
from muybridge.train.synthesis.motions.rig import SIDES, forward, rot
from muybridge.train.synthesis.things.using.figure import Figure
from muybridge.train.synthesis.things.using.sitting import ahead, left

BENDS = 9  # that are tried


def bend_to(
    f: Figure, yaw: float, targets: Mapping[str, FloatArray], want: float = 0.88,
    bends: tuple[float, float] = (-5.0, 75.0), share: float = 0.5, roll: float = 0.0,
) -> float:  # fmt: skip
    """Bend the trunk forward by the angle that brings shoulders to the wanted distance from places for the hands.

    Args:
        f: the person, whose root stays.
        yaw: where the person faces.
        targets: places by side.
        want: distance, as a share of an arm's length.
        bends: least and most bend, degrees.
        share: of the bend that is the pelvis' pitch.
        roll: of the pelvis.

    Returns:
        The remaining distance as a share of an arm's length.
    """
    best, least = bends[0], np.inf
    for total in np.linspace(*bends, BENDS):
        f.trunk(yaw, pitch=share * total, roll=roll, lean=(1 - share) * total, vary=0.0)
        off = max((abs(f.reach(s, at) - want) for s, at in targets.items()), default=0.0)
        if off < least - 1e-6:
            best, least = float(total), off
    f.trunk(yaw, pitch=share * best, roll=roll, lean=(1 - share) * best, vary=0.25)
    return max((f.reach(s, at) for s, at in targets.items()), default=0.0)


class Stance:
    """Where the feet of a standing person are.

    Args:
        f: the person.
        at: (3,) between the feet, on what they stand on.
        yaw: where the person faces.
        width: of the stance, relative to the hips'.
        split: metres by which the left foot is ahead.
    """

    def __init__(self, f: Figure, at: FloatArray, yaw: float, width: float = 1.1, split: float = 0.0) -> None:
        self.f, self.at = f, np.asarray(at, float)
        f.yaw = yaw
        self.feet = {
            s: (
                self.at + left(f) * sign * 0.1 * f.k * width * f.u(0.85, 1.15) + ahead(f) * 0.5 * sign * split,
                yaw + sign * f.u(0, 18),
            )
            for s, sign in SIDES
        }
        # Knees are never quite straight.
        self.high = float(f.skeleton.rest[0, 2]) * f.u(0.965, 0.99)
        f.root = self.at + [0, 0, self.high] + ahead(f) * 0.03 * f.k

    def step(self, by: float) -> None:
        """Move the feet and the person forward, metres."""
        way = ahead(self.f) * by
        self.feet = {s: (at + way, yaw) for s, (at, yaw) in self.feet.items()}
        self.at = self.at + way
        self.f.move(way)

    def plant(self, crouch: float = 0.0, balance: bool = True) -> None:
        """Feet on their places, the pelvis lowered by `crouch` metres and so that they reach, the weight over them."""
        f = self.f
        f.root[2] = self.at[2] + self.high - crouch
        for _ in range(3 if balance else 2):
            short = max(f.foot(s, at, yaw, knee_out=4.0) for s, (at, yaw) in self.feet.items())
            if short > 0.001:
                f.move((0, 0, -1.3 * short - 0.005))
            if balance:
                _, at_world = forward(f.skeleton, f.local[None], f.root[None])
                mass = centre_of_mass(at_world, f.skeleton.roles)[0, :2]
                middle = np.mean([at - ahead(f) * 0.035 * f.k for at, _ in self.feet.values()], 0)
                f.move(np.array([*(middle[:2] - mass), 0.0]) * 0.9)
        for s, (at, yaw) in self.feet.items():
            f.foot(s, at, yaw, knee_out=4.0)


def stand_to(
    f: Figure, at: FloatArray, yaw: float, targets: Mapping[str, FloatArray], want: float = 0.88, split: float = 0.0,
    width: float = 1.1, bends: tuple[float, float] = (-3.0, 80.0), crouch: float = 0.0,
) -> Stance:  # fmt: skip
    """Stand at a place, bent and crouching so that hands can reach their places; hands themselves are left."""
    stance = Stance(f, at, yaw, width, split)
    for _ in range(4):
        stance.plant(crouch)
        far = bend_to(f, yaw, targets, want, bends)
        stance.plant(crouch)
        if far < 1.0:
            break
        # What is high calls for a step, what is low for bent knees.
        if min(place[2] for place in targets.values()) < 0.45 * f.skeleton.height:
            crouch += 0.12 * f.k
        else:
            stance.step(0.08 * f.k)
    return stance


def stride(f: Figure, at: FloatArray, yaw: float, run: bool = False) -> None:
    """A moment of walking or running above a point (3,) of the floor."""
    phase, f.yaw = f.u(0, 1), yaw
    step = f.u(0.2, 0.36) * f.k if not run else f.u(0.25, 0.42) * f.k
    f.trunk(yaw + f.rng.normal(0, 4), pitch=f.u(1, 7) + 5 * run, lean=f.u(0, 8), twist=8 * np.cos(2 * np.pi * phase))
    air = f.u(0.0, 0.06) if run else 0.0
    f.root = np.asarray(at, float) + [0, 0, float(f.skeleton.rest[0, 2]) * f.u(0.93, 0.965) + air]
    for s, sign in SIDES:
        p = (phase + (0.5 if sign < 0 else 0.0)) % 1.0
        stance = 0.62 if not run else 0.4
        if p < stance:
            q = p / stance
            along, lift, pitch = step * (1 - 2 * q), air, -14 * max(0, 1 - 4 * q) + 40 * max(0, q - 0.65) / 0.35
        else:
            q = (p - stance) / (1 - stance)
            along, lift = step * (2 * q - 1), (0.09 + 0.13 * run) * np.sin(np.pi * q) * (1.4 - q) + air
            pitch = 45 * (1 - q) * (1 + 0.6 * run) - 12 * q
        place = np.asarray(at, float) + ahead(f) * (along + 0.05 * f.k) + left(f) * sign * 0.06 * f.k + [0, 0, lift]
        if pitch < 0:
            f.foot(s, place - ahead(f) * 0.14 * f.k, yaw + 5 * sign, pitch, knee_out=2, part="heel")
        else:
            f.foot(s, place, yaw + 5 * sign, pitch, knee_out=2)
        swing = -np.cos(2 * np.pi * p) * (16 if not run else 30)
        f.arm(s, swing + f.bent, f.u(9, 16), f.u(70, 105) if run else f.u(12, 40), f.u(0, 20))
    low = float(f.skin()[:, 2].min()) - float(at[2])
    if low < 0 or not run:
        f.move((0, 0, -low))


def heading(way: FloatArray) -> FloatArray:
    """(3, 3) the turn about the vertical that takes -y to the direction `way` (3,)."""
    return rot(2, float(np.degrees(np.arctan2(way[0], -way[1]))))
