"""Frames rotated upright for the person detector: cameras are mounted sideways, tilted and upside down.

"Upright pixels" are pixels of the frame rotated about its centre so that world Z points up. Boxes of people are
detected, tracked and compared in them, where a standing person's box is tall and narrow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from muybridge.arrays import ByteArray, FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.sampling import scaled_down, warp
from muybridge.infer.session.frame_copies import halved_to

# A camera whose up direction is closer to its axis than this (sine) looks down on people: no image side is up.
_STEEP = 0.35

# Rotating by less than this is not worth the resampling: the detector was trained on leaning people too.
_LEAST_TURN = np.deg2rad(3.0)

# The detector takes sizes that are multiples of this.
_GRID_PX = 32


@dataclass(frozen=True)
class FrameOrientation:
    """A rotation of frames about their centre.

    Attributes:
        width: of the frame, px.
        height: of the frame, px.
        angle: clockwise, radians.
    """

    width: int
    height: int
    angle: float = 0.0

    @property
    def upright_from_frame(self) -> FloatArray:
        """(2, 3) affine map of pixels."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        turn = np.array([[cos, -sin], [sin, cos]])
        middle = np.array([self.width - 1, self.height - 1]) / 2
        return np.column_stack([turn, middle - turn @ middle])

    def to_upright(self, points_px: FloatArray) -> FloatArray:
        """(..., 2) frame px to upright px."""
        affine = self.upright_from_frame
        return np.asarray(points_px @ affine[:, :2].T + affine[:, 2])

    def to_frame(self, points_upright_px: FloatArray) -> FloatArray:
        """(..., 2) upright px to frame px."""
        affine = self.upright_from_frame
        return np.asarray((points_upright_px - affine[:, 2]) @ affine[:, :2])

    @property
    def bounds(self) -> FloatArray:
        """(4,) left, top, right, bottom of the frame's edges in upright px."""
        right, bottom = self.width - 0.5, self.height - 0.5
        corners = self.to_upright(np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]]))
        return np.concatenate([corners.min(axis=0), corners.max(axis=0)])

    def centered_in_frame(self, boxes_upright_px: FloatArray) -> FloatArray:
        """(K, 4) boxes of the same size and centre in frame px, as needed for a level crop."""
        center = self.to_frame((boxes_upright_px[:, :2] + boxes_upright_px[:, 2:]) / 2)
        half = (boxes_upright_px[:, 2:] - boxes_upright_px[:, :2]) / 2
        return np.concatenate([center - half, center + half], axis=1)

    def around_in_frame(self, boxes_upright_px: FloatArray) -> FloatArray:
        """(K, 4) axis-parallel boxes in frame px around the rotated ones."""
        left, top, right, bottom = boxes_upright_px.T
        corners = np.stack([left, top, right, top, right, bottom, left, bottom], axis=1).reshape(-1, 4, 2)
        corners = self.to_frame(corners)
        return np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)


def orientation_for(camera: Camera | None, width: int, height: int) -> FrameOrientation:
    """The rotation after which people's heads point up in a camera's frames.

    No rotation without a camera, or for one that looks down so steeply that heads point in all directions.
    """
    if camera is None:
        return FrameOrientation(width, height)
    up_x, up_y = camera.rotation[:2, 2]
    angle = -float(np.arctan2(up_x, -up_y))
    if np.hypot(up_x, up_y) < _STEEP or abs(angle) < _LEAST_TURN:
        angle = 0.0
    return FrameOrientation(width, height, angle)


@dataclass(frozen=True)
class Letterbox:
    """How a frame becomes the detector's input: scaled to its long side, rotated upright, at the top left of a
    canvas whose sides are multiples of 32, black elsewhere.

    Attributes:
        upright: size and rotation of the frames.
        long_side: of the scaled frame before it is rotated, px.
    """

    upright: FrameOrientation
    long_side: int

    @property
    def _scaled(self) -> tuple[int, int]:
        """Width and height of the scaled frame before it is rotated, px."""
        scale = self.long_side / max(self.upright.width, self.upright.height)
        return max(1, round(self.upright.width * scale)), max(1, round(self.upright.height * scale))

    @property
    def _canvas_px_per_px(self) -> FloatArray:
        """(2,) scale along x and y; a frame that is not rotated is not resampled to make them equal."""
        if self.upright.angle == 0.0:
            return np.array(self._scaled) / [self.upright.width, self.upright.height]
        return np.full(2, self.long_side / max(self.upright.width, self.upright.height))

    @property
    def canvas(self) -> tuple[int, int]:
        """Width and height of the canvas, px."""
        left, top, right, bottom = self.upright.bounds
        size = np.array([right - left, bottom - top]) * self._canvas_px_per_px
        width, height = (np.ceil((size - 1e-6) / _GRID_PX) * _GRID_PX).astype(int)
        return int(width), int(height)

    def apply(self, frame: ByteArray) -> ByteArray:
        """(H, W, 3) to the canvas; the frame may be given averaged down."""
        shrinks = max(self.upright.width, self.upright.height) >= self.long_side
        small = halved_to(frame, self.long_side)
        small = scaled_down(small, self._scaled) if shrinks else np.asarray(cv2.resize(small, self._scaled), np.uint8)
        width, height = self.canvas
        if self.upright.angle == 0.0:
            canvas = np.zeros((height, width, 3), dtype=np.uint8)
            canvas[: small.shape[0], : small.shape[1]] = small
            return canvas
        # canvas <- upright <- frame <- small; pixel centres are integers in all four.
        frame_px = np.array([self.upright.width, self.upright.height]) / self._scaled
        frame_from_small = np.array([[frame_px[0], 0, (frame_px[0] - 1) / 2], [0, frame_px[1], (frame_px[1] - 1) / 2]])
        affine = self.upright.upright_from_frame
        upright_from_small = affine[:, :2] @ frame_from_small
        upright_from_small[:, 2] += affine[:, 2]
        scale = self._canvas_px_per_px[:, None]
        canvas_from_small = scale * upright_from_small
        canvas_from_small[:, 2] -= scale[:, 0] * self.upright.bounds[:2] + 0.5
        return warp(small, canvas_from_small, (width, height))

    def boxes_to_upright(self, boxes: FloatArray) -> FloatArray:
        """(K, 4) boxes in canvas px to upright px."""
        left, top = self.upright.bounds[:2]
        scale = np.tile(self._canvas_px_per_px, 2)
        return np.asarray((boxes + 0.5) / scale + [left, top, left, top])

    @property
    def frame_from_canvas(self) -> FloatArray:
        """(3, 3) affine map of pixels."""
        left, top = self.upright.bounds[:2]
        per_x, per_y = 1 / self._canvas_px_per_px
        upright_from_canvas = np.array([[per_x, 0, left + per_x / 2], [0, per_y, top + per_y / 2], [0, 0, 1]])
        upright_from_frame = np.vstack([self.upright.upright_from_frame, [0, 0, 1]])
        return np.asarray(np.linalg.inv(upright_from_frame) @ upright_from_canvas)
