"""Spines and necks of different numbers of joints: orientations carried over by arc length."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.motion.retargeting.rig import SIDES, Rig


def chest_of(rig: Rig) -> int:
    """The joint that both arms hang from."""
    tops = [rig.roles.get(f"{side}_clavicle", rig.roles[f"{side}_upper_arm"]) for side in SIDES]
    left, right = (rig.above(rig.parents[j]) for j in tops)
    return next(j for j in left if j in right)


def spine_of(rig: Rig) -> list[int]:
    """The joints from below the hips to the chest; from below the mover where hips are beside the spine."""
    chest = chest_of(rig)
    hips = rig.roles["hips"]
    if chest == hips:
        return []
    return rig.path(chest, hips) or rig.path(chest, 0)


def neck_of(rig: Rig) -> list[int]:
    """The joints from above the chest to the head; empty without a head."""
    return rig.path(rig.roles["head"], chest_of(rig)) if "head" in rig.roles else []


def carry_chain(
    start: FloatArray, source: Rig, theirs: list[int], turns: FloatArray, target: Rig, ours: list[int]
) -> dict[int, FloatArray]:
    """Joint of the target's chain -> (T, 3, 3) its orientation in the world.

    The last joint of both chains has the same orientation, and each between them that of its place along the chain.

    Args:
        start: (T, 3, 3) orientation of what the chains hang from.
        source: rig.
        theirs: its chain; empty: everything follows the start.
        turns: (T, K, 3, 3) of the source.
        target: rig.
        ours: its chain.
    """
    if not theirs:
        return dict.fromkeys(ours, start)
    at, nodes = np.concatenate([[0.0], _shares(source, theirs)]), [start, *(turns[:, j] for j in theirs)]
    out = {}
    for j, share in zip(ours, _shares(target, ours), strict=True):
        k = int(np.clip(np.searchsorted(at, share - 1e-9), 1, len(at) - 1))
        gap = at[k] - at[k - 1]
        weight = float(np.clip((share - at[k - 1]) / gap, 0, 1)) if gap > 1e-9 else 1.0
        low, high = nodes[k - 1], nodes[k]
        if weight > 1 - 1e-9:
            out[j] = high
        else:
            out[j] = low @ exp_so3(weight * log_so3(np.swapaxes(low, -1, -2) @ high))
    return out


def _shares(rig: Rig, chain: list[int]) -> FloatArray:
    """(N,) places of a chain's joints along it, the last at one; evenly where the chain has no length."""
    before = rig.parents[chain[0]]
    steps = np.linalg.norm(np.diff(rig.places[[max(before, 0), *chain]], axis=0), axis=1)
    along = np.cumsum(steps)
    if along[-1] < 1e-6:
        return np.arange(1, len(chain) + 1) / len(chain)
    return np.asarray(along / along[-1])
