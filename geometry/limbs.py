"""Limbs that are far longer than this person's: an elbow that two views put where a hand of somebody else was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.landmarks import LandmarkSet

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
# A bone so many times as long as this person's is none; noise and a trunk's landmark that is off do not do that. Two
# bones in a row cannot both be off as much.
_STRETCHED, _STRETCHED_TWO = 1.6, 1.3
# A bone whose length typically varies by more than this share of itself is not known; nobody's is longer than this, m.
_SPREAD, _LONGEST = 0.15, 0.75
# Frames of either side in which a bone is known, at least, for its length to be known.
_LEAST = 8


def stretched_limbs(points_world: NDArray[np.float64], landmarks: LandmarkSet) -> NDArray[np.bool_]:
    """Elbows, wrists, knees and ankles that lie too far from the trunk.

    A bone's length is the median over the take and both sides; where it varies too much to be known, only what is
    longer than anybody's bone is wrong (unless all are, in a world that is not in metres). From the trunk outwards, the
    first joint that is too far from the one before is wrong; beyond it a joint is judged by its distance from the last
    one that is right.

    Args:
        points_world: (T, J, 3) metres, NaN where unknown.
        landmarks: what the J are.

    Returns:
        (T, J) True where a point cannot be right.
    """
    wrong = np.zeros(points_world.shape[:2], dtype=np.bool_)
    for names in _LIMBS:
        sides = [[f"{side}_{name}" for name in names] for side in ("left", "right")]
        if any(name not in landmarks.names for side in sides for name in side):
            continue
        chains = [points_world[:, [landmarks.index(name) for name in side]] for side in sides]
        lengths = [np.linalg.norm(np.diff(chain, axis=1), axis=-1) for chain in chains]
        bones = np.concatenate(lengths)
        if (np.isfinite(bones).sum(0) < _LEAST).any():
            continue
        usual = np.nanmedian(bones, axis=0)
        steady = np.nanmedian(np.abs(bones - usual), axis=0) < _SPREAD * usual
        longest = np.where(steady, _STRETCHED * usual, np.where(usual < _LONGEST, _LONGEST, np.inf))
        reach = _STRETCHED_TWO * usual.sum() if steady.all() else longest.sum()
        for side, chain, length in zip(sides, chains, lengths, strict=True):
            middle, end = (length > longest).T
            far = np.linalg.norm(chain[:, 2] - chain[:, 0], axis=-1) > reach
            wrong[:, landmarks.index(side[1])] = middle
            wrong[:, landmarks.index(side[2])] = np.where(middle, far, end)
    return wrong
