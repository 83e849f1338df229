"""Origin, axes and size of a calibration's world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import CalibrationError
from muybridge.geometry.cameras import Camera, CameraGroup

Floats = NDArray[np.float64]


def moved(cameras: CameraGroup, new_from_old: Floats, scale: float = 1.0) -> CameraGroup:
    """The same cameras in another world.

    Args:
        cameras: in the old world.
        new_from_old: (3, 4) rotation | translation of x_new = R (scale x_old) + t.
        scale: new metres per old metre.
    """
    rotation, shift = new_from_old[:, :3], new_from_old[:, 3]
    posed: list[Camera] = []
    for camera in cameras:
        turned = camera.rotation @ rotation.T
        center = scale * rotation @ camera.center_world + shift
        posed.append(camera.posed(np.column_stack([turned, -turned @ center])))
    return CameraGroup(tuple(posed))


def level(cameras: CameraGroup, points: Floats) -> Floats:
    """(3, 4) new_from_old: Z along what the cameras take for up, the origin in the middle of `points`.

    A guess for rigs of which nothing else is known: cameras are mostly held level, so that up is about minus their
    y axes. The first camera looks along +Y.

    Args:
        cameras: any world.
        points: (N, 3) metres, at least one.
    """
    up = -cameras.cam_from_world[:, 1, :3].mean(axis=0)
    if np.linalg.norm(up) < 0.3:  # no agreement: the first camera's own up
        up = -cameras[0].rotation[1]
    return facing(cameras, up / np.linalg.norm(up), np.median(points, axis=0))


def facing(cameras: CameraGroup, up: Floats, origin: Floats) -> Floats:
    """(3, 4) new_from_old with Z along the unit vector `up`, +Y where the first camera looks, `origin` at zero."""
    forward = cameras[0].rotation[2] - up * (cameras[0].rotation[2] @ up)
    if np.linalg.norm(forward) < 0.1:  # it looks straight down: the top of its image
        forward = -cameras[0].rotation[1] + up * (cameras[0].rotation[1] @ up)
    forward /= np.linalg.norm(forward)
    rotation = np.stack([np.cross(forward, up), forward, up])
    return np.column_stack([rotation, -rotation @ origin])


def on_board(cameras: CameraGroup, world_from_board: Floats) -> Floats:
    """(3, 4) new_from_old with the board as the floor: its first corner the origin, +X along its columns, Z up.

    Up is the side of the board on which the cameras are.

    Args:
        cameras: the cameras that saw it.
        world_from_board: (3, 4).

    Raises:
        CalibrationError: cameras are on both sides of the board.
    """
    rotation, origin = world_from_board[:, :3].copy(), world_from_board[:, 3]
    height = (cameras.centers_world - origin) @ rotation[:, 2]
    if height.min() < 0 < height.max():
        below = [n for n, h in zip(cameras.names, height, strict=True) if h * np.sign(np.median(height)) < 0]
        raise CalibrationError(
            f"the board cannot lie on the floor: camera {', '.join(below)} would look at it from below; name another "
            "moment, at which the board lay flat on the floor"
        )
    if height.mean() < 0:  # numbered so that its z axis points into the floor: x stays, y and z turn over
        rotation[:, 1:] *= -1
    return np.column_stack([rotation.T, -rotation.T @ origin])
