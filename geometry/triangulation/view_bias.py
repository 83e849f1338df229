"""What a network's eye does to a landmark: from the front it puts a hip elsewhere than from the side.

Such an error is the same in every frame in which a camera sees the person from that side, and different in the next
camera. Triangulation averages it as long as the same cameras see the landmark; when one no longer does, the point
jumps, and a robust estimate takes one view's habit for another view's mistake. Here the habit is learned from the take
itself, without a label: the detected point of landmark j, seen along the unit direction u in the trunk's axes, is the
true one plus B_j u + b_j, with B_j (3 x 3) of small entries. Of it only what differs between views shows in the
images, so b_j is set such that the mean of the take stays where it was: what all views have in common nobody can know.

B_j is the mean of its Gaussian posterior; how small "small" is (one number for all landmarks) is what makes the take
most likely, given what is usual (MacKay 1992, "Bayesian interpolation").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.triangulation.multiview import TriangulateOptions, Triangulation, triangulate

# Standard deviations of B_j's entries that are tried, metres: from what no network reaches to a hand's breadth.
_SIZES = np.array([0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03])
# What is believed beforehand: this, within a factor of e to the spread. It decides where a take is short.
_USUAL, _USUAL_SPREAD = 0.007, 0.2
# Differences for derivatives of projections, metres.
_STEP = 1e-3
_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@dataclass(frozen=True)
class ViewBiasOptions:
    """How a network's habits are learned.

    Attributes:
        enabled: learn them at all.
        alike_s: for so long errors of the network are the same one: they count as one observation.
        most_frames: of a longer take so many frames, evenly spread, are looked at.
        least_s: a take (of frames with three views) that is shorter says too little.
    """

    enabled: bool = True
    alike_s: float = 0.5
    most_frames: int = 600
    least_s: float = 0.5

    def __post_init__(self) -> None:
        if self.alike_s < 0 or self.least_s < 0 or self.most_frames < 2:
            raise ValueError("alike_s and least_s must not be negative, most_frames at least 2")


@dataclass(frozen=True)
class ViewBias:
    """Where landmarks are seen, beside where they are.

    Attributes:
        landmarks: what the J are.
        by_view: (J, 3, 3) B_j, metres.
        common: (J, 3) b_j in the trunk's axes, metres.
        size_m: standard deviation of B_j's entries, as it is believed after the take.
    """

    landmarks: LandmarkSet
    by_view: FloatArray
    common: FloatArray
    size_m: float

    def px(self, cameras: CameraGroup, points_world: FloatArray, axes: FloatArray) -> FloatArray:
        """(C, T, J, 2) px that 2D points lie off, for (T, J, 3) points; 0 where nothing is known.

        Args:
            cameras: C cameras.
            points_world: (T, J, 3) metres.
            axes: (T, 3, 3) the trunk's, see `trunk_axes`.
        """
        off = np.empty((len(cameras), *points_world.shape[:2], 2))
        for camera, out in zip(cameras, off, strict=True):
            body = np.einsum("jab,tjb->tja", self.by_view, _directions(camera, points_world, axes)) + self.common
            shifted = points_world + np.einsum("tab,tjb->tja", axes, body)
            out[:] = camera.project(shifted) - camera.project(points_world)
        return np.nan_to_num(off)


def trunk_axes(points_world: FloatArray, landmarks: LandmarkSet) -> FloatArray | None:
    """(T, 3, 3) axes of the trunk as columns (to its left, back and up), from shoulders and hips; of the nearest frame
    where these are missing, None where they are missing in all frames or in the set."""
    if any(name not in landmarks.names for name in _TRUNK):
        return None
    left, right, left_hip, right_hip = (points_world[:, landmarks.index(name)] for name in _TRUNK)
    up = _unit(left + right - left_hip - right_hip)
    back = _unit(np.cross(up, left - right + left_hip - right_hip))
    axes = np.stack([np.cross(back, up), back, up], axis=-1)
    known = np.flatnonzero(np.isfinite(axes).all((1, 2)))
    if not known.size:
        return None
    middles = (known[1:] + known[:-1]) / 2
    nearest: FloatArray = axes[known[np.searchsorted(middles, np.arange(len(axes)))]]
    return nearest


def learn_view_bias(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    landmarks: LandmarkSet,
    fps: float,
    found: Triangulation,
    triangulate_options: TriangulateOptions | None = None,
    options: ViewBiasOptions | None = None,
) -> ViewBias | None:
    """The habits of a network, from one person's take.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person; NaN where missing.
        variance_px2: (C, T, J).
        landmarks: what the J are.
        fps: frames a second.
        found: what `triangulate` made of them.
        triangulate_options: the options that it had.
        options: see `ViewBiasOptions`.

    Returns:
        None where there are fewer than three cameras, no trunk, or too short a take.
    """
    options = options or ViewBiasOptions()
    px, variance = np.asarray(points_px, np.float64), np.asarray(variance_px2, np.float64)
    axes = trunk_axes(found.points_world, landmarks)
    useful = np.flatnonzero((found.inlier.sum(0) >= 3).any(1))
    if not options.enabled or axes is None or len(cameras) < 3 or len(useful) < max(2, options.least_s * fps):
        return None
    some = useful[:: -(-len(useful) // options.most_frames)]
    apart_s = (some[-1] - some[0]) / max(len(some) - 1, 1) / fps
    alike = max(1.0, options.alike_s / max(apart_s, 1e-9))
    total = found.variance_scale * variance[:, some] + found.noise_px**2
    normal, right = _normal_equations(
        cameras, px[:, some], total, found.inlier[:, some], found.points_world[some], axes[some]
    )
    size, solved = _most_likely(normal / alike, right / alike)
    offsets = ViewBias(landmarks, solved, np.zeros((len(landmarks), 3)), size)
    # Where a landmark is seen best, its mean has to stay.
    again = triangulate(
        cameras, px[:, some] - offsets.px(cameras, found.points_world[some], axes[some]), variance[:, some],
        triangulate_options,
    )  # fmt: skip
    moved = np.einsum("tba,tjb->tja", axes[some], again.points_world - found.points_world[some])
    views = found.inlier[:, some].sum(0)
    moved[views < np.quantile(views, 0.75, axis=0)] = np.nan
    seen = np.isfinite(moved).all(-1).any(0)
    common = np.zeros((len(landmarks), 3))
    common[seen] = np.nanmedian(moved[:, seen], axis=0)
    return ViewBias(landmarks, solved, common, size)


def _unit(vector: FloatArray) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: FloatArray = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit


def _directions(camera: Camera, points_world: FloatArray, axes: FloatArray) -> FloatArray:
    """(T, J, 3) unit vectors from the camera to the points, in the trunk's axes."""
    along: FloatArray = np.einsum("tba,tjb->tja", axes, _unit(points_world - camera.center_world))
    return along


def _normal_equations(
    cameras: CameraGroup,
    px: FloatArray,
    variance: FloatArray,
    inlier: BoolArray,
    points_world: FloatArray,
    axes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """(J, 9, 9) and (J, 9): least squares for B_j, with every frame's point free to move."""
    at = cameras.project(points_world)
    steps = [(cameras.project(points_world + step) - at) / _STEP for step in _STEP * np.eye(3)]
    weight = np.sqrt(np.where(inlier & np.isfinite(variance), 1 / variance, 0.0))
    by_point = np.nan_to_num(np.stack(steps, -1)) * weight[..., None, None]  # (C, T, J, 2, 3)
    error = np.nan_to_num(px - at) * weight[..., None]
    along = np.nan_to_num(np.stack([_directions(camera, points_world, axes) for camera in cameras]))
    by_offset = np.einsum("ctjpa,tab,ctjd->ctjpbd", by_point, axes, along).reshape(*error.shape, 9)
    # A point that moves explains what it can: what it cannot is left for B_j.
    free = np.einsum("ctjpa,ctjpb->tjab", by_point, by_point)
    inverse = np.linalg.pinv(free, rcond=1e-9, hermitian=True)
    cross = np.einsum("ctjpa,ctjpn->tjan", by_point, by_offset)
    taken = np.einsum("tjab,tjbn->tjan", inverse, cross)
    normal = np.einsum("ctjpm,ctjpn->jmn", by_offset, by_offset) - np.einsum("tjam,tjan->jmn", cross, taken)
    pull = np.einsum("ctjpa,ctjp->tja", by_point, error)
    right = np.einsum("ctjpn,ctjp->jn", by_offset, error) - np.einsum("tja,tjan->jn", pull, taken)
    return normal, right


def _most_likely(normal: FloatArray, right: FloatArray) -> tuple[float, FloatArray]:
    """The size of B_j's entries that is the most likely, and the posterior means (J, 3, 3)."""
    values, vectors = np.linalg.eigh(normal)
    values, along = np.maximum(values, 0.0), np.einsum("jmn,jm->jn", vectors, right)
    size2 = _SIZES[:, None, None] ** 2
    evidence = 0.5 * (size2 * along**2 / (1 + size2 * values) - np.log1p(size2 * values)).sum((1, 2))
    evidence -= 0.5 * (np.log(_SIZES / _USUAL) / _USUAL_SPREAD) ** 2
    best = int(evidence.argmax())
    mean = np.einsum("jmn,jn->jm", vectors, along / (values + 1 / _SIZES[best] ** 2))
    return float(_SIZES[best]), mean.reshape(-1, 3, 3)


def without_view_bias(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    found: Triangulation,
    offsets: ViewBias,
    options: TriangulateOptions | None = None,
) -> tuple[FloatArray, Triangulation]:
    """2D points as they would be without the habits, and what they are triangulated to.

    Args:
        cameras: C cameras, not necessarily those that the habits were learned with.
        points_px: (C, T, J, 2) px.
        variance_px2: (C, T, J).
        found: what `triangulate` made of them.
        offsets: the habits.
        options: those of `triangulate`.

    Returns:
        (C, T, J, 2) px, and the points; their `residual_px` are of these px, not of those that were seen.
    """
    px = np.asarray(points_px, np.float64)
    axes = trunk_axes(found.points_world, offsets.landmarks)
    if axes is None:
        return px, found
    mended = px - offsets.px(cameras, found.points_world, axes)
    return mended, triangulate(cameras, mended, variance_px2, options)
