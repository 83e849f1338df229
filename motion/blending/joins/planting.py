"""Which feet stand in a motion that was joined, and planting them there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.feet import USUAL_LEG_M, Leg, find_legs, leg_length, points_of_foot
from muybridge.motion.contacts.find import Contacts, find_contacts, without_short_runs
from muybridge.motion.contacts.planting import PlantOptions, plant_feet

_OFF_M = 0.015  # of an adult: a foot that a transition has moved farther from where it stands does not stand yet
_STEP_M = 0.05  # of an adult: a foot that stands farther away in the next motion takes a step there
_SHORTEST_S = 0.06
_OWN_HEIGHT_M = 0.003  # over the floor, from which a contact keeps its height: the motions' floors may differ


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

    def plant(self, motion: Motion, standing: BoolArray, where: BoolArray | None = None) -> tuple[Motion, Contacts]:
        """The motion with feet planted where they stand (T, 2, 2), in the contacts that have a frame in `where`."""
        first = self.contacts[0]
        contacts = Contacts.of_feet(standing, motion.fps, first.floor, first.clearance)
        planted = plant_feet(motion, contacts, PlantOptions(step=_OWN_HEIGHT_M), roles=self.roles, legs=self.legs,
                             where=where)  # fmt: skip
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


def contacts_across(
    feet: Feet, motions: tuple[Motion, Motion, Motion], standing: tuple[BoolArray, BoolArray], leave: int, enter: int
) -> BoolArray:
    """(T, 2, 2) the contacts of a motion that was joined of two.

    A foot that stands in both motions at the join, in one place, stands on. Another one stands where it does in the
    motion that it comes from, unless the transition has moved it away from there: it takes a step.

    Args:
        feet: of the skeleton.
        motions: the first one; the second one, where it was placed; and what was made of them.
        standing: (T, 2, 2) of the first and of the second.
        leave: the last frame of the first motion.
        enter: the frame of the second at the same time.
    """
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
    return out


def _span_about(contact: BoolArray, frame: int) -> slice:
    """The run of true about a frame."""
    free = np.flatnonzero(~contact)
    before, after = free[free < frame], free[free > frame]
    return slice(int(before[-1]) + 1 if len(before) else 0, int(after[0]) if len(after) else len(contact))
