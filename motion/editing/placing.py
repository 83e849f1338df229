"""Where a take is in the world, and how large: turned, moved, put on the floor, scaled."""

from dataclasses import replace
from typing import Literal, cast

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import Editable, T, check_editable, placed, start_place

About = Literal["start", "origin"]
_LOWEST = 0.1  # quantile over the frames of each frame's lowest point


def turn(thing: T, angle: float, about: About = "start") -> T:
    """Turn a take about the vertical, counter-clockwise seen from above.

    Args:
        thing: a motion or points.
        angle: radians.
        about: the vertical through where the body is at the start, or through the origin.

    Raises:
        MuybridgeError: the angle is not a number, or the clip is empty.
    """
    check_editable(thing)
    _check_numbers("the angle", angle)
    angle = float(np.remainder(angle + np.pi, 2 * np.pi) - np.pi) if abs(angle) > 2 * np.pi else angle
    centre = start_place(thing) * (1.0, 1.0, 0.0) if about == "start" else np.zeros(3)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1], 0.0])
    return placed(thing, angle, centre - turned)


def move(thing: T, x: float = 0.0, y: float = 0.0, z: float = 0.0, start: Literal["here", "origin"] = "here") -> T:
    """Move a take.

    Args:
        thing: a motion or points.
        x: metres, to the left of somebody who faces -Y.
        y: metres, backward of somebody who faces -Y.
        z: metres, up.
        start: "origin" puts the start of the take over the origin first.

    Raises:
        MuybridgeError: a distance is not a number, or the clip is empty.
    """
    check_editable(thing)
    _check_numbers("the distance", x, y, z)
    origin = start_place(thing) * (1.0, 1.0, 0.0) if start == "origin" else np.zeros(3)
    return placed(thing, 0.0, np.array([x, y, z]) - origin)


def lowest_height(thing: Editable) -> float:
    """Metres, of the lowest joint, bone end or point: the 10 % quantile over the frames, which noise hardly moves."""
    check_editable(thing)
    if isinstance(thing, Points3D):
        known = np.isfinite(thing.points_world[..., 2]).any(axis=1)
        return float(np.quantile(np.nanmin(thing.points_world[known, :, 2], axis=1), _LOWEST))
    world = thing.forward()
    heights = [world[..., 2, 3]]
    ends = np.flatnonzero(np.isfinite(thing.skeleton.tips).all(axis=1))
    if len(ends):
        heights.append(np.einsum("tjk,jk->tj", world[:, ends, 2, :3], thing.skeleton.tips[ends]) + world[:, ends, 2, 3])
    return float(np.quantile(np.concatenate(heights, axis=1).min(axis=1), _LOWEST))


def put_on_floor(thing: T, height: float = 0.0) -> T:
    """Move a take up or down, so that its lowest joint, bone end or point stands at a height.

    Args:
        thing: a motion or points.
        height: metres, that the lowest point has: zero for soles, the thickness of the foot for ankles.

    Raises:
        MuybridgeError: the height is not a number, or the clip is empty.
    """
    _check_numbers("the height", height)
    return placed(thing, 0.0, np.array([0.0, 0.0, height - lowest_height(thing)]))


def scale(thing: T, factor: float) -> T:
    """Scale a take about the origin: bones and paths.

    Args:
        thing: a motion or points.
        factor: above zero.

    Raises:
        MuybridgeError: the factor is not above zero, or the clip is empty.
    """
    check_editable(thing)
    if not 0 < factor < np.inf:
        raise MuybridgeError(f"the factor must be above zero, not {factor:g}")
    if isinstance(thing, Points3D):
        return cast(T, _scaled_points(thing, factor))  # type: ignore[redundant-cast]
    return cast(T, _scaled_motion(thing, factor))  # type: ignore[redundant-cast]


def _scaled_points(points: Points3D, factor: float) -> Points3D:
    return replace(
        points, points_world=points.points_world * factor, covariance_world=points.covariance_world * factor**2
    )


def _scaled_motion(motion: Motion, factor: float) -> Motion:
    skeleton = replace(motion.skeleton, offsets=motion.skeleton.offsets * factor, tips=motion.skeleton.tips * factor)
    return Motion(
        skeleton,
        motion.fps,
        motion.root_positions_world * factor,
        motion.quat_wxyz,
        None if motion.translations is None else motion.translations * factor,
    )


def _check_numbers(what: str, *values: float) -> None:
    if not np.isfinite(values).all():
        raise MuybridgeError(f"{what} must be a number, not {', '.join(f'{v:g}' for v in values)}")
