"""Estimation of the vertical from the cameras of a rig and from the people in view.

People are cropped upright, and the Z axis of a calibration is assumed to be up. In many calibrations it is not: their
world is the first camera's, or that of a hand-held board. But cameras are usually mounted level, and where several that
look in different directions are tilted by the same world rotation, it is the world that is tilted.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.world import facing_transform, transform_cameras
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet

# Camera roll: level within some degrees; or sideways or upside down for single cameras, or arbitrary; or the same for
# all cameras of a rig, sideways or upside down.
_ROLL_SD, _SIDEWAYS, _ANYHOW = math.radians(4.0), 0.15, 0.1
_ALIKE, _ALIKE_SHARE = (math.pi / 2, -math.pi / 2, math.pi), 0.04
# Camera pitch: usually slightly down, or arbitrary.
_DOWN, _DOWN_SD, _STEEPLY = math.radians(10.0), math.radians(25.0), 0.1
# For cameras that look up or down more steeply than this (cosine), roll says nothing.
_STEEP = 0.35
# Prior probabilities that Z is not vertical and that it points down, and the odds required to conclude it.
_LEANING, _UPSIDE_DOWN, _ODDS = 0.15, 0.02, 100.0
# A camera looks straight up above this cosine.
_STRAIGHT_UP = 1 - 1e-9
# People stand upright within some degrees, or are in another pose; and the number of independent observations in one
# take.
_STAND_SD, _NOT_STANDING, _MOMENTS = math.radians(12.0), 0.3, 3.0
# Angle between legs and trunk (cosine) below which a person does not stand.
_STRAIGHT = math.cos(math.radians(35.0))
# Number of directions tried; their spacing is a third of the spread of rolls.
_DIRECTIONS = 20_000
# Directions this near to the best one are averaged, radians.
_NEAR = math.radians(6.0)


def estimate_up(cameras: CameraGroup, standing: FloatArray | None = None) -> FloatArray:
    """(3,) unit vector that points up: world Z, unless the cameras together contradict it.

    Three hypotheses are compared (Bayes): that Z is up and the cameras have any orientation, that Z is down, and that
    up is any direction with equal probability and the cameras are mounted level as usual. A camera that would look
    straight up indicates that the world is that camera's own, as in programs that know no other.

    Args:
        cameras: at least one.
        standing: (N, 3) from people's feet to their shoulders, see `standing_axes`; used in addition to the cameras.
    """
    z_up = np.array([0.0, 0.0, 1.0])
    rotations = cameras.cam_from_world[:, :, :3]
    standing = np.empty((0, 3)) if standing is None else standing
    each = _log_likelihood(rotations, _sphere()) + _log_standing(standing, _sphere())
    most = float(each.max())
    leaning = most + math.log(np.exp(each - most).mean()) + math.log(_LEANING)
    ways = np.stack([z_up, -z_up])
    upright, down = _log_likelihood(rotations, ways) + _log_standing(standing, ways)
    upright, down = float(upright) + math.log(1 - _LEANING - _UPSIDE_DOWN), float(down) + math.log(_UPSIDE_DOWN)
    its_own = rotations[:, 2, 2].max() > _STRAIGHT_UP
    if max(leaning, down) - upright < math.log(_ODDS) and not its_own:
        return z_up
    return -z_up if down > leaning and not its_own else _likeliest(each)


def level_transform(cameras: CameraGroup, points: FloatArray) -> FloatArray:
    """(3, 4) new_from_old with Z along the vertical estimated from the cameras, the origin in the middle of `points`.

    For rigs about which nothing else is known. The first camera looks along +Y.

    Args:
        cameras: any world.
        points: (N, 3) metres, at least one.
    """
    up = _likeliest(_log_likelihood(cameras.cam_from_world[:, :, :3], _sphere()))
    return facing_transform(cameras, up, np.median(points, axis=0))


def _likeliest(log_likelihood: FloatArray) -> FloatArray:
    """(3,) mean of the directions of `_sphere` near the best one."""
    near = _sphere() @ _sphere()[log_likelihood.argmax()] > math.cos(_NEAR)
    mean = np.exp(log_likelihood[near] - log_likelihood.max()) @ _sphere()[near]
    return np.asarray(mean / np.linalg.norm(mean))


def standing_axes(points_world: FloatArray, landmarks: LandmarkSet) -> FloatArray:
    """(N, 3) unit vectors from the ankles to the shoulders of people who are stretched out, and probably stand.

    Args:
        points_world: (K, J, 3) people, metres, NaN where unknown.
        landmarks: the J landmarks; none are found without shoulders, hips and ankles.
    """
    try:
        pairs = [[landmarks.index(f"{side}_{part}") for side in ("left", "right")]
                 for part in ("shoulder", "hip", "ankle")]  # fmt: skip
    except ValueError:
        return np.empty((0, 3))
    shoulders, hips, ankles = (points_world[:, pair].mean(axis=1) for pair in pairs)
    trunk, legs = shoulders - hips, hips - ankles
    with np.errstate(invalid="ignore"):
        cosine = (trunk * legs).sum(-1) / (np.linalg.norm(trunk, axis=-1) * np.linalg.norm(legs, axis=-1))
    axes = (shoulders - ankles)[cosine > _STRAIGHT]
    return np.asarray(axes / np.linalg.norm(axes, axis=-1, keepdims=True))


def level_cameras(cameras: CameraGroup, standing: FloatArray | None = None) -> CameraGroup:
    """The cameras in a world whose Z axis is vertical; unchanged where it is already."""
    up = estimate_up(cameras, standing)
    if up[2] == 1.0:
        return cameras
    return transform_cameras(cameras, facing_transform(cameras, up, np.zeros(3)))


def all_upside_down(cameras: CameraGroup) -> bool:
    """Whether all cameras would be upside down if Z were up.

    This is true for cameras on a ceiling, and for a world whose Z points down, such as that of a board on the floor.
    The cameras cannot distinguish the two; people who stand can.
    """
    x, y = cameras.cam_from_world[:, 0, 2], cameras.cam_from_world[:, 1, 2]
    return bool((np.hypot(x, y) > _STEEP).all() and (np.abs(np.arctan2(x, -y)) > math.pi - 4 * _ROLL_SD).all())


def tilt_notes(cameras: CameraGroup, standing: FloatArray | None = None) -> tuple[str, ...]:
    """A note where the estimated vertical is not the world's Z axis."""
    up = estimate_up(cameras, standing)
    if up[2] == 1.0:
        return ()
    axis = int(np.argmax(np.abs(up)))
    where = f"about the calibration's {'-' if up[axis] < 0 else '+'}{'XYZ'[axis]} axis and not +Z"
    if axis == 2 and up[2] > 0:
        where = f"{math.degrees(math.acos(up[2])):.0f} degrees off the calibration's Z axis"
    source = "according to the cameras" if standing is None else "according to the cameras and the people who stand"
    return (
        f"{source}, up is {where}: people are detected upright all the same, but results keep the calibration's axes",
    )


def _log_likelihood(rotations: FloatArray, directions: FloatArray) -> FloatArray:
    """(N,) log-likelihood of the cameras' rotations (C, 3, 3) if up is a direction (N, 3)."""
    x, y, z = np.moveaxis(directions @ rotations.transpose(0, 2, 1), -1, 0)  # up in each camera, (C, N)
    roll, down = np.arctan2(x, -y), -np.arcsin(np.clip(z, -1, 1))
    turned = np.abs(roll) - np.array([0, np.pi / 2, np.pi])[:, None, None]
    shares = np.array([1 - _SIDEWAYS - _ANYHOW, _SIDEWAYS * 0.4, _SIDEWAYS * 0.2])[:, None, None]
    each = (shares * _normal(turned, _ROLL_SD)).sum(0) + _ANYHOW / (2 * np.pi)
    steep, anyhow = np.hypot(x, y) < _STEEP, 1 / (2 * np.pi)
    ways = [np.log(np.where(steep, anyhow, each)).sum(axis=0)]
    for way in _ALIKE:
        off = (roll - way + np.pi) % (2 * np.pi) - np.pi
        alike = _ALIKE_SHARE ** (1 / len(rotations)) * (_normal(off, _ROLL_SD) + 1e-9)
        ways.append(np.log(np.where(steep, anyhow, alike)).sum(axis=0))
    hung = np.logaddexp.reduce(ways, axis=0)
    looks = (1 - _STEEPLY) * _normal(down - _DOWN, _DOWN_SD) + _STEEPLY / np.pi
    return np.asarray(hung + np.log(looks).sum(axis=0))


def _log_standing(axes: FloatArray, directions: FloatArray) -> FloatArray:
    """(N,) log-likelihood of people's axes (K, 3) if up is a direction (N, 3)."""
    away = np.arccos(np.clip(directions @ axes.T, -1, 1))
    # Density on the sphere of a normal distribution with this spread.
    peak = (1 - _NOT_STANDING) / (2 * np.pi * _STAND_SD**2) * np.exp(-0.5 * (away / _STAND_SD) ** 2)
    independent = min(1.0, _MOMENTS / max(1, len(axes)))
    return np.asarray(independent * np.log(peak + _NOT_STANDING / (4 * np.pi)).sum(axis=1))


def _normal(x: FloatArray, sd: float) -> FloatArray:
    return np.asarray(np.exp(-0.5 * (x / sd) ** 2) / (sd * math.sqrt(2 * math.pi)))


@cache
def _sphere() -> FloatArray:
    """(N, 3) directions spread evenly over the sphere (a Fibonacci lattice)."""
    k = np.arange(_DIRECTIONS) + 0.5
    z, angle = 1 - 2 * k / _DIRECTIONS, np.pi * (1 + math.sqrt(5)) * k
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
