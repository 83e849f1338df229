"""Which feet of a motion stand on the ground, by height and speed.

A foot stands where its ankle or its ball is near its lowest height and hardly moves over the ground. Both thresholds
have hysteresis, and contacts and gaps that are too short for a foot are dropped.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import roles_of
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.contacts.footskate import contact_spans

FEET = ("left", "right")
_USUAL_LEG_M = 0.85  # hip to ankle of an adult, whom the thresholds fit


@dataclass(frozen=True)
class ContactOptions:
    """When a foot counts as standing; lengths are of an adult, and scaled by the length of the legs.

    Attributes:
        height: metres above its lowest height under which a point may stand.
        speed: metres per second under which a contact begins.
        leave_speed: metres per second over which it ends.
        ground: metres, the height of the ground; None takes each point's own lowest height (`lowest` quantile), so that
            the joint of an ankle may stand higher than that of a toe.
        lowest: quantile of a point's heights that counts as its lowest.
        shortest: seconds of a contact, and of the gap between two of one foot; shorter ones are dropped.
        smoothing: seconds, standard deviation of a Gaussian over the positions before speeds are taken.
    """

    height: float = 0.045
    speed: float = 0.25
    leave_speed: float = 0.45
    ground: float | None = None
    lowest: float = 0.02
    shortest: float = 0.06
    smoothing: float = 0.015


def foot_joints(skeleton: Skeleton) -> tuple[tuple[int, ...], ...]:
    """Joints of the left and of the right foot: the ankle, and the ball where there is one.

    Raises:
        ValueError: a foot's joint is not recognised by its name.
    """
    roles = roles_of(skeleton.names)
    if missing := [f"{s}_foot" for s in FEET if f"{s}_foot" not in roles]:
        raise ValueError(f"no joint is known to be {missing[0]!r}; the joints are {', '.join(skeleton.names)}")
    return tuple(tuple(roles[f"{s}_{p}"] for p in ("foot", "toe") if f"{s}_{p}" in roles) for s in FEET)


def detect_contacts(motion: Motion, options: ContactOptions | None = None) -> BoolArray:
    """(T, 2) whether the left and the right foot stand on the ground.

    Args:
        motion: Z up, with legs whose joints have known names.
        options: thresholds.

    Raises:
        ValueError: the feet's joints are not recognised.
    """
    options = options or ContactOptions()
    at = motion.joint_positions_world()
    size = leg_length(motion.skeleton) / _USUAL_LEG_M
    out = np.zeros((len(motion), 2), np.bool_)
    for k, joints in enumerate(foot_joints(motion.skeleton)):
        for joint in joints:
            out[:, k] |= point_contacts(at[:, joint], motion.fps, options, size)
        out[:, k] = without_short_runs(out[:, k], round(options.shortest * motion.fps))
    return out


def leg_length(skeleton: Skeleton) -> float:
    """Metres from hip to ankle along the bones, the mean of both legs; ValueError where these are not recognised."""
    roles = roles_of(skeleton.names)
    lengths = []
    for side in FEET:
        joint, top = roles.get(f"{side}_foot", -1), roles.get(f"{side}_thigh", -1)
        if joint < 0 or not skeleton.is_ancestor[top, joint] or top < 0:
            raise ValueError(f"no leg from {side}_thigh to {side}_foot is known by its names")
        length = 0.0
        while joint != top:
            length += float(skeleton.bone_lengths[joint])
            joint = skeleton.parents[joint]
        lengths.append(length)
    return float(np.mean(lengths))


def point_contacts(places: FloatArray, fps: float, options: ContactOptions, size: float = 1.0) -> BoolArray:
    """(T,) whether a point stands on the ground.

    Args:
        places: (T, 3) metres, Z up.
        fps: frames per second.
        options: thresholds, in metres of an adult.
        size: of the body against an adult's.
    """
    if not len(places):
        return np.zeros(0, np.bool_)
    smooth = gaussian_filter1d(places, max(options.smoothing * fps, 1e-3), axis=0, mode="nearest")
    speed = np.linalg.norm(np.gradient(smooth, axis=0), axis=1) * fps if len(places) > 1 else np.zeros(1)
    ground = float(np.quantile(places[:, 2], options.lowest)) if options.ground is None else options.ground
    low = places[:, 2] < ground + options.height * size
    may_stay = low & (speed < options.leave_speed * size)
    stands = low & (speed < options.speed * size)
    out = np.zeros(len(places), np.bool_)
    for a, b in contact_spans(may_stay):
        out[a:b] = stands[a:b].any()
    return out


def without_short_runs(contact: BoolArray, shortest: int) -> BoolArray:
    """(T,) with gaps between contacts, and then contacts, of less than `shortest` frames dropped; not at the ends."""
    out = contact.copy()
    for value in (False, True):
        for a, b in contact_spans(out == value):
            if b - a < shortest and a > 0 and b < len(out):
                out[a:b] = not value
    return out
