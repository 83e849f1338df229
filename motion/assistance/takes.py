"""Captured takes brought onto the skeleton, and to the frame rate, of a key-framed clip."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import CORE_ROLES
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.character import Character
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.editing.mirroring import mirror
from muybridge.motion.editing.resampling import resample
from muybridge.motion.retargeting.solver import RetargetOptions, retarget
from muybridge.wording import counted

_SAME = 0.01  # share of the skeleton's size by which bones may differ and still be the same
_FEWEST = 8  # frames of a take that can be broken into fragments


@dataclass(frozen=True, eq=False)
class CapturedTake:
    """A take on the skeleton of a key-framed clip.

    Attributes:
        name: as messages call it.
        motion: of that skeleton, at the clip's frame rate; rotations alone are meant.
        mirrored: whether left and right are exchanged.
        notices: what was done to it, one sentence each.
    """

    name: str
    motion: Motion
    mirrored: bool = False
    notices: tuple[str, ...] = ()


def bring_take(
    name: str, take: Motion, roles: Mapping[str, int], keys: Motion, key_roles: Mapping[str, int]
) -> CapturedTake:
    """A take as the skeleton of a key-framed clip moves in it.

    Another skeleton is retargeted to; its rotations count alone, so that feet are not planted.

    Args:
        name: of the take.
        take: Z up.
        roles: role -> joint of it.
        keys: the key-framed clip.
        key_roles: role -> joint of that.

    Raises:
        MuybridgeError: too few frames, or another skeleton of which one of both lacks roles; the message names them.
    """
    check_editable(take)
    if len(take) < _FEWEST:
        raise MuybridgeError(f"{name}: has {counted(len(take), 'frame')}; at least {_FEWEST} are needed")
    notices = []
    if not same_skeleton(take.skeleton, keys.skeleton):
        sides = ((name, roles, "take_map"), ("the key frames", key_roles, "role_map"))
        for whose, found, remedy in sides:
            if missing := [role for role in CORE_ROLES if role not in found]:
                raise MuybridgeError(
                    f"{whose}: no joint was found for {', '.join(missing)}, and the skeleton of {name} is another one "
                    "than that of the key frames", remedy=remedy,
                )  # fmt: skip
        one = replace(keys, skeleton=replace(keys.skeleton, sliding=()), translations=None).select(slice(0, 1))
        hero = Character(Path("key frames"), one.skeleton, np.zeros(3), one)
        take = retarget(take, roles, hero, key_roles, RetargetOptions(plant=False, touch=False)).motion
        notices.append(f"{name}: retargeted to the skeleton of the key frames")
    else:
        order = [take.skeleton.index(n) for n in keys.skeleton.names]
        take = replace(take, quat_wxyz=take.quat_wxyz[:, order], skeleton=replace(keys.skeleton, sliding=()),
                       translations=None)  # fmt: skip
    if abs(take.fps - keys.fps) > 1e-6 * keys.fps:
        notices.append(f"{name}: resampled from {take.fps:g} to {keys.fps:g} frames/s")
        take = resample(take, keys.fps)
    return CapturedTake(name, take, False, tuple(notices))


def mirrored(take: CapturedTake, roles: Mapping[str, int]) -> CapturedTake:
    """The take with left and right exchanged, which is as good a take."""
    return CapturedTake(take.name, mirror(take.motion, roles=roles), True)


def same_skeleton(one: Skeleton, other: Skeleton) -> bool:
    """Whether two skeletons have the same joints and the same bones at rest, so that rotations mean the same."""
    if set(one.names) != set(other.names):
        return False
    order = [one.index(name) for name in other.names]
    parents = [one.names[p] if p >= 0 else "" for p in (one.parents[j] for j in order)]
    if parents != [other.names[p] if p >= 0 else "" for p in other.parents]:
        return False
    fixed = np.array([j > 0 and j not in other.sliding for j in range(len(other))])
    away = np.linalg.norm(one.offsets[order] - other.offsets, axis=1) * fixed
    return bool(away.max() <= _SAME * np.ptp(other.rest_positions, axis=0).max())
