"""The unit of a BVH, which the format does not state: given, or recognised by the body's height."""

from pathlib import Path

import numpy as np

from muybridge.errors import FormatError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.points.common import METRES_OF_UNIT
from muybridge.motion.formats.skeletal.bvh import read_bvh_file
from muybridge.motion.take import Take

METRES_OF_LENGTH = METRES_OF_UNIT | {"dm": 0.1, "cmu": 0.0254 / 0.45}
# Height of a body in units, and the unit that this implies. Nothing is guessed outside these ranges, where two units
# would make a person or none does.
_TALL = ((0.4, 3.0, "m"), (11.0, 20.0, "dm"), (20.0, 40.0, "cmu"), (45.0, 85.0, "in"), (100.0, 300.0, "cm"),
         (1000.0, 3000.0, "mm"))  # fmt: skip
_JOINTS_OF_A_BODY = 8


def read_bvh_take(path: Path, units: str | None = None) -> Take:
    """Read a BVH into metres.

    Args:
        path: the file.
        units: m, dm, cm, mm, in or cmu (0.0254 / 0.45 m); None recognises the unit by how tall the body is at rest.

    Raises:
        FormatError: malformed, an unknown unit, or a height that fits none.
    """
    if units is not None:
        if units not in METRES_OF_LENGTH:
            raise FormatError(f"{path}: {units!r} is not a unit; valid are {', '.join(METRES_OF_LENGTH)}")
        motion, notices = read_bvh_file(path, METRES_OF_LENGTH[units])
        return Take(motion=motion, notices=notices)
    motion, notices = read_bvh_file(path)
    tall = _height(motion)
    for low, high, unit in _TALL:
        if low <= tall <= high:
            if unit == "m":
                return Take(motion=motion, notices=notices)
            metres = METRES_OF_LENGTH[unit]
            guess = f"{path.name}: the body is {tall:.4g} units tall, so a unit is taken to be {metres:.4g} m ({unit})"
            return Take(motion=read_bvh_file(path, metres)[0], notices=(*notices, guess))
    if len(motion.skeleton) < _JOINTS_OF_A_BODY:  # not a person, so its height implies nothing
        return Take(motion=motion, notices=notices)
    raise FormatError(
        f"{path}: the body is {tall:.4g} units tall, and BVH does not state what a unit is", remedy="bvh_units",
        units=", ".join(METRES_OF_LENGTH),
    )  # fmt: skip


def _height(motion: Motion) -> float:
    """Largest extent of the joints and tips at rest, in the motion's unit."""
    rest, tips = motion.skeleton.rest_positions, motion.skeleton.tips
    ends = np.concatenate([rest, (rest + tips)[np.isfinite(tips).all(axis=1)]])
    return float(np.ptp(ends, axis=0).max())
