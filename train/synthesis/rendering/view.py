"""Pinhole views for rendering."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray

NEAR, FAR = 0.1, 60.0  # clipping planes, metres


@dataclass(frozen=True)
class View:
    """A pinhole view.

    Attributes:
        cam_from_world: (3, 4), OpenCV axes.
        focal_px: focal length.
        principal_px: principal point; (0, 0) is the centre of the top-left pixel.
        width, height: pixels.
    """

    cam_from_world: FloatArray
    focal_px: float
    principal_px: tuple[float, float]
    width: int
    height: int

    def project(self, points_world: NDArray[np.floating]) -> tuple[FloatArray, FloatArray]:
        """(..., 3) -> pixels (..., 2) and depth (...)."""
        cam = points_world @ self.cam_from_world[:, :3].T + self.cam_from_world[:, 3]
        uv = cam[..., :2] / cam[..., 2:] * self.focal_px + np.array(self.principal_px)
        return uv, cam[..., 2]

    @property
    def clip_from_world(self) -> FloatArray:
        """OpenGL's clip matrix; image row 0 is at the top after a vertical flip of the result."""
        w, h, f = self.width, self.height, self.focal_px
        cx, cy = self.principal_px[0] + 0.5, self.principal_px[1] + 0.5
        clip = np.zeros((4, 4))
        clip[0, 0], clip[0, 2] = 2 * f / w, 2 * cx / w - 1
        clip[1, 1], clip[1, 2] = -2 * f / h, 1 - 2 * cy / h
        clip[2, 2], clip[2, 3] = (FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
        clip[3, 2] = 1
        return np.asarray(clip @ np.vstack([self.cam_from_world, [0, 0, 0, 1]]))


def look_at(center_world: FloatArray, target_world: FloatArray, roll: float = 0.0) -> FloatArray:
    """cam_from_world (3, 4), OpenCV axes, of a camera at `center_world` that looks at a point, with `roll` in
    radians."""
    z = target_world - center_world
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    c, s = np.cos(roll), np.sin(roll)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ np.stack([x, y, z])
    return np.concatenate([rotation, -rotation @ center_world[:, None]], 1)


def direction_from_angles(azimuth: float, elevation: float) -> FloatArray:
    """(3,) unit vector, Z up; radians."""
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def target_of_pixel(view: View, px: FloatArray, eye: FloatArray, distance: float) -> FloatArray:
    """(3,) the point that `view`, a camera at `eye`, sees at the pixel (2,) at depth `distance`."""
    offset = (px - np.array(view.principal_px)) / view.focal_px
    return np.asarray(eye + view.cam_from_world[:, :3].T @ np.array([*offset, 1.0]) * distance)
