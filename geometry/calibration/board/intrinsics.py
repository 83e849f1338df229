"""Calibration of a camera's lens from its own views of a board, and prior knowledge of lenses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.bundle_adjustment.adjustment import (
    AdjustProblem,
    AdjustResult,
    FreeCamera,
    LensPrior,
    adjust,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup

View = tuple[IntArray, FloatArray]
"""Indices of a board's corners and their (n, 2) px."""
Lens = Literal["pinhole", "fisheye"]
"""Pinhole with radial and tangential distortion (OPENCV) or Kannala and Brandt's fisheye (OPENCV_FISHEYE)."""

FEWEST_VIEWS = 4
FEWEST_CORNERS = 6
CORNER_SIGMA_PX = 0.2
# Prior standard deviations: fx / fy (sensors have square pixels), the principal point's distance from the centre as a
# share of the longer side, and the distortion terms of common lenses.
_ASPECT, _MIDDLE = 0.003, 0.03
_PINHOLE_TERMS, _FISHEYE_TERMS = (0.5, 0.5, 0.003, 0.003), (0.3, 0.3, 0.3, 0.3)
_FISHEYE_VIEWS_DEG = (80.0, 110.0, 140.0, 170.0)
_FISHEYE_WIDEST = np.tan(np.radians(85))
_MISREAD_PX, _HOPELESS = 3.0, 0.2


@dataclass(frozen=True)
class LensCalibration:
    """A lens from a board.

    Attributes:
        camera: the camera, with the identity pose.
        result: the adjustment from which it results, with a pose of the board in every view.
        views: the views that were used, by time.
        noise_px: standard deviation of a coordinate, from the residuals.
    """

    camera: Camera
    result: AdjustResult
    views: dict[int, View]
    noise_px: float


def lens_prior(camera: Camera) -> LensPrior:
    """Prior of a lens of model OPENCV or OPENCV_FISHEYE; uninformative about its focal length."""
    long_side, focal = max(camera.width, camera.height), float(np.mean(camera.params[:2]))
    terms = _FISHEYE_TERMS if camera.model == "OPENCV_FISHEYE" else _PINHOLE_TERMS
    information = np.diag([0.0, 0.0, *[(_MIDDLE * long_side) ** -2] * 2, *(s**-2 for s in terms)])
    information[:2, :2] = np.array([[1, -1], [-1, 1]]) / (_ASPECT * focal) ** 2
    mean = np.array([focal, focal, (camera.width - 1) / 2, (camera.height - 1) / 2, 0, 0, 0, 0])
    return LensPrior(mean, information)


def usable(board: Board, views: Sequence[View]) -> list[View]:
    """Views with enough corners, four of which determine a pose: no three of these are collinear."""
    return [
        v
        for v in views
        if len(v[0]) >= FEWEST_CORNERS
        and np.linalg.matrix_rank(v[1] - v[1].mean(axis=0), 1) > 1
        and _off_lines(board.corners[v[0], :2])
    ]


def _off_lines(corners: FloatArray) -> bool:
    """Whether no line contains all but one of the (n, 2) corners; it would contain two of the first three."""
    shortest = 1e-6 * float(np.ptp(corners, axis=0).max()) ** 2
    for a, b in ((0, 1), (0, 2), (1, 2)):
        (x, y), away = corners[b] - corners[a], corners - corners[a]
        if (np.abs(x * away[:, 1] - y * away[:, 0]) > shortest).sum() < 2:
            return False
    return True


def board_pose(camera: Camera, board: Board, view: View) -> FloatArray:
    """(4, 4) cam_from_board of a view; a metre in front of the camera where the view does not determine it."""
    ids, px = view
    slopes = camera.unproject(px)
    seen = np.isfinite(slopes).all(axis=1)
    out = np.eye(4)
    out[2, 3] = 1.0
    if seen.sum() < 4:
        return out
    found, turn, shift = cv2.solvePnP(
        board.corners[ids][seen], slopes[seen], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        return out
    out[:3, :3], out[:3, 3] = cv2.Rodrigues(turn)[0], shift.ravel()
    return out


def calibrate_lens(
    name: str, board: Board, views: Mapping[int, View], size: tuple[int, int], lens: Lens = "pinhole"
) -> LensCalibration:
    """Calibrate a camera's lens from views of a board; its pose is the identity.

    Args:
        name: name of the camera.
        board: the board.
        views: views by time.
        size: (width, height) px.
        lens: lens model.

    Returns:
        The lens; views in which something else was detected as the board are not used.

    Raises:
        CalibrationError: too few views, or views that are too similar.
    """
    times = [t for t, v in views.items() if usable(board, [v])]
    good = [views[t] for t in times]
    if len(good) < FEWEST_VIEWS:
        raise CalibrationError(
            f"camera {name}: the board is seen in {len(good)} usable views of {len(views)}, at least {FEWEST_VIEWS} "
            "are needed; show it closer, flatter lit and from more sides"
        )
    start = _fisheye_start if lens == "fisheye" else _pinhole_start
    result, sigma = adjust_lens(start(name, board, good, size), board, good)
    fits = np.array(_view_errors(result, good)) <= _misread(result, good)
    if FEWEST_VIEWS <= fits.sum() < len(good):
        times = [t for t, f in zip(times, fits, strict=True) if f]
        good = [views[t] for t in times]
        result, sigma = adjust_lens(result.cameras[0], board, good)
    if (median := float(np.nanmedian(np.linalg.norm(result.residuals_px, axis=1)))) > _MISREAD_PX:
        raise CalibrationError(
            f"camera {name}: the detected corners do not fit a flat board of this description (median error "
            f"{median:.1f} px); the description of the board is wrong",
            remedy=None if lens == "fisheye" else "lens_fisheye",
        )
    focal, known = result.cameras[0].params[0], result.focal_std[0]
    if not np.isfinite(known) or known > _HOPELESS * focal:
        raise CalibrationError(
            f"camera {name}: the views do not tell the focal length (known to {known:.0f} px of {focal:.0f}); "
            "tilt the board by 30 to 60 degrees, not always facing the camera"
        )
    return LensCalibration(result.cameras[0], result, dict(zip(times, good, strict=True)), result.noise * sigma)


def _view_errors(result: AdjustResult, views: Sequence[View]) -> list[float]:
    """Median error of each view, px."""
    ends = np.cumsum([len(v[0]) for v in views])[:-1]
    errors = np.nan_to_num(np.linalg.norm(result.residuals_px, axis=1), nan=1e6)
    return [float(np.median(e)) for e in np.split(errors, ends)]


def _misread(result: AdjustResult, views: Sequence[View]) -> float:
    """Median error from which a view does not show the board, px."""
    return max(_MISREAD_PX, 8 * float(np.median(_view_errors(result, views))))


def adjust_lens(camera: Camera, board: Board, views: Sequence[View]) -> tuple[AdjustResult, float]:
    """Adjust a lens to views of a board, each with its own pose; also returns the assumed precision of corners, px."""
    bodies = np.stack([board_pose(camera, board, v)[:3] for v in views])
    ids = np.concatenate([v[0] for v in views])
    problem = AdjustProblem(
        cameras=CameraGroup((camera,)), camera=np.zeros(len(ids), np.int64), point=ids,
        pixels=np.concatenate([v[1] for v in views]), sigma_px=np.full(len(ids), CORNER_SIGMA_PX),
        points=board.corners, points_free=np.zeros(len(board.corners), np.bool_),
        free=(FreeCamera(focal=True, principal=True, distortion=True, pose=False),),
        body=np.repeat(np.arange(len(views)), [len(v[0]) for v in views]), bodies=bodies,
        priors=(lens_prior(camera),), loss_sigma=20.0,
    )  # fmt: skip
    first = adjust(problem)
    spread = max(first.noise * CORNER_SIGMA_PX, 0.05)  # depends on the sharpness of this camera's images
    problem = replace(
        problem, cameras=first.cameras, bodies=first.bodies, sigma_px=np.full(len(ids), spread), loss_sigma=4.0
    )
    return adjust(problem), spread


def _pinhole_start(name: str, board: Board, views: Sequence[View], size: tuple[int, int]) -> Camera:
    flat = board.corners * [1.0, 1.0, 0.0]  # each view is of one face
    objects = [flat[ids].astype(np.float32).reshape(-1, 1, 3) for ids, _ in views]
    images = [px.astype(np.float32).reshape(-1, 1, 2) for _, px in views]
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    try:
        _, matrix, bend, _, _ = cv2.calibrateCamera(objects, images, size, None, None, flags=flags)
    except cv2.error as error:
        raise CalibrationError(f"camera {name}: no lens fits its views of the board ({error.err})") from None
    k = float(np.clip(np.asarray(bend).ravel()[0], -0.6, 0.6))
    focal = float(np.sqrt(matrix[0, 0] * matrix[1, 1]))
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    if not np.isfinite(focal) or not 0.1 < focal / max(size) < 20:
        focal, k = 1.0 * max(size), 0.0
    return Camera(name, "OPENCV", *size, (focal, focal, *middle, k, 0.0, 0.0, 0.0), np.eye(4)[:3])


def _fisheye_start(name: str, board: Board, views: Sequence[View], size: tuple[int, int]) -> Camera:
    """The best of several angles of view, by the error of the views as views of a flat board."""
    best: tuple[float, Camera] | None = None
    for view_deg in _FISHEYE_VIEWS_DEG:
        focal = max(size) / np.radians(view_deg)
        camera = Camera(
            name, "OPENCV_FISHEYE", *size, (focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2, 0, 0, 0, 0),
            np.eye(4)[:3],
        )  # fmt: skip
        inside = [_within(camera, v) for v in views]
        if min(len(v[0]) for v in inside) < FEWEST_CORNERS:
            continue
        poses = [board_pose(camera, board, v) for v in inside]
        errors = [camera.posed(p[:3]).project(board.corners[v[0]]) - v[1] for p, v in zip(poses, inside, strict=True)]
        cost = float(np.nanmedian(np.abs(np.concatenate(errors))))
        if np.isfinite(cost) and (best is None or cost < best[0]):
            best = cost, camera
    if best is None:
        raise CalibrationError(
            f"camera {name}: no fisheye lens fits its views of the board",
            remedy="lens_pinhole",
        )
    return best[1]


def _within(camera: Camera, view: View) -> View:
    slopes = camera.unproject(view[1])
    keep = np.isfinite(slopes).all(axis=1) & (np.linalg.norm(slopes, axis=1) < _FISHEYE_WIDEST)
    return view[0][keep], view[1][keep]
