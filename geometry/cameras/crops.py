"""Homographies of person crops: images of a virtual camera without roll that looks at a person.

A keypoint network sees a person in a square crop. For a calibrated camera the crop is the image of a virtual pinhole
camera at the same centre that looks at the middle of the person's bounding box, with world Z upwards in the crop:
rolled cameras, phones in portrait orientation and the stretched corners of wide-angle lenses then look the same to the
network. Without a calibration the crop is a plain square.

The same homography maps pixels (`muybridge.infer.detection.crop_pixels`) and points. Inside a crop the lens is
approximated by the homography that is exact at four points half-way to the corners (exact everywhere for a lens without
distortion). Outside of the image a crop is black, as in training.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import Camera

BOX_PADDING = 1.25
"""Side of a crop divided by the longer side of the person's bounding box."""

# Within this angle of the vertical, the image of world Z says little about the orientation of a person in the image:
# the camera's own up direction is used instead.
_VERTICAL_VIEW = np.deg2rad(10.0)

# Points at which the homography matches the lens model exactly, from the middle (0) to the edge (1) of the crop.
_FIT_AT = 0.5


@dataclass(frozen=True, eq=False)
class Crops:
    """`N` square crops of one image.

    Attributes:
        size_px: side of the crops, px; a crop spans -0.5 .. size_px - 0.5.
        crop_from_image: (N, 3, 3) homographies from original pixels to crop pixels, scaled so that the third coordinate
            is 1 at the middle of the crop and positive wherever the virtual camera's view is in front of the real one.
    """

    size_px: int
    crop_from_image: FloatArray

    def __len__(self) -> int:
        return len(self.crop_from_image)

    @property
    def image_from_crop(self) -> FloatArray:
        """(N, 3, 3) homographies from crop pixels to original pixels."""
        return np.asarray(np.linalg.inv(self.crop_from_image), dtype=np.float64)

    @property
    def image_px_per_crop_px(self) -> FloatArray:
        """(N,) original pixels per crop pixel, at the middle of the crop."""
        middle = np.full((len(self), 1, 2), (self.size_px - 1) / 2)
        return np.asarray(np.sqrt(np.abs(_area_scale(self.image_from_crop, middle)))[:, 0], dtype=np.float64)

    def select(self, index: ArrayLike) -> Crops:
        """The crops selected by an index array or mask over N."""
        return Crops(self.size_px, self.crop_from_image[np.asarray(index)])

    def to_crop(self, points_px: ArrayLike) -> FloatArray:
        """(N, K, 2) original pixels to (N, K, 2) crop pixels; NaN stays NaN."""
        return apply_homographies(self.crop_from_image, points_px)

    def to_image(self, points_crop_px: ArrayLike) -> FloatArray:
        """(N, K, 2) crop pixels to (N, K, 2) original pixels; NaN stays NaN."""
        return apply_homographies(self.image_from_crop, points_crop_px)

    def variance_to_image(self, points_crop_px: ArrayLike, variance_crop_px2: ArrayLike) -> FloatArray:
        """Variances in original pixels of points measured in the crop.

        Args:
            points_crop_px: (N, K, 2) crop px.
            variance_crop_px2: (N, K) variance of each coordinate, crop px^2.

        Returns:
            (N, K) variance of each coordinate in original px^2, scaled by the homography's local change of area, since
            one number stands for both coordinates.
        """
        scale = np.abs(_area_scale(self.image_from_crop, np.asarray(points_crop_px, dtype=np.float64)))
        return np.asarray(variance_crop_px2, dtype=np.float64) * scale

    def variance_to_crop(self, points_px: ArrayLike, variance_px2: ArrayLike) -> FloatArray:
        """The inverse of `variance_to_image`: (N, K, 2) original pixels and (N, K) to (N, K)."""
        scale = np.abs(_area_scale(self.crop_from_image, np.asarray(points_px, dtype=np.float64)))
        return np.asarray(variance_px2, dtype=np.float64) * scale


def apply_homographies(homographies: FloatArray, points: ArrayLike) -> FloatArray:
    """Apply (N, 3, 3) homographies to (N, K, 2) points; NaN where a point maps to infinity or beyond."""
    points = np.asarray(points, dtype=np.float64)
    mapped = points @ homographies[:, :, :2].transpose(0, 2, 1) + homographies[:, None, :, 2]
    w = mapped[..., 2:]
    return mapped[..., :2] / np.where(w > 0, w, np.nan)


def _area_scale(homographies: FloatArray, points: FloatArray) -> FloatArray:
    """(N, K) determinant of the homographies' Jacobians at (N, K, 2) points."""
    w = (points @ homographies[:, 2, :2, None])[..., 0] + homographies[:, 2, 2, None]
    scale: FloatArray = np.linalg.det(homographies)[:, None] / w**3
    return scale


def crops_for_boxes(
    boxes_px: ArrayLike, size_px: int, camera: Camera | None = None, padding: float = BOX_PADDING
) -> Crops:
    """Crops for people's bounding boxes.

    Args:
        boxes_px: (N, 4) left, top, right, bottom in original px; they may extend beyond the image.
        size_px: side of the crops, px.
        camera: the calibrated camera; without it, or where its lens model does not reach the box, the crops are plain
            squares.
        padding: side of a crop divided by the longer side of its box. With a calibration the box is measured in the
            virtual camera, between the midpoints of opposite edges.

    Raises:
        ValueError: a box is not finite or has no extent.
    """
    boxes = np.asarray(boxes_px, dtype=np.float64).reshape(-1, 4)
    if not np.isfinite(boxes).all() or (boxes[:, 2:] <= boxes[:, :2]).any():
        raise ValueError("boxes must be finite, left < right and top < bottom")
    crop_from_image = _square_homographies(boxes, size_px, padding)
    if camera is not None and len(boxes):
        virtual = _virtual_homographies(boxes, size_px, camera, padding)
        known = np.isfinite(virtual).all(axis=(1, 2))
        crop_from_image[known] = virtual[known]
    return Crops(size_px, crop_from_image)


def _square_homographies(boxes: FloatArray, size_px: int, padding: float) -> FloatArray:
    """(N, 3, 3) scalings and shifts that place each box in the middle of its crop."""
    center = (boxes[:, :2] + boxes[:, 2:]) / 2
    scale = size_px / (padding * (boxes[:, 2:] - boxes[:, :2]).max(axis=1))
    homographies = np.zeros((len(boxes), 3, 3))
    homographies[:, 0, 0] = homographies[:, 1, 1] = scale
    homographies[:, :2, 2] = (size_px - 1) / 2 - scale[:, None] * center
    homographies[:, 2, 2] = 1.0
    return homographies


@dataclass(frozen=True, eq=False)
class VirtualViews:
    """`N` virtual cameras at the centre of a real one, each looking at a person.

    Attributes:
        virtual_from_world: (N, 3, 3) rotations, OpenCV axes.
        half_extent: (N,) tangent of half of the field of view: the crop spans -half_extent .. half_extent in the
            virtual camera's normalised coordinates, so that its focal length is size_px / (2 * half_extent) px and its
            principal point (size_px - 1) / 2.
    """

    virtual_from_world: FloatArray
    half_extent: FloatArray


def virtual_views(boxes_px: ArrayLike, camera: Camera, padding: float = BOX_PADDING) -> VirtualViews:
    """The virtual cameras of people's bounding boxes (N, 4), original px; NaN where the lens model does not reach."""
    boxes = np.asarray(boxes_px, dtype=np.float64).reshape(-1, 4)
    left, top, right, bottom = boxes.T
    middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
    x = np.stack([middle_x, left, right, middle_x, middle_x], axis=1)
    y = np.stack([middle_y, middle_y, middle_y, top, bottom], axis=1)
    rays_world = camera.rays(np.stack([x, y], axis=-1))
    virtual_from_world = level_rotations(rays_world[:, 0], camera.rotation)
    edges = rays_world[:, 1:] @ virtual_from_world.transpose(0, 2, 1)
    slopes = edges[..., :2] / np.where(edges[..., 2:] > 0, edges[..., 2:], np.nan)
    extents = np.linalg.norm(slopes[:, [1, 3]] - slopes[:, [0, 2]], axis=-1)
    return VirtualViews(virtual_from_world, padding * extents.max(axis=1) / 2)


def level_rotations(directions_world: FloatArray, cam_rotation: FloatArray) -> FloatArray:
    """Rotations of cameras that look along given directions without roll.

    Args:
        directions_world: (N, 3) unit viewing directions.
        cam_rotation: (3, 3) rotation of the real camera's `cam_from_world`; its up direction replaces world Z where the
            view is within 10 degrees of the vertical.

    Returns:
        (N, 3, 3) rotations from world axes to virtual camera axes (x right, y down, z along the direction).
    """
    forward = np.asarray(directions_world, dtype=np.float64)
    vertical = np.abs(forward[:, 2]) > np.cos(_VERTICAL_VIEW)
    down = np.where(vertical[:, None], cam_rotation[1], np.array([0.0, 0.0, -1.0]))
    right = np.cross(down, forward)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=1)


def _virtual_homographies(boxes: FloatArray, size_px: int, camera: Camera, padding: float) -> FloatArray:
    """(N, 3, 3) from image to crop through virtual cameras; NaN where the lens model does not reach."""
    views = virtual_views(boxes, camera, padding)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * _FIT_AT
    rays = np.ones((len(boxes), 4, 3))
    rays[..., :2] = corners * views.half_extent[:, None, None]
    points_world = camera.center_world + rays @ views.virtual_from_world
    corners_px = camera.project(points_world)

    # Solved in units of the box about its middle, for conditioning; w = 1 at the middle of the crop.
    center = (boxes[:, :2] + boxes[:, 2:]) / 2
    unit = (boxes[:, 2:] - boxes[:, :2]).max(axis=1)
    box_from_unit = _homographies_from_corners(corners, (corners_px - center[:, None]) / unit[:, None, None])
    image_from_box = np.zeros((len(boxes), 3, 3))
    image_from_box[:, 0, 0] = image_from_box[:, 1, 1] = unit
    image_from_box[:, :2, 2], image_from_box[:, 2, 2] = center, 1.0
    half = size_px / 2
    crop_from_unit = np.array([[half, 0, half - 0.5], [0, half, half - 0.5], [0, 0, 1.0]])
    image_from_unit = image_from_box @ box_from_unit
    ok = np.flatnonzero(np.isfinite(image_from_unit).all(axis=(1, 2)))
    ok = ok[np.abs(np.linalg.det(box_from_unit[ok])) > 1e-9]
    crop_from_image = np.full_like(image_from_unit, np.nan)
    crop_from_image[ok] = crop_from_unit @ np.linalg.inv(image_from_unit[ok])
    return crop_from_image


def _homographies_from_corners(corners: FloatArray, targets: FloatArray) -> FloatArray:
    """(N, 3, 3) homographies, last entry 1, that map (4, 2) corners to (N, 4, 2) targets; NaN for NaN."""
    count = len(targets)
    system = np.zeros((count, 4, 2, 8))
    homogeneous = np.concatenate([corners, np.ones((4, 1))], axis=1)
    system[:, :, 0, 0:3] = homogeneous
    system[:, :, 1, 3:6] = homogeneous
    system[..., 6:8] = -targets[..., :, None] * corners[:, None, :]
    known = np.flatnonzero(np.isfinite(targets).all(axis=(1, 2)))
    matrices, right_side = system.reshape(count, 8, 8), targets.reshape(count, 8, 1)
    known = known[np.linalg.cond(matrices[known]) < 1e9]
    solution = np.full((count, 9), np.nan)
    solution[:, 8] = 1.0
    solution[known, :8] = np.linalg.solve(matrices[known], right_side[known])[..., 0]
    return solution.reshape(count, 3, 3)
