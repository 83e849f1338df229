"""What joints are for by their names, where that is not to be seen in their places."""

import re
from collections.abc import Sequence

import numpy as np

from muybridge.arrays import BoolArray, IntArray

# Words of joints that hold things, steer others, or mark the end of a chain; KayKit and Quaternius, Unity, Unreal,
# Mixamo, Rigify, MotionBuilder and 3ds Max use them so.
_WITHOUT_FLESH = frozenset(
    "slot handslot weaponslot itemslot propslot socket attach attachment weapon prop holster ik target pole ctrl "
    "control controller locator end nub".split()
)


def without_flesh(names: Sequence[str], parents: IntArray) -> BoolArray:
    """(J,) joints that move no skin by their names: slots for props, targets of inverse kinematics, controls, ends.

    A joint with another one below it that is none of these counts as a bone whatever its name.

    Args:
        names: (J,) of the joints.
        parents: (J,) of the joints; -1 for a root.
    """
    out = np.array([bool(_WITHOUT_FLESH & set(_words(name))) for name in names], np.bool_)
    for j in np.flatnonzero(~out):
        above = int(parents[j])
        while above >= 0 and out[above]:
            out[above] = False
            above = int(parents[above])
    return out


def _words(name: str) -> list[str]:
    """`kneeIK.l` to knee, ik, l; `mixamorig:HeadTop_End` to mixamorig, head, top, end."""
    parts = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word.lower() for word in re.findall(r"[A-Za-z]+", parts)]
