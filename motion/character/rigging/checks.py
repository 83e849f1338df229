"""What is no body, told on a coarse volume, before anything is measured on a fine one."""

from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.motion.character.rigging.landmarks import NoBody, branches_of, feet_of_animal
from muybridge.motion.character.rigging.paths import Branch
from muybridge.motion.character.rigging.volume import fill_volume

_COARSE = 64  # cells along the longest extent
_LUMP = 0.38  # of that extent: a ball that large within a body leaves no room for limbs; half of it is a ball alone
_WINDING = 1.5  # of it, which a straight way through a body cannot reach; ways through loose faces wind
_LOW = 0.35  # of it: who stands upright is taller, whatever the arms do
_LEG = 0.3  # of the height that a leg is long at least, from end to trunk
_ARM = 0.1  # of the height that some of a body with arms is off its middle, above its feet
_FEET = 0.15  # of the height
_FAR_APART = 0.1  # of the height between the feet of a body, if two of them are on one side
_HEAD = 0.8  # of the height from which an end may be a head
_BESIDE = 0.25  # of the height that the head of a body beside another is off the middle


def check_body(vertices: FloatArray, triangles: IntArray, four_legs: bool) -> None:
    """Refuse what cannot be a body, from its coarse volume.

    Args:
        vertices: (V, 3) metres, in a frame in which it stands on z = 0, faces -Y and is symmetric about x = 0.
        triangles: (F, 3) outwards.
        four_legs: whether it may stand on four legs.

    Raises:
        NoBody: it is a ball, loose faces, a scene, an animal, or two bodies that touch, or too narrow to have arms.
    """
    volume = fill_volume(vertices, triangles, _COARSE)
    extent = np.ptp(vertices[np.unique(triangles)], axis=0)
    longest = float(extent.max())
    if volume.radius.max() > _LUMP * longest:
        raise NoBody("it is one lump without limbs, or something around it hides them")
    branches, height = branches_of(volume)
    if max((branch.reach for branch in branches), default=0.0) > _WINDING * longest:
        raise NoBody("its faces enclose nothing, so it is no surface of a body")
    if four_legs:
        return
    if extent[2] < _LOW * longest:
        raise NoBody(f"it is {extent[2]:.2g} m tall and {longest:.2g} m wide; leave out what is no part of the body, "
                     "such as a floor")  # fmt: skip
    if feet_of_animal(branches, height):
        raise NoBody("it stands on four legs", four_legs=True)
    if _stand_beside_each_other(branches, height):
        raise NoBody("it is two bodies that touch; save each in a file of its own")
    used = vertices[np.unique(triangles)]
    if np.abs(used[used[:, 2] > _FEET * extent[2], 0]).max(initial=0.0) < _ARM * extent[2]:
        raise NoBody("no arms were found")


def _stand_beside_each_other(branches: Sequence[Branch], height: float) -> bool:
    """Whether there are two legs and a head on either side, and no head in the middle.

    The plane of symmetry of two bodies that are alike is between them.
    """
    tips = np.array([branch.points[0] for branch in branches]).reshape(-1, 3) / height
    long = np.array([np.linalg.norm(b.at(b.free) - b.points[0]) > _LEG * height for b in branches], np.bool_)
    low, high = (tips[:, 2] < 1 - _HEAD) & long, tips[:, 2] > _HEAD
    if (high & (np.abs(tips[:, 0]) < _FAR_APART)).any():
        return False
    for sign in (1.0, -1.0):
        across = sign * tips[:, 0]
        feet = across[low & (across > 0)]
        if not (high & (across > _BESIDE)).any() or len(feet) < 2 or np.ptp(feet) < _FAR_APART:
            return False
    return True
