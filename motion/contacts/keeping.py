"""Feet that stand where they stood before an edit."""

from collections.abc import Mapping

import numpy as np

from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.blending import blend
from muybridge.motion.contacts.feet import find_legs
from muybridge.motion.contacts.foot_plan import FootPlan, lift_out
from muybridge.motion.contacts.planting import Planted, PlantOptions, carry_out, plant_feet


def keep_feet(
    motion: Motion, before: Motion, options: PlantOptions | None = None, *, roles: Mapping[str, int] | None = None
) -> Planted:
    """An edited motion whose feet stand where they stand in the motion before the edit.

    Contacts are found in the motion before, and planted there: an edit such as a gain may let feet slide so much that
    no contacts could be found behind it. While a foot stands it has the place and the orientation that it had; what
    that takes is blended into the frames beside.

    Args:
        motion: Z up, of any skeleton with known thighs, shins and feet.
        before: the same clip before the edit: of the same skeleton, frame by frame.
        options: how feet are planted.
        roles: role -> joint; None finds them.

    Raises:
        ValueError: legs are not known, or the motions are of different numbers of frames.
    """
    if len(motion) != len(before):
        raise ValueError(f"a motion of {len(motion)} frames does not belong to one of {len(before)}")
    options = options or PlantOptions()
    roles = find_motion_roles(before).roles if roles is None else roles
    legs = find_legs(before.skeleton, roles, before)
    planted = plant_feet(before, options=options, roles=roles, legs=legs)
    if not planted.contacts.contact.any():
        return Planted(motion, planted.contacts, 0.0, 0.0, 0.0)
    world, wanted = motion.forward(), planted.motion.forward()
    plans = []
    for k, leg in enumerate(legs):
        standing = np.asarray(planted.contacts.contact[:, k].any(1))
        share = np.asarray(standing, dtype=np.float64)
        now, then = world[:, leg.foot], wanted[:, leg.foot]
        turn = log_so3(then[:, :3, :3] @ np.swapaxes(now[:, :3, :3], -1, -2))
        turn = np.where(standing[:, None], turn, blend(turn, share, motion.fps, options.blend))
        away = then[:, :3, 3] - now[:, :3, 3]
        moved = np.where(standing[:, None], away, blend(away, share, motion.fps, options.blend))
        turns, contacts = exp_so3(turn) @ now[:, :3, :3], planted.contacts
        moved = moved + lift_out(now[:, :3, 3] + moved, turns, leg, standing, contacts.floor, contacts.clearance[k],
                                 motion.fps)  # fmt: skip
        plans.append(FootPlan(now[:, :3, 3] + moved, turns, moved))
    out, shift, unreached = carry_out(motion, world, legs, plans, options)
    return Planted(out, planted.contacts, shift, float(max(np.linalg.norm(p.moved, axis=1).max() for p in plans)),
                   unreached)  # fmt: skip
