"""View-dependent bias of 2D landmarks: a network places a hip differently seen from the front and from the side.

Such an error is the same in every frame in which a camera sees the person from that side, and different in the next
camera. Triangulation averages it as long as the same cameras see the landmark; when one no longer does, the point
jumps, and a robust estimate mistakes the bias of one view for an outlier of another. Here the bias is estimated from
the take itself, without labels: the detected point of landmark j, seen along the unit direction u in the axes of the
trunk, is the true one plus B_j u + b_j, with B_j (3 x 3) of small entries. Only the differences between views show in
the images, so b_j is set such that the mean over the take does not change; a bias common to all views is not
observable.

B_j is the mean of its posterior: Gaussian for a given scale of the prior (one number for all landmarks), averaged over
scales by the evidence of the take and their own prior (MacKay 1992, "Bayesian interpolation").
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

# Standard deviations of B_j's entries that are tried, metres.
_SIZES = np.array([0.001, 0.002, 0.003, 0.005, 0.007, 0.01, 0.015, 0.02, 0.03])
# Log-normal prior of that scale: median and width, which decide in short takes.
_USUAL, _USUAL_SPREAD = 0.007, 0.2
# Step for numerical derivatives of projections, metres.
_STEP = 1e-3
_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@dataclass(frozen=True)
class ViewBiasOptions:
    """Options of the estimation of view-dependent bias.

    Attributes:
        enabled: whether bias is estimated at all.
        alike_s: correlation time of the network's errors, seconds: errors within it count as one observation.
        most_frames: maximum number of frames used, spread evenly over the take.
        least_s: minimum duration of frames with three views, seconds.
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
    """View-dependent bias of landmarks.

    Attributes:
        landmarks: the J landmarks.
        by_view: (J, 3, 3) B_j, metres.
        common: (J, 3) b_j in the axes of the trunk, metres.
        size_m: estimated standard deviation of B_j's entries, metres.
    """

    landmarks: LandmarkSet
    by_view: FloatArray
    common: FloatArray
    size_m: float

    def px(self, cameras: CameraGroup, points_world: FloatArray, axes: FloatArray) -> FloatArray:
        """(C, T, J, 2) px by which 2D points of (T, J, 3) points are biased; 0 where unknown.

        Args:
            cameras: C cameras.
            points_world: (T, J, 3) metres.
            axes: (T, 3, 3) of the trunk, see `trunk_axes`.
        """
        off = np.empty((len(cameras), *points_world.shape[:2], 2))
        for camera, out in zip(cameras, off, strict=True):
            body = np.einsum("jab,tjb->tja", self.by_view, _directions(camera, points_world, axes)) + self.common
            shifted = points_world + np.einsum("tab,tjb->tja", axes, body)
            out[:] = camera.project(shifted) - camera.project(points_world)
        return np.nan_to_num(off)


def trunk_axes(points_world: FloatArray, landmarks: LandmarkSet) -> FloatArray | None:
    """(T, 3, 3) axes of the trunk as columns (to its left, back and up), from shoulders and hips.

    Of the nearest frame where these landmarks are missing; None where they are missing in all frames or in the set.
    """
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
    """Estimate the view-dependent bias of a 2D network from one person's take.

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px of one person; NaN where missing.
        variance_px2: (C, T, J) px^2.
        landmarks: the J landmarks.
        fps: frames per second.
        found: the triangulation of these points.
        triangulate_options: the options of that triangulation.
        options: see `ViewBiasOptions`.

    Returns:
        None with fewer than three cameras, without a trunk, or if the take is too short.
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
    # The mean of a landmark must not change in the frames in which most cameras see it.
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
    """(T, J, 3) unit vectors from the camera to the points, in the axes of the trunk."""
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
    """(J, 9, 9) and (J, 9) least squares for B_j, with every frame's 3D point eliminated."""
    at = cameras.project(points_world)
    steps = [(cameras.project(points_world + step) - at) / _STEP for step in _STEP * np.eye(3)]
    weight = np.sqrt(np.where(inlier & np.isfinite(variance), 1 / variance, 0.0))
    by_point = np.nan_to_num(np.stack(steps, -1)) * weight[..., None, None]  # (C, T, J, 2, 3)
    error = np.nan_to_num(px - at) * weight[..., None]
    along = np.nan_to_num(np.stack([_directions(camera, points_world, axes) for camera in cameras]))
    by_offset = np.einsum("ctjpa,tab,ctjd->ctjpbd", by_point, axes, along).reshape(*error.shape, 9)
    # Eliminate the 3D points: B_j has to explain only what a displacement of the point cannot.
    free = np.einsum("ctjpa,ctjpb->tjab", by_point, by_point)
    inverse = np.linalg.pinv(free, rcond=1e-9, hermitian=True)
    cross = np.einsum("ctjpa,ctjpn->tjan", by_point, by_offset)
    taken = np.einsum("tjab,tjbn->tjan", inverse, cross)
    normal = np.einsum("ctjpm,ctjpn->jmn", by_offset, by_offset) - np.einsum("tjam,tjan->jmn", cross, taken)
    pull = np.einsum("ctjpa,ctjp->tja", by_point, error)
    right = np.einsum("ctjpn,ctjp->jn", by_offset, error) - np.einsum("tja,tjan->jn", pull, taken)
    return normal, right


def _most_likely(normal: FloatArray, right: FloatArray) -> tuple[float, FloatArray]:
    """The scale of B_j's entries and the posterior means (J, 3, 3), over all scales by their evidence: no scale wins by
    a rounding."""
    values, vectors = np.linalg.eigh(normal)
    values, along = np.maximum(values, 0.0), np.einsum("jmn,jm->jn", vectors, right)
    size2 = _SIZES[:, None, None] ** 2
    evidence = 0.5 * (size2 * along**2 / (1 + size2 * values) - np.log1p(size2 * values)).sum((1, 2))
    evidence -= 0.5 * (np.log(_SIZES / _USUAL) / _USUAL_SPREAD) ** 2
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    shrunk = np.einsum("k,kjn->jn", share, along / (values + 1 / size2))
    return float(share @ _SIZES), np.einsum("jmn,jn->jm", vectors, shrunk).reshape(-1, 3, 3)


def remove_view_bias(
    cameras: CameraGroup,
    points_px: ArrayLike,
    variance_px2: ArrayLike,
    found: Triangulation,
    offsets: ViewBias,
    options: TriangulateOptions | None = None,
) -> tuple[FloatArray, Triangulation]:
    """Remove view-dependent bias from 2D points and triangulate them again.

    Args:
        cameras: C cameras, not necessarily those with which the bias was estimated.
        points_px: (C, T, J, 2) px.
        variance_px2: (C, T, J) px^2.
        found: the triangulation of these points.
        offsets: the bias.
        options: options of the triangulation.

    Returns:
        (C, T, J, 2) px without the bias, and their triangulation; its `residual_px` refers to these px.
    """
    px = np.asarray(points_px, np.float64)
    axes = trunk_axes(found.points_world, offsets.landmarks)
    if axes is None:
        return px, found
    corrected = px - offsets.px(cameras, found.points_world, axes)
    return corrected, triangulate(cameras, corrected, variance_px2, options)
