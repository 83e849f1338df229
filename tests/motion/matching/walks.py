"""Made walks: a body whose limbs swing while it goes along an arc."""

import numpy as np

from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_rotvec
from muybridge.geometry.roles import find_roles
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import placed


def walk(
    seconds: float = 4.0,
    speed: float = 1.2,
    turn_deg: float = 0.0,
    fps: float = 60.0,
    still: bool = False,
) -> Motion:
    """A walk that faces along its way, begins at the origin along X, and turns by so many degrees per second."""
    skeleton = BODY.skeleton(prior_shape(1.74))
    count = round(seconds * fps) + 1
    t = np.arange(count) / fps
    phases = np.random.default_rng(0).uniform(0, 2 * np.pi, (len(skeleton), 3))
    size = np.where(np.arange(len(skeleton)) > 0, 0.0 if still else 0.2, 0.0)[:, None]
    turns = size * np.sin(2 * np.pi * 0.9 * t[:, None, None] + phases)
    standing = Motion(skeleton, fps, np.tile([0.0, 0.0, 1.0], (count, 1)), continuous_quat(quat_from_rotvec(turns)))
    yaw = np.radians(turn_deg) * t
    middle = (yaw[1:] + yaw[:-1]) / 2
    way = np.cumsum(np.vstack([np.zeros(2), speed / fps * np.stack([np.cos(middle), np.sin(middle)], axis=1)]), axis=0)
    ahead = facing_at_rest(skeleton)
    return placed(standing, yaw - ahead, np.column_stack([way, np.zeros(count)]))


def facing_at_rest(skeleton) -> float:
    """Radians from X to where the rest pose faces: a quarter turn clockwise of its left."""
    roles = find_roles(skeleton).roles
    left = skeleton.rest_positions[[roles[n] for n in ("left_thigh", "right_thigh")]]
    x, y, _ = left[0] - left[1]
    return float(np.arctan2(-x, y))


def walks(fps: float = 60.0) -> tuple[list[Motion], list[str]]:
    """Walks of several speeds and curves, with names."""
    kinds = [(1.2, 0.0), (1.2, 40.0), (1.2, -40.0), (0.6, 0.0), (2.0, 0.0)]
    return (
        [walk(4.0, speed, turn, fps) for speed, turn in kinds],
        [f"walk_{speed:g}_{turn:g}" for speed, turn in kinds],
    )
