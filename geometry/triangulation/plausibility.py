"""Detection of uninformative or implausible points: uncertain ones, and ones that stretch a limb of the person.

For example, an elbow that two views place where another person's hand was.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.sets import LandmarkSet

_LIMBS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
# Factor on this person's bone length from which a bone is implausible; noise and a wrong landmark of the trunk do not
# reach it. Of two consecutive bones, both cannot be wrong by as much.
_STRETCHED, _STRETCHED_TWO = 1.6, 1.3
# A bone whose length varies by more than this share is not known; no human bone is longer than the second value, m.
_SPREAD, _LONGEST = 0.15, 0.75
# Minimum number of frames per side in which a bone is known, for its length to be known.
_LEAST = 8
# A point is uninformative above this standard deviation, in trunk lengths: 0.15 m for an adult.
_VAGUE = 0.3


def trunk_of(points_world: FloatArray, landmarks: LandmarkSet) -> FloatArray:
    """(T, 3) from the middle of the hips to the middle of the shoulders of points (T, J, 3).

    NaN where one of the four landmarks is unknown or not in the set.
    """
    ends = [[f"{side}_{name}" for side in ("left", "right")] for name in ("shoulder", "hip")]
    if any(name not in landmarks.names for end in ends for name in end):
        return np.full((len(points_world), 3), np.nan)
    top, bottom = (points_world[:, [landmarks.index(name) for name in end]].mean(axis=1) for end in ends)
    return np.asarray(top - bottom)


def uncertain_points(points_world: FloatArray, covariance_world: FloatArray, landmarks: LandmarkSet) -> BoolArray:
    """Points about which a take says next to nothing: seen by two uncertain views, or by one, which gives no depth.

    Args:
        points_world: (T, J, 3), NaN where unknown.
        covariance_world: (T, J, 3, 3) square metres.
        landmarks: the J landmarks.

    Returns:
        (T, J) True where the mean standard deviation of the coordinates exceeds 0.3 of the distance from the middle
        of the shoulders to that of the hips (median over the take; all False where that is never known).
    """
    length = np.linalg.norm(trunk_of(points_world, landmarks), axis=-1)
    if np.isfinite(length).sum() < _LEAST:
        return np.zeros(points_world.shape[:2], dtype=np.bool_)
    variance = np.trace(covariance_world, axis1=-2, axis2=-1) / 3
    return np.asarray(variance > (_VAGUE * np.nanmedian(length)) ** 2)


def stretched_limbs(points_world: FloatArray, landmarks: LandmarkSet) -> BoolArray:
    """Elbows, wrists, knees and ankles that lie too far from the trunk.

    A bone's length is the median over the take and both sides. Where it varies too much to be known, only bones longer
    than any human bone are rejected (unless all are, in a world that is not in metres). From the trunk outwards, the
    first joint that is too far from the previous one is rejected; a joint beyond it is judged by its distance from the
    last accepted one.

    Args:
        points_world: (T, J, 3) metres, NaN where unknown.
        landmarks: the J landmarks.

    Returns:
        (T, J) True where a point is implausible.
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
