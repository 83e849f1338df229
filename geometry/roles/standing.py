"""How a body stands at rest: its axes, or the frame of a motion that serves as rest where the rest pose does not stand.

Files without a rest pose of their own have limbs that lie along one axis, or legs that point up.
"""

from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.facing import unit
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton

_UPRIGHT = 0.85  # cosine between the trunk and an axis of the world above which that axis is up
_STRAIGHT = 0.9962  # of 5 degrees: sides that are nearer to an axis of the world lie along it
_LEGS_DOWN = 0.5  # cosine below which a rest pose does not stand
_FRAMES = 400  # that are looked at for one that stands


def body_axes_at_rest(places: FloatArray, roles: Mapping[str, int]) -> FloatArray:
    """(3, 3) the body's left, back and up as columns; along the world's axes where they nearly are.

    Args:
        places: (J, 3) metres, of a pose that stands.
        roles: thighs and upper arms at least.
    """

    def middle(part: str) -> FloatArray:
        return np.asarray((places[roles[f"left_{part}"]] + places[roles[f"right_{part}"]]) / 2)

    def across(part: str) -> FloatArray:
        return unit(places[roles[f"left_{part}"]] - places[roles[f"right_{part}"]])

    up = _snapped(unit(middle("upper_arm") - middle("thigh")), _UPRIGHT)
    left = across("thigh") + across("upper_arm")
    left = _snapped(unit(left - (left @ up) * up), _STRAIGHT)
    left = unit(left - (left @ up) * up)
    return np.stack([left, np.cross(up, left), up], axis=1)


def standing_pose(
    skeleton: Skeleton, roles: Mapping[str, int], motion: Motion | None = None
) -> tuple[FloatArray, FloatArray]:
    """A pose that stands: the one at rest, or the straightest frame of a motion where legs do not point down at rest.

    Args:
        skeleton: of a file.
        roles: thighs, feet and upper arms at least.
        motion: of it.

    Returns:
        (J, 3) metres and (J, 3, 3) orientations in the world, the identity at rest.
    """
    places = skeleton.rest_positions
    turns = np.tile(np.eye(3), (len(skeleton), 1, 1))
    if motion is not None and len(motion) and _legs_down(places, roles) < _LEGS_DOWN:
        some = motion.select(np.unique(np.linspace(0, len(motion) - 1, _FRAMES).astype(int)))
        world = some.forward()
        best = int(np.argmax([_straightness(frame[:, :3, 3], roles) for frame in world]))
        places, turns = world[best, :, :3, 3], world[best, :, :3, :3]
    return places, turns


def _snapped(vector: FloatArray, cosine: float) -> FloatArray:
    axis = int(np.argmax(np.abs(vector)))
    return np.eye(3)[axis] * np.sign(vector[axis]) if abs(vector[axis]) > cosine else vector


def _legs_down(places: FloatArray, roles: Mapping[str, int]) -> float:
    trunk = sum(places[roles[f"{s}_upper_arm"]] - places[roles[f"{s}_thigh"]] for s in ("left", "right"))
    legs = sum(places[roles[f"{s}_foot"]] - places[roles[f"{s}_thigh"]] for s in ("left", "right"))
    return -float(unit(np.asarray(trunk)) @ unit(np.asarray(legs)))


def _straightness(places: FloatArray, roles: Mapping[str, int]) -> float:
    """How straight and upright a pose stands."""
    out = 0.0
    for s in ("left", "right"):
        hip, knee, ankle = (places[roles[f"{s}_{part}"]] for part in ("thigh", "shin", "foot"))
        shoulder = places[roles[f"{s}_upper_arm"]]
        out += unit(hip - knee)[2] + unit(knee - ankle)[2] + unit(shoulder - hip)[2]
    return float(out)
