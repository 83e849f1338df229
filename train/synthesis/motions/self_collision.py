"""Self-penetration of a posed skeleton, limbs seen as capsules."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array


def penetrates(bones: Sequence[str], joints: NDArray[Any], height: NDArray[Any]) -> BoolArray:
    """(B,) whether limbs, seen as capsules between `joints` (B, bones, 3), run through the body. What may touch, may:
    folded arms, a hand on a hip, at the face or on a knee (there it bends at the wrist)."""
    at = {b: joints[:, i] for i, b in enumerate(bones)}
    k = height / 1.7
    neck, pelvis = at["neck01"], at["root"]
    crown = at["head"] + (at["head"] - at["neck01"]) * 0.9
    chest = neck + (pelvis - neck) * 0.15
    bad = np.zeros(len(joints), bool)
    for s, o in (("L", "R"), ("R", "L")):
        elbow, wrist = at["lowerarm01." + s], at["wrist." + s]
        hand, palm = wrist + (wrist - elbow) * 0.45, wrist + (wrist - elbow) * 0.1
        knee, ankle = at["lowerleg01." + s], at["foot." + s]
        bad |= _segment_distance(elbow, hand, chest, pelvis) < 0.13 * k
        bad |= _segment_distance(elbow + (wrist - elbow) * 0.3, hand, neck, crown) < 0.085 * k
        for t in "LR":
            thigh = at["upperleg01." + t], at["lowerleg01." + t]
            shin = at["lowerleg01." + t], at["foot." + t]
            bad |= _segment_distance(elbow + (wrist - elbow) * 0.4, palm, *thigh) < 0.085 * k
            bad |= _segment_distance(wrist, palm, *shin) < 0.07 * k
        bad |= _segment_distance(knee, ankle, at["lowerleg01." + o], at["foot." + o]) < 0.085 * k
        bad |= _segment_distance(knee, ankle, at["upperleg01." + o], at["lowerleg01." + o]) < 0.09 * k
    arms = at["lowerarm01.L"], at["wrist.L"], at["lowerarm01.R"], at["wrist.R"]
    return bad | (_segment_distance(*arms) < 0.05 * k)


def _segment_distance(p1: Float32Array, q1: Float32Array, p2: Float32Array, q2: Float32Array) -> Float32Array:
    """(B,) smallest distance between two segments, sampled at 8 x 8 points: enough to reject a pose."""
    t = np.linspace(0, 1, 8, dtype=np.float32)[:, None]
    a = p1[:, None] + (q1 - p1)[:, None] * t
    b = p2[:, None] + (q2 - p2)[:, None] * t
    return np.asarray(np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min((1, 2)), np.float32)
