"""Calibrated cameras: projection, unprojection and the effects of cropping, scaling and rotating the image.

Conventions, here and everywhere in the project:

- World: right-handed, Z up, metres. Camera: OpenCV axes (x right, y down, z into the scene).
- Pixel (0, 0) is the **centre** of the top-left pixel, so an image spans -0.5 .. width - 0.5.
- Missing values are NaN, and NaN inputs give NaN results.

The lens models are pycolmap's, whose pixel origin is the **corner** of the top-left pixel. `_colmap_camera` is the only
place where the half pixel between the two is added; `camera_from_colmap` is its inverse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras import _pycolmap as pycolmap

_HALF_PIXEL = 0.5

# Positions of a model's parameters. Models that are not listed here are rejected: they have no pinhole axis
# (EQUIRECTANGULAR) or are unknown to pycolmap.
_SINGLE_FOCAL = (
    "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL", "RADIAL_FISHEYE",
    "SIMPLE_DIVISION", "SIMPLE_FISHEYE",
)  # fmt: skip
_PARAM_COUNT = {
    "SIMPLE_PINHOLE": 3, "PINHOLE": 4, "SIMPLE_RADIAL": 4, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL": 5,
    "RADIAL_FISHEYE": 5, "OPENCV": 8, "OPENCV_FISHEYE": 8, "FULL_OPENCV": 12, "FOV": 5,
    "THIN_PRISM_FISHEYE": 12, "RAD_TAN_THIN_PRISM_FISHEYE": 16, "SIMPLE_DIVISION": 4, "DIVISION": 5,
    "SIMPLE_FISHEYE": 3, "FISHEYE": 4, "EUCM": 6,
}  # fmt: skip
CAMERA_MODELS = tuple(_PARAM_COUNT)
"""Lens models that a `Camera` may have, by pycolmap's names."""

# Models with one focal length and their equivalents with two: (model, number of zeros to append).
_TWO_FOCALS = {
    "SIMPLE_PINHOLE": ("PINHOLE", 0),
    "SIMPLE_RADIAL": ("OPENCV", 3),
    "RADIAL": ("OPENCV", 2),
    "SIMPLE_RADIAL_FISHEYE": ("OPENCV_FISHEYE", 3),
    "RADIAL_FISHEYE": ("OPENCV_FISHEYE", 2),
    "SIMPLE_FISHEYE": ("FISHEYE", 0),
    "SIMPLE_DIVISION": ("DIVISION", 0),
}

# Models with purely radial distortion do not change under a quarter turn; these others have a pair (p1, p2) of
# tangential coefficients at this index.
_RADIAL_ONLY = (*_SINGLE_FOCAL, "PINHOLE", "OPENCV_FISHEYE", "FOV", "DIVISION", "FISHEYE", "EUCM")
_TANGENTIAL_AT = {"OPENCV": 6, "FULL_OPENCV": 6}

# A rotation typed with four decimals is accepted; a scaled, sheared or mirrored one is not.
_ORTHONORMAL_TOLERANCE = 1e-3


def _principal_at(model: str) -> int:
    """Index of cx in a model's parameters; cy follows it, the focal length or lengths precede it."""
    return 1 if model in _SINGLE_FOCAL else 2


# Points at up to this multiple of the angle of the image's corners still count as near the image.
_BESIDE = 1.5


@lru_cache(maxsize=512)
def _steepest(model: str, width: int, height: int, params: tuple[float, ...]) -> float:
    """Tangent of the largest angle between the axis and the rays of the image's border; inf where there are no rays."""
    x, y = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    sides = [np.stack(np.broadcast_arrays(a, b), -1) for a, b in ((x, 0), (x, height - 1), (0, y), (width - 1, y))]
    slopes = _colmap_camera(model, width, height, params).cam_from_img(np.concatenate(sides) + _HALF_PIXEL)
    tangent = np.hypot(*slopes.T)
    return float(tangent[np.isfinite(tangent)].max(initial=0.0)) or np.inf


@lru_cache(maxsize=512)
def _colmap_camera(model: str, width: int, height: int, params: tuple[float, ...]) -> Any:
    """The pycolmap camera that computes projections, with its principal point in the corner convention.

    Cached by value and not stored in the `Camera`, so that cameras pickle, compare and print by their fields.
    """
    corner = list(params)
    at = _principal_at(model)
    corner[at] += _HALF_PIXEL
    corner[at + 1] += _HALF_PIXEL
    return pycolmap.Camera(model=model, width=width, height=height, params=corner)


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera.

    Attributes:
        name: name of the camera; videos are matched to cameras by it.
        model: lens model, one of `CAMERA_MODELS` (pycolmap's names).
        width: of the image, px.
        height: of the image, px.
        params: in pycolmap's order (e.g. OPENCV: fx, fy, cx, cy, k1, k2, p1, p2), the principal point in the convention
            of this project: (0, 0) is the centre of the top-left pixel.
        cam_from_world: (3, 4) rotation | translation, metres, OpenCV camera axes. Stored read-only.

    Raises:
        ValueError: no name, an unknown model, a wrong number of parameters, a size or focal length that is not
            positive, an invalid rotation, or values that are not finite.
    """

    name: str
    model: str
    width: int
    height: int
    params: tuple[float, ...]
    cam_from_world: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "width", int(self.width))
        object.__setattr__(self, "height", int(self.height))
        object.__setattr__(self, "params", tuple(float(p) for p in self.params))
        pose = np.array(self.cam_from_world, dtype=np.float64)
        pose.setflags(write=False)
        object.__setattr__(self, "cam_from_world", pose)
        _check_camera(self)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Camera) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        pose = tuple(self.cam_from_world.ravel().tolist())
        return self.name, self.model, self.width, self.height, self.params, pose

    @property
    def camera_matrix(self) -> FloatArray:
        """(3, 3) with fx, fy, cx, cy in px, without distortion."""
        at = _principal_at(self.model)
        matrix = np.eye(3)
        matrix[0, 0], matrix[1, 1] = self.params[0], self.params[at - 1]
        matrix[:2, 2] = self.params[at : at + 2]
        return matrix

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) rotation of `cam_from_world`."""
        return self.cam_from_world[:, :3]

    @property
    def translation(self) -> FloatArray:
        """(3,) translation of `cam_from_world`, metres."""
        return self.cam_from_world[:, 3]

    @property
    def center_world(self) -> FloatArray:
        """(3,) centre of projection, metres."""
        center: FloatArray = -self.rotation.T @ self.translation
        return center

    def project(self, points_world: ArrayLike) -> FloatArray:
        """Project world points through the lens.

        Args:
            points_world: (..., 3) metres.

        Returns:
            (..., 2) px; NaN for NaN points and for points that are not in front of the camera. Points outside of the
            image are projected like any other.
        """
        return self._colmap_px(self._in_camera_axes(points_world))

    def project_seen(self, points_world: ArrayLike) -> FloatArray:
        """As `project`, but NaN for points far outside of the image.

        The distortion polynomial of a lens is meaningless there, and may map such points into the image.
        """
        points_cam = self._in_camera_axes(points_world)
        steepest = _BESIDE * _steepest(self.model, self.width, self.height, self.params)
        seen = np.hypot(points_cam[..., 0], points_cam[..., 1]) <= steepest * points_cam[..., 2]
        return np.where(seen[..., None], self._colmap_px(points_cam), np.nan)

    def _in_camera_axes(self, points_world: ArrayLike) -> FloatArray:
        """(..., 3) world points to (..., 3) in camera axes."""
        world = np.asarray(points_world, dtype=np.float64)
        if world.shape[-1:] != (3,):
            raise ValueError(f"points_world must be (..., 3), not {world.shape}")
        # A contiguous factor is ten times faster here than the transposed slice.
        transposed = np.ascontiguousarray(self.rotation.T)
        return (world.reshape(-1, 3) @ transposed + self.translation).reshape(world.shape)

    def unproject(self, points_px: ArrayLike) -> FloatArray:
        """Undistorted normalised image coordinates (x/z, y/z) of pixels.

        Args:
            points_px: (..., 2) px.

        Returns:
            (..., 2) slopes of the rays in camera axes; NaN for NaN pixels and for pixels that no ray in front of the
            camera reaches.
        """
        px = np.asarray(points_px, dtype=np.float64)
        if px.shape[-1:] != (2,):
            raise ValueError(f"points_px must be (..., 2), not {px.shape}")
        camera = _colmap_camera(self.model, self.width, self.height, self.params)
        flat = np.ascontiguousarray(px.reshape(-1, 2)) + _HALF_PIXEL
        # Skip NaN pixels: the iteration does not converge for them, and costs most.
        there = np.isfinite(flat).all(axis=1)
        slopes = np.full_like(flat, np.nan)
        slopes[there] = camera.cam_from_img(flat[there])
        return slopes.reshape(px.shape)

    def rays(self, points_px: ArrayLike) -> FloatArray:
        """Viewing directions of pixels.

        Args:
            points_px: (..., 2) px.

        Returns:
            (..., 3) unit vectors in world axes, from `center_world`; NaN as in `unproject`.
        """
        slopes = self.unproject(points_px)
        ones = np.ones((*slopes.shape[:-1], 1))
        rays_cam = np.concatenate([slopes, ones], axis=-1)
        rays_cam /= np.linalg.norm(rays_cam, axis=-1, keepdims=True)
        rays: FloatArray = rays_cam @ np.ascontiguousarray(self.rotation)
        return rays

    def posed(self, cam_from_world: ArrayLike) -> Camera:
        """The same camera with another pose, (3, 4)."""
        return replace(self, cam_from_world=np.asarray(cam_from_world, dtype=np.float64))

    def renamed(self, name: str) -> Camera:
        """The same camera with another name."""
        return replace(self, name=name)

    def resampled(self, width: int, height: int, scale: tuple[float, float], offset_px: tuple[float, float]) -> Camera:
        """The camera of an image that was scaled and then placed on a canvas.

        Args:
            width: of the new image, px.
            height: of the new image, px.
            scale: factors along x and y. Different factors convert a model with one focal length to the equivalent one
                with two.
            offset_px: position of the scaled image's top-left corner on the new canvas, px, measured from the canvas'
                top-left corner; negative where the image is cut off.
        """
        (scale_x, scale_y), (offset_x, offset_y) = scale, offset_px
        model, params = self.model, list(self.params)
        if scale_x != scale_y and model in _TWO_FOCALS:
            model, zeros = _TWO_FOCALS[model]
            params = [params[0], *params, *[0.0] * zeros]
        at = _principal_at(model)
        params[0] *= scale_x
        if at == 2:
            params[1] *= scale_y
        # Scaling preserves corners, not pixel centres; written so that a scale of one changes no bit.
        params[at] = params[at] * scale_x + (offset_x + _HALF_PIXEL * (scale_x - 1.0))
        params[at + 1] = params[at + 1] * scale_y + (offset_y + _HALF_PIXEL * (scale_y - 1.0))
        return replace(self, model=model, width=width, height=height, params=tuple(params))

    def resized(self, width: int, height: int) -> Camera:
        """The camera of the whole image resized to `width` x `height` px."""
        return self.resampled(width, height, (width / self.width, height / self.height), (0.0, 0.0))

    def cropped(self, left: float, top: float, width: int, height: int) -> Camera:
        """The camera of a window of `width` x `height` px whose top-left pixel is (left, top).

        The window may extend beyond the image (a letterbox: negative `left` or `top`).
        """
        return self.resampled(width, height, (1.0, 1.0), (-left, -top))

    def turned(self, quarter_turns: int) -> Camera:
        """The camera of the image rotated clockwise by `quarter_turns` times 90 degrees.

        The camera's axes rotate with the image, so that the scene stays where it is in the world.

        Raises:
            ValueError: a lens model whose distortion cannot be expressed in the same model after a rotation (the
                thin-prism ones).
        """
        if self.model not in _RADIAL_ONLY and self.model not in _TANGENTIAL_AT:
            raise ValueError(f"a camera of model {self.model} cannot be turned: its distortion is not symmetric")
        camera = self
        for _ in range(quarter_turns % 4):
            camera = camera._turned_once()
        return camera

    def _turned_once(self) -> Camera:
        """Rotate clockwise by 90 degrees: pixel (u, v) becomes (height - 1 - v, u)."""
        params = list(self.params)
        at = _principal_at(self.model)
        params[0], params[at - 1] = params[at - 1], params[0]
        params[at], params[at + 1] = self.height - 1 - params[at + 1], params[at]
        if self.model in _TANGENTIAL_AT:
            tangential = _TANGENTIAL_AT[self.model]
            params[tangential : tangential + 2] = params[tangential + 1], -params[tangential]
        turned_from_cam = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        return replace(
            self,
            width=self.height,
            height=self.width,
            params=tuple(params),
            cam_from_world=turned_from_cam @ self.cam_from_world,
        )

    def _colmap_px(self, points_cam: FloatArray) -> FloatArray:
        """(..., 3) points in camera axes to (..., 2) px."""
        camera = _colmap_camera(self.model, self.width, self.height, self.params)
        corner_px: FloatArray = camera.img_from_cam(np.ascontiguousarray(points_cam.reshape(-1, 3)))
        return corner_px.reshape(*points_cam.shape[:-1], 2) - _HALF_PIXEL


def _check_camera(camera: Camera) -> None:
    """Raise ValueError, saying what is wrong, unless the values form a valid camera."""
    if not isinstance(camera.name, str) or not camera.name:
        raise ValueError("a camera needs a name")
    if camera.model not in _PARAM_COUNT:
        raise ValueError(f"unknown camera model {camera.model!r}; known: {', '.join(CAMERA_MODELS)}")
    expected = _PARAM_COUNT[camera.model]
    if len(camera.params) != expected:
        raise ValueError(f"model {camera.model} has {expected} parameters, not {len(camera.params)}")
    if camera.width <= 0 or camera.height <= 0:
        raise ValueError(f"image size {camera.width}x{camera.height} is not positive")
    if not np.isfinite(camera.params).all():
        raise ValueError("a lens parameter is not finite")
    if min(camera.params[: _principal_at(camera.model)]) <= 0:
        raise ValueError("the focal length is not positive")
    pose = camera.cam_from_world
    if pose.shape != (3, 4):
        raise ValueError(f"cam_from_world must be (3, 4), not {pose.shape}")
    if not np.isfinite(pose).all():
        raise ValueError("the pose is not finite")
    gram = pose[:, :3] @ pose[:, :3].T
    if np.abs(gram - np.eye(3)).max() > _ORTHONORMAL_TOLERANCE or np.linalg.det(pose[:, :3]) < 0:
        raise ValueError("the rotation is not a rotation matrix (orthonormal, determinant +1)")


def camera_from_colmap(name: str, camera: Any, cam_from_world: ArrayLike) -> Camera:
    """A `Camera` from a `pycolmap.Camera`, with the principal point in this project's pixel convention.

    Args:
        name: the camera's name.
        camera: a `pycolmap.Camera`.
        cam_from_world: (3, 4), metres.

    Raises:
        ValueError: as `Camera`.
    """
    model = str(camera.model_name)
    params = [float(p) for p in camera.params]
    if len(params) == _PARAM_COUNT.get(model):
        at = _principal_at(model)
        params[at] -= _HALF_PIXEL
        params[at + 1] -= _HALF_PIXEL
    pose = np.asarray(cam_from_world, dtype=np.float64)
    return Camera(name, model, int(camera.width), int(camera.height), tuple(params), pose)


def colmap_camera(camera: Camera) -> Any:
    """A new `pycolmap.Camera` of the same lens, in pycolmap's pixel convention (for its solvers)."""
    cached = _colmap_camera(camera.model, camera.width, camera.height, camera.params)
    return pycolmap.Camera(model=camera.model, width=camera.width, height=camera.height, params=cached.params.copy())
