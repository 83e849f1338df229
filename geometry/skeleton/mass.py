"""The centre of mass of a body, by the masses of its segments.

Source: P. de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", Journal of Biomechanics 29,
1996: shares of the body's mass (men), and where along a segment its centre lies, here between joint centres.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray


@dataclass(frozen=True)
class Segment:
    """A part of the body between two joints.

    Attributes:
        start, end: roles of the joints, as in `muybridge.geometry.skeleton.profiles`.
        share: of the body's mass.
        centre: where its centre of mass lies from `start` to `end`; above one: beyond `end`.
    """

    start: str
    end: str
    share: float
    centre: float


_LIMBS = (
    ("thigh", "shin", 0.1416, 0.41), ("shin", "foot", 0.0433, 0.44), ("foot", "toe", 0.0137, 0.44),
    ("upper_arm", "forearm", 0.0271, 0.58), ("forearm", "hand", 0.0162, 0.46), ("hand", "middle_1", 0.0061, 0.8),
)  # fmt: skip
SEGMENTS: tuple[Segment, ...] = (
    Segment("hips", "neck", 0.4346, 0.45), Segment("neck", "head", 0.0694, 1.4),
    *(Segment(f"{s}_{a}", f"{s}_{b}", m, c) for s in ("left", "right") for a, b, m, c in _LIMBS),
)  # fmt: skip


def centre_of_mass(positions: FloatArray, joints: Mapping[str, int]) -> FloatArray:
    """(T, 3) the body's centre of mass.

    Args:
        positions: (T, J, 3) metres, of the joints.
        joints: index of each joint by its role (`profiles.roles_of`). Where a toe or a finger is missing, its segment's
            mass is at the foot or hand.

    Raises:
        ValueError: another joint is missing; the message names it.
    """
    out, total = np.zeros((len(positions), 3)), 0.0
    for segment in SEGMENTS:
        part = segment.end.split("_", 1)[-1]
        end = segment.start if part in ("toe", "middle_1") and segment.end not in joints else segment.end
        if missing := [name for name in (segment.start, end) if name not in joints]:
            raise ValueError(f"the centre of mass needs the joint {missing[0]!r}; there are {', '.join(joints)}")
        i, j = joints[segment.start], joints[end]
        out += segment.share * (positions[:, i] * (1 - segment.centre) + positions[:, j] * segment.centre)
        total += segment.share
    return out / total
