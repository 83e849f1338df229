"""Which feet stand in a motion that was joined, and planting them there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.feet import USUAL_LEG_M, Leg, find_legs, leg_length, points_of_foot
from muybridge.motion.contacts.find import Contacts, find_contacts, without_short_runs
from muybridge.motion.contacts.foot_plan import depth
from muybridge.motion.contacts.planting import PlantOptions, plant_feet

_OFF_M = 0.015  # of an adult: a foot that a transition has moved farther from where it stands does not stand yet
_STEP_M = 0.05  # of an adult: a foot that stands farther away in the next motion takes a step there
_SHORTEST_S = 0.06
_FADE = 1 / 3  # of a transition's duration, over which planting its feet fades
_OWN_HEIGHT_M = 0.003  # over the floor, from which a contact keeps its height: the motions' floors may differ


@dataclass(frozen=True, eq=False)
class Stance:
    """How the feet of a motion stand.

    Attributes:
        contact: (T, 2, 2) whether heel and ball of the left and the right foot stand.
        under: (T, 2) metres that each foot is in the floor of the first motion that is joined: the floors of captures
            differ, and a foot that swings through one is not lifted out of it.
    """

    contact: BoolArray
    under: FloatArray

    def select(self, frames: slice) -> "Stance":
        """The same of some frames."""
        return Stance(self.contact[frames], self.under[frames])


@dataclass(frozen=True, eq=False)
class Feet:
    """The feet of the skeleton that several motions share, and where they stand in each.

    Attributes:
        roles: role -> joint.
        legs: left and right.
        size: of the body against an adult's.
        contacts: of each motion.
    """

    roles: dict[str, int]
    legs: tuple[Leg, Leg]
    size: float
    contacts: tuple[Contacts, ...]

    def places(self, motion: Motion) -> FloatArray:
        """(T, 2, 2, 3) metres of heel and ball of the left and the right foot."""
        world = motion.forward()
        return np.stack([points_of_foot(world[:, leg.foot, :3, 3], world[:, leg.foot, :3, :3], leg)
                         for leg in self.legs], axis=1)  # fmt: skip

    def stance(self, number: int, motion: Motion) -> Stance:
        """How the feet stand in the motion of this number, wherever on the ground it is placed."""
        world, first = motion.forward(), self.contacts[0]
        deep = [depth(world[:, leg.foot, :3, 3], world[:, leg.foot, :3, :3], leg, first.floor, first.clearance[k])
                for k, leg in enumerate(self.legs)]  # fmt: skip
        return Stance(self.contacts[number].contact, np.maximum(np.stack(deep, axis=1), 0.0))

    def plant(self, motion: Motion, stance: Stance, where: BoolArray, seconds: float) -> tuple[Motion, Contacts]:
        """The motion with feet planted where they stand, in the contacts that have a frame in `where` (T,).

        What it takes to plant a transition of so many seconds fades over a share of them.
        """
        first = self.contacts[0]
        contacts = Contacts.of_feet(stance.contact, motion.fps, first.floor, first.clearance)
        options = PlantOptions(max(PlantOptions.blend, _FADE * seconds), step=_OWN_HEIGHT_M)
        planted = plant_feet(motion, contacts, options, roles=self.roles, legs=self.legs, where=where,
                             under=stance.under)  # fmt: skip
        return planted.motion, planted.contacts


def find_feet(motions: Sequence[Motion]) -> tuple[Feet | None, list[str]]:
    """The feet and contacts of motions of one skeleton; or None, and the reason, where no feet are known."""
    try:
        roles = dict(find_motion_roles(motions[0]).roles)
        legs = find_legs(motions[0].skeleton, roles, motions[0])
        contacts = tuple(find_contacts(m, roles=roles) for m in motions)
    except ValueError as error:
        return None, [f"feet are not planted: {error}"]
    return Feet(roles, legs, leg_length(motions[0].skeleton, legs) / USUAL_LEG_M, contacts), []


def stance_across(
    feet: Feet, motions: tuple[Motion, Motion, Motion], stances: tuple[Stance, Stance], leave: int, enter: int
) -> Stance:
    """How feet stand in a motion that was joined of two.

    A foot that stands in both motions at the join, in one place, stands on. Another one stands where it does in the
    motion that it comes from, unless the transition has moved it away from there: it takes a step.

    Args:
        feet: of the skeleton.
        motions: the first one; the second one, where it was placed; and what was made of them.
        stances: of the first and of the second.
        leave: the last frame of the first motion.
        enter: the frame of the second at the same time.
    """
    standing = stances[0].contact, stances[1].contact
    out = np.concatenate([standing[0][: leave + 1], standing[1][enter + 1 :]])
    first, second, joined = (feet.places(m) for m in motions)
    source = np.concatenate([first[: leave + 1], second[enter + 1 :]])
    near = np.linalg.norm(joined - source, axis=-1) <= _OFF_M * feet.size
    together = np.linalg.norm(first[leave] - second[enter], axis=-1) <= _STEP_M * feet.size
    together &= standing[0][leave] & standing[1][enter]
    shortest = round(_SHORTEST_S * motions[0].fps)
    for foot, point in np.ndindex(2, 2):
        contact = out[:, foot, point]
        held = np.zeros(len(out), np.bool_)
        if together[foot, point]:
            held[_span_about(contact, leave)] = True
        out[:, foot, point] = without_short_runs(contact & (held | near[:, foot, point]), shortest)
    return Stance(out, np.concatenate([stances[0].under[: leave + 1], stances[1].under[enter + 1 :]]))


def _span_about(contact: BoolArray, frame: int) -> slice:
    """The run of true about a frame."""
    free = np.flatnonzero(~contact)
    before, after = free[free < frame], free[free > frame]
    return slice(int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(contact))
