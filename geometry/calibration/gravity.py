"""Which way is up, as a rig's cameras tell it.

People are read in crops that stand upright, and a calibration's Z axis says where up is. Many calibrations know nothing
of it: their world is the first camera's, or a board's that somebody held. But cameras are mostly hung level, and where
several that look different ways all lean to one side by the same world direction, it is the world that leans.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.world import facing, moved
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet

# How cameras are hung: level to within some degrees; or each of them on its side or head, or anyhow; or all of a rig in
# the same way, on one side or on their heads.
_ROLL_SD, _SIDEWAYS, _ANYHOW = math.radians(4.0), 0.15, 0.1
_ALIKE, _ALIKE_SHARE = (math.pi / 2, -math.pi / 2, math.pi), 0.04
# They look a little down, mostly; or anywhere.
_DOWN, _DOWN_SD, _STEEPLY = math.radians(10.0), math.radians(25.0), 0.1
# Looking up or down more steeply than this (cosine), no side of the picture is up.
_STEEP = 0.35
# Shares of calibrations whose Z axis is not up, and points down, and how much likelier than not it has to be.
_LEANING, _UPSIDE_DOWN, _ODDS = 0.15, 0.02, 100.0
# A camera looks straight up if the cosine is above this.
_STRAIGHT_UP = 1 - 1e-9
# How people stand: upright to within so much, or anyhow; and what any number of moments of one take tell, in moments
# that know nothing of each other.
_STAND_SD, _NOT_STANDING, _MOMENTS = math.radians(12.0), 0.3, 3.0
# Legs and trunk that make a smaller angle (cosine) are not those of somebody who stands.
_STRAIGHT = math.cos(math.radians(35.0))
# Directions that are tried; their distance is a third of the spread of rolls.
_DIRECTIONS = 20_000
# Directions this near to the best one are averaged, radians.
_NEAR = math.radians(6.0)


def believed_up(cameras: CameraGroup, standing: FloatArray | None = None) -> FloatArray:
    """(3,) the unit vector that is up: world Z, unless the cameras together say otherwise.

    Three explanations are weighed (Bayes): that Z is up and every camera hangs as it does, that it is down, or that up
    is any direction, all being as likely, and cameras are hung level as they mostly are. Where a camera would look
    straight up the world is that camera's own, as programs make it that know no other.

    Args:
        cameras: at least one.
        standing: (N, 3) from people's feet to their shoulders, see `standing_axes`: what they say counts with what the
            cameras do.
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


def level(cameras: CameraGroup, points: FloatArray) -> FloatArray:
    """(3, 4) new_from_old: Z along what the cameras take for up, the origin in the middle of `points`.

    A guess for rigs of which nothing else is known. The first camera looks along +Y.

    Args:
        cameras: any world.
        points: (N, 3) metres, at least one.
    """
    up = _likeliest(_log_likelihood(cameras.cam_from_world[:, :, :3], _sphere()))
    return facing(cameras, up, np.median(points, axis=0))


def _likeliest(log_likelihood: FloatArray) -> FloatArray:
    """(3,) the mean of the directions near the best one, of `_sphere`'s."""
    near = _sphere() @ _sphere()[log_likelihood.argmax()] > math.cos(_NEAR)
    mean = np.exp(log_likelihood[near] - log_likelihood.max()) @ _sphere()[near]
    return np.asarray(mean / np.linalg.norm(mean))


def standing_axes(points_world: FloatArray, landmarks: LandmarkSet) -> FloatArray:
    """(N, 3) unit vectors from the ankles to the shoulders of whoever is stretched out, standing most likely.

    Args:
        points_world: (K, J, 3) people, NaN where unknown.
        landmarks: what the J are; without shoulders, hips and ankles nothing is known.
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


def levelled(cameras: CameraGroup, standing: FloatArray | None = None) -> CameraGroup:
    """The same cameras in a world whose Z axis is `believed_up`; themselves where it is so already."""
    up = believed_up(cameras, standing)
    if up[2] == 1.0:
        return cameras
    return moved(cameras, facing(cameras, up, np.zeros(3)))


def on_their_heads(cameras: CameraGroup) -> bool:
    """Whether all cameras would hang upside down if Z were up: a ceiling's do, and so do those of a world whose Z
    points down, as that of a board on the floor may. How cameras hang cannot tell; people who stand can."""
    x, y = cameras.cam_from_world[:, 0, 2], cameras.cam_from_world[:, 1, 2]
    return bool((np.hypot(x, y) > _STEEP).all() and (np.abs(np.arctan2(x, -y)) > math.pi - 4 * _ROLL_SD).all())


def lean_note(cameras: CameraGroup, standing: FloatArray | None = None) -> tuple[str, ...]:
    """A note where up is not believed to be the world's Z axis."""
    up = believed_up(cameras, standing)
    if up[2] == 1.0:
        return ()
    axis = int(np.argmax(np.abs(up)))
    where = f"about the calibration's {'-' if up[axis] < 0 else '+'}{'XYZ'[axis]} axis and not +Z"
    if axis == 2 and up[2] > 0:
        where = f"{math.degrees(math.acos(up[2])):.0f} degrees off the calibration's Z axis"
    told = "seen from the cameras" if standing is None else "by the cameras and who stands before them"
    return (
        f"{told}, up is {where}: people are detected upright all the same, but results keep the calibration's axes",
    )


def _log_likelihood(rotations: FloatArray, directions: FloatArray) -> FloatArray:
    """(N,) how well cameras (C, 3, 3) are hung if up is a direction (N, 3)."""
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
    """(N,) how well people who are stretched out along axes (K, 3) stand if up is a direction (N, 3)."""
    away = np.arccos(np.clip(directions @ axes.T, -1, 1))
    # On a sphere a spread of so much is of this density.
    peak = (1 - _NOT_STANDING) / (2 * np.pi * _STAND_SD**2) * np.exp(-0.5 * (away / _STAND_SD) ** 2)
    independent = min(1.0, _MOMENTS / max(1, len(axes)))
    return np.asarray(independent * np.log(peak + _NOT_STANDING / (4 * np.pi)).sum(axis=1))


def _normal(x: FloatArray, sd: float) -> FloatArray:
    return np.asarray(np.exp(-0.5 * (x / sd) ** 2) / (sd * math.sqrt(2 * math.pi)))


@cache
def _sphere() -> FloatArray:
    """(N, 3) directions spread evenly (a Fibonacci lattice)."""
    k = np.arange(_DIRECTIONS) + 0.5
    z, angle = 1 - 2 * k / _DIRECTIONS, np.pi * (1 + math.sqrt(5)) * k
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
