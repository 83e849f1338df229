"""Contacts of several motions that are one contact, and when it is in their blend.

Kovar and Gleicher 2003, "Flexible Automatic Motion Blending with Registration Curves", section 3.3: over the common
parameter, contacts of one point that overlap match, and begin and end in the blend at the weighted means of where they
do in the motions. A foot that stands in all of them so stands in the blend.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.motion.contacts.footskate import contact_spans

Spans = list[tuple[float, float]]


@dataclass(frozen=True, eq=False)
class ConstraintMatch:
    """One contact in each motion.

    Attributes:
        start: (N,) where it begins in each, over the common parameter.
        end: (N,) where it ends.
    """

    start: FloatArray
    end: FloatArray


def match_spans(spans: Sequence[Spans]) -> tuple[list[ConstraintMatch], list[list[Spans]]]:
    """Contacts that match, and those that have no counterpart in some motion.

    Args:
        spans: of each motion, the contacts of one point in their order, over the common parameter.

    Returns:
        The matches; and of each other group of overlapping contacts, the spans of each motion.
    """
    every = sorted((a, b, k) for k, of_motion in enumerate(spans) for a, b in of_motion)
    groups: list[list[Spans]] = []
    reach = -np.inf
    for a, b, k in every:
        if a > reach:
            groups.append([[] for _ in spans])
        groups[-1][k].append((a, b))
        reach = max(reach, b)
    matches, rest = [], []
    for group in groups:
        counts = {len(of_motion) for of_motion in group}
        if counts == {0} or len(counts) > 1:
            rest.append(group)
            continue
        for each in zip(*group, strict=True):
            start, end = np.array(each).T
            matches.append(ConstraintMatch(start, end))
    return matches, rest


def blended_contacts(
    contacts: Sequence[BoolArray], frames: FloatArray, u: FloatArray, weights: FloatArray
) -> BoolArray:
    """(U,) whether one point stands in the blend.

    Args:
        contacts: of each motion (T,), whether the point stands.
        frames: (N, U) frame of each motion at each frame of the blend, increasing.
        u: (U,) the parameter at each frame of the blend.
        weights: (N, U) of the motions.
    """
    spans: list[Spans] = []
    for contact, at in zip(contacts, frames, strict=True):
        inside = [(a, b) for a, b in contact_spans(contact) if b > at[0] and a <= at[-1]]
        spans.append([(_u_of(a, at, u), _u_of(b - 1, at, u)) for a, b in inside])
    matches, rest = match_spans(spans)
    out = np.zeros(len(u), np.bool_)
    for match in matches:
        out |= (u >= match.start @ weights - 1e-9) & (u <= match.end @ weights + 1e-9)
    for group in rest:  # it stands where the motions that count more than half stand
        votes = np.zeros(len(u))
        for k, of_motion in enumerate(group):
            for a, b in of_motion:
                votes += weights[k] * ((u >= a) & (u <= b))
        out |= votes > 0.5
    return out


def _u_of(frame: float, at: FloatArray, u: FloatArray) -> float:
    """Where a motion has a frame; beyond the blend's ends, as far as frames go on evenly."""
    if frame < at[0]:
        return float(u[0] - (at[0] - frame))
    if frame > at[-1]:
        return float(u[-1] + (frame - at[-1]))
    return float(np.interp(frame, at, u))
