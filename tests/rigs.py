"""Synthetic cameras for tests and benchmarks: rings of cameras that look at one point."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup


def look_at(center: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 0.0, 1.0), roll: float = 0.0) -> FloatArray:
    """cam_from_world (3, 4) of a camera that looks at a point.

    Args:
        center: (3,) metres, of the camera.
        target: (3,) metres, in the middle of its image.
        up: (3,) the direction that is up in its image.
        roll: radians by which the camera is turned about its axis; its image turns the other way.
    """
    center = np.asarray(center, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - center
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    if roll:
        cos, sin = np.cos(roll), np.sin(roll)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]) @ rotation
    return np.column_stack([rotation, -rotation @ center])


def ring_of_cameras(
    cameras: int | Sequence[str],
    *,
    radius: float = 4.0,
    height: float | Sequence[float] = 1.5,
    target: ArrayLike = (0.0, 0.0, 1.0),
    first: float = 0.3,
    angles: Sequence[float] | None = None,
    size: tuple[int, int] = (64, 48),
    focal: float | None = None,
    model: str = "PINHOLE",
    params: Sequence[float] | Sequence[Sequence[float]] | None = None,
) -> CameraGroup:
    """Upright cameras on a circle about the origin, counterclockwise seen from above.

    Args:
        cameras: their names, or how many: `cam1`, `cam2`, ...
        radius: metres.
        height: metres, one for all or one each.
        target: (3,) metres, where all of them look.
        first: angle of the first, radians from the X axis; the others follow at equal distances.
        angles: one each in place of that, radians.
        size: width and height of the images, px.
        focal: px, of a pinhole with its principal point in the middle; 1.1 times the width where it is None.
        model: COLMAP's name of the camera model.
        params: of the model, one list for all or one each, in place of `focal`.
    """
    names = [f"cam{k + 1}" for k in range(cameras)] if isinstance(cameras, int) else list(cameras)
    count, (width, tall) = len(names), size
    if angles is None:
        angles = [2 * np.pi * k / count + first for k in range(count)]
    heights = np.broadcast_to(np.asarray(height, dtype=np.float64), count)
    if params is None:
        focal = 1.1 * width if focal is None else focal
        params = (focal, focal, (width - 1) / 2, (tall - 1) / 2)
    lenses = np.broadcast_to(np.asarray(params, dtype=np.float64), (count, np.shape(params)[-1]))
    made = []
    for name, angle, z, lens in zip(names, angles, heights, lenses, strict=True):
        center = np.array([radius * np.cos(angle), radius * np.sin(angle), z])
        made.append(Camera(name, model, width, tall, tuple(lens.tolist()), look_at(center, target)))
    return CameraGroup(tuple(made))


def rig_around_a_walk(count: int) -> CameraGroup:
    """Full-HD cameras at three heights on a circle of 4.5 m around somebody who walks."""
    return ring_of_cameras(
        count,
        radius=4.5,
        height=[1.3 + 0.25 * (k % 3) for k in range(count)],
        target=(0.2, 0, 0.9),
        first=0.4,
        size=(1920, 1080),
        params=(1200, 1200, 960, 540),
    )
