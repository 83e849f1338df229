"""Resection: cameras from 3D points whose pixels are known, one camera at a time.

The linear solution. A pinhole camera maps a point X to s (u, v, 1) = P (X, 1), P = K [R | t], which is linear in the
twelve entries of P: each point gives two equations, six points the eleven unknowns (direct linear transformation;
Abdel-Aziz and Karara 1971). Points and pixels are first shifted and scaled to unit spread, without which the
equations are badly conditioned (Hartley, "In defense of the eight-point algorithm", 1997).

From P to the camera (the steps of Parent, "Computer Animation", 2012, appendix B.11, derived afresh). Let q1, q2, q3
be the rows of the left 3x3 part of P and p14, p24, p34 its last column. With K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
and r1, r2, r3 the rows of R

    q1 = fx r1 + cx r3,   q2 = fy r2 + cy r3,   q3 = r3,
    p14 = fx t1 + cx t3,  p24 = fy t2 + cy t3,  p34 = t3.

P is known up to a factor: |q3| = 1 fixes its magnitude, and that the points are in front of the camera its sign. Since
the r are orthonormal, cx = q1.q3, cy = q2.q3, fx = |q1 - cx q3|, fy = |q2 - cy q3|, r1 = (q1 - cx q3) / fx,
r2 = (q2 - cy q3) / fy, t1 = (p14 - cx p34) / fx, t2 = (p24 - cy p34) / fy, t3 = p34. With noise the r are only nearly
orthonormal; the nearest rotation is used (singular value decomposition).

Radial distortion and all other parameters are then refined by minimising the reprojection error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration.board.intrinsics import Lens, lens_prior
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, LensPrior, adjust
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult, solved
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.robust import RAYLEIGH_MEDIAN

FEWEST_POINTS, FEWEST_WITH_LENS = 6, 4
_LINE, _PLANE = 1e-2, 1e-2
_SUBSETS, _SUBSET = 300, 7
_FITS_PX = 3.0
_WRONG_SIGMAS = 6.0
# Shares of the image's width: median error of the best camera from which the points are certainly wrong, and error from
# which they may be, if they fit several times better in another interpretation.
_NONSENSE, _DOUBTFUL, _BETTER = 0.02, 0.005, 5.0
# Manually marked points do not determine all distortion terms: the higher ones stay near zero.
_TERM_SIGMAS = (0.3, 0.1, 1e-3, 1e-3)


@dataclass(frozen=True)
class KnownPoints:
    """3D points and their pixels in one camera.

    Attributes:
        points: (N, 3) metres.
        pixels: (N, 2) px.
    """

    points: FloatArray
    pixels: FloatArray

    def __post_init__(self) -> None:
        if self.points.shape != (len(self.points), 3) or self.pixels.shape != (len(self.points), 2):
            raise ValueError("points must be (N, 3) and pixels (N, 2)")


@dataclass(frozen=True)
class PointsCalibration:
    """Cameras from known points.

    Attributes:
        solved: cameras, residuals (`point` is the row in each camera's `KnownPoints`) and uncertainties.
        notes: sentences on points that do not fit and on poorly determined parameters.
    """

    solved: CalibrationResult
    notes: tuple[str, ...]


def linear_camera(points: FloatArray, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Camera matrix and pose by the linear solution.

    Args:
        points: (N, 3), at least 6, not in one plane.
        pixels: (N, 2) px, without distortion.

    Returns:
        (3, 3) camera matrix without skew and (3, 4) cam_from_world with an orthonormal rotation.

    Raises:
        ValueError: too few points.
    """
    if len(points) < FEWEST_POINTS:
        raise ValueError(f"{FEWEST_POINTS} points are needed, not {len(points)}")
    (x, from_x), (u, from_u) = _normalise(points), _normalise(pixels)
    rows = np.zeros((2 * len(x), 12))
    homogeneous = np.column_stack([x, np.ones(len(x))])
    rows[0::2, 0:4] = rows[1::2, 4:8] = homogeneous
    rows[0::2, 8:], rows[1::2, 8:] = -u[:, :1] * homogeneous, -u[:, 1:] * homogeneous
    p = np.linalg.inv(from_u) @ np.linalg.svd(rows)[2][-1].reshape(3, 4) @ from_x
    p /= np.linalg.norm(p[2, :3])
    if np.median(points @ p[2, :3] + p[2, 3]) < 0:
        p = -p
    q1, q2, q3 = p[:, :3]
    cx, cy = float(q1 @ q3), float(q2 @ q3)
    fx, fy = float(np.linalg.norm(q1 - cx * q3)), float(np.linalg.norm(q2 - cy * q3))
    shift = np.array([(p[0, 3] - cx * p[2, 3]) / fx, (p[1, 3] - cy * p[2, 3]) / fy, p[2, 3]])
    rough = np.stack([(q1 - cx * q3) / fx, (q2 - cy * q3) / fy, q3])
    left, _, right = np.linalg.svd(rough)
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    # Rotated about the centroid of the points, not about the world's origin, which may be far away.
    middle = points.mean(axis=0)
    shift = rough @ middle + shift - turn @ middle
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.column_stack([turn, shift])


def _normalise(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points with zero mean and unit spread, and the (D + 1, D + 1) matrix of that transformation."""
    middle, dim = points.mean(axis=0), points.shape[1]
    scale = np.sqrt(dim) / max(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()), 1e-300)
    matrix = np.eye(dim + 1) * scale
    matrix[:dim, dim], matrix[dim, dim] = -scale * middle, 1.0
    return (points - middle) * scale, matrix


def calibrate_points(
    known: Mapping[str, KnownPoints],
    sizes: Mapping[str, tuple[int, int]],
    lenses: CameraGroup | None = None,
    lens: Lens = "pinhole",
    sigma_px: float = 1.0,
) -> PointsCalibration:
    """Calibrate cameras from known points, including their lenses unless these are given.

    Args:
        known: points by camera.
        sizes: (width, height) px by camera.
        lenses: cameras whose lenses are kept.
        lens: lens model, without `lenses`.
        sigma_px: standard deviation of the pixels.

    Raises:
        CalibrationError: too few points, points in a line or (without lenses) a plane, or points that no camera fits,
            such as mirrored ones.
    """
    solve = partial(_solve, sizes=sizes, lenses=lenses, lens=lens, sigma_px=sigma_px)
    answer = solve(known)
    usual, least = _off_shares(answer), float(np.min(answer.median_px / _widths(answer)))
    if usual.max() > _DOUBTFUL:
        reading, better = _other_reading(known, sizes, solve)
        if ((usual > _DOUBTFUL) & (better * _BETTER < usual)).any():
            raise CalibrationError(
                f"the points do not fit (error {100 * usual[0]:.1f} % of the image's width, RMS), but they do "
                f"({100 * better[0]:.2f} %) with {reading}: write them so"
            )
    if least > _NONSENSE:
        raise CalibrationError(
            f"the points fit no camera (median error {100 * least:.1f} % of the image's width and more): check that "
            "each row has a point and its own pixel, the order of the coordinates, and the lens"
        )
    return PointsCalibration(answer, tuple(_notes(answer)))


def _off_shares(answer: CalibrationResult) -> FloatArray:
    """(2,) RMS and median error of the median camera, as shares of the image's width."""
    each = np.stack([answer.rms_px, answer.median_px]) / _widths(answer)
    return np.asarray(np.median(np.nan_to_num(each, nan=np.inf), axis=1))


def _widths(answer: CalibrationResult) -> FloatArray:
    return np.array([float(c.width) for c in answer.cameras])


def _other_reading(
    known: Mapping[str, KnownPoints],
    sizes: Mapping[str, tuple[int, int]],
    solve: Callable[[Mapping[str, KnownPoints]], CalibrationResult],
) -> tuple[str, FloatArray]:
    """The interpretation of the points that fits best, and its `_off_shares`.

    Each is a reflection, so that nearly all fit where one does; of these, the one with upright cameras is returned.
    """
    same, swapped, mirrored = np.eye(3), np.eye(3)[[0, 2, 1]], np.diag([1.0, -1.0, 1.0])
    tried: list[tuple[FloatArray, float, str]] = []
    for words, turn, from_below in (
        ("the sign of y changed (a left-handed world; it must be right-handed)", mirrored, False),
        ("y and z swapped (Z is up)", swapped, False),
        ("v counted from the top of the image", same, True),
    ):
        other = {}
        for n, k in known.items():
            u, v = k.pixels.T
            other[n] = KnownPoints(k.points @ turn, np.column_stack([u, sizes[n][1] - 1 - v if from_below else v]))
        try:
            answer = solve(other)
        except CalibrationError:
            continue
        upright = float(np.mean([-c.rotation[1, 2] for c in answer.cameras]))
        tried.append((_off_shares(answer), upright, words))
    if not tried:
        return "", np.full(2, np.inf)
    best = min(t[0][0] for t in tried)
    shares, _, words = max((t for t in tried if t[0][0] <= 2 * best), key=lambda t: t[1])
    return words, shares


def _solve(
    known: Mapping[str, KnownPoints],
    sizes: Mapping[str, tuple[int, int]],
    lenses: CameraGroup | None,
    lens: Lens,
    sigma_px: float,
) -> CalibrationResult:
    """Cameras from known points, without checks of the residuals; arguments as of `calibrate_points`."""
    names = list(known)
    cameras = [_start(n, known[n], sizes[n], lens) if lenses is None else _resect(lenses[n], known[n]) for n in names]
    counts = [len(known[n].points) for n in names]
    free = lenses is None
    problem = AdjustProblem(
        cameras=CameraGroup(tuple(cameras)), camera=np.repeat(np.arange(len(names)), counts),
        point=np.arange(sum(counts)), pixels=np.concatenate([known[n].pixels for n in names]),
        sigma_px=np.full(sum(counts), sigma_px), points=np.concatenate([known[n].points for n in names]),
        points_free=np.zeros(sum(counts), np.bool_), free=(FreeCamera(free, free, free, pose=True),) * len(names),
        priors=tuple(_prior(c) for c in cameras) if free else (),
    )  # fmt: skip
    result = adjust(problem)
    own = replace(problem, point=np.concatenate([np.arange(n) for n in counts]))
    return solved(own, result, np.zeros(sum(counts), np.int64), problem.points)


def _prior(camera: Camera) -> LensPrior:
    """As for boards; the focal length is known to a factor of about two by the initial solution."""
    prior = lens_prior(camera)
    information = prior.information.copy()
    information[4:, 4:] = np.diag([s**-2 for s in _TERM_SIGMAS])
    return LensPrior(prior.mean, information)


def layout(points: FloatArray) -> str:
    """Arrangement of points: `line`, `plane` or `space`."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(sizes) < 2 or sizes[1] < _LINE * sizes[0]:
        return "line"
    return "plane" if len(sizes) < 3 or sizes[2] < _PLANE * sizes[0] else "space"


def _start(name: str, known: KnownPoints, size: tuple[int, int], lens: Lens) -> Camera:
    """A camera by the linear solution, from the subset of points with the smallest median error over all points."""
    points, pixels = known.points, known.pixels
    if len(points) < FEWEST_POINTS:
        raise CalibrationError(
            f"camera {name}: {len(points)} points, at least {FEWEST_POINTS} are needed where the lens is unknown and "
            f"{FEWEST_WITH_LENS} where it is known",
            remedy="points_or_lens",
        )
    shape = layout(points)
    if shape != "space":
        where = "on a line" if shape == "line" else "in a plane"
        raise CalibrationError(
            f"camera {name}: all {len(points)} points lie {where}, and a longer lens farther away gives nearly the "
            "same image: focal length and distance cannot be separated",
            remedy="points_off_shape",
            shape=shape,
        )
    cameras = [_camera(name, linear_camera(points, pixels), size, lens)]
    if len(points) > _SUBSET and (cameras[0] is None or np.median(_errors(cameras[0], known)) > _FITS_PX):
        rng = np.random.default_rng(0)
        for _ in range(_SUBSETS):
            rows = rng.choice(len(points), _SUBSET, replace=False)
            if layout(points[rows]) == "space":
                cameras.append(_camera(name, linear_camera(points[rows], pixels[rows]), size, lens))
    errors = [float(np.nanmedian(_errors(c, known))) if c is not None else np.inf for c in cameras]
    best = cameras[int(np.argmin(errors))]
    if best is None or not np.isfinite(min(errors)):
        raise CalibrationError(
            f"camera {name}: no camera sees these points at these pixels; check that the order of the coordinates, "
            "their unit (metres) and the pixels (from the top left) are right"
        )
    return best


def _camera(name: str, found: tuple[FloatArray, FloatArray], size: tuple[int, int], lens: Lens) -> Camera | None:
    matrix, pose = found
    focal = float(np.sqrt(matrix[0, 0] * matrix[1, 1]))
    if not np.isfinite(matrix).all() or not 0.05 < focal / max(size) < 50:
        return None
    middle = tuple(np.clip(matrix[:2, 2], 0, np.array(size) - 1.0))
    model = "OPENCV_FISHEYE" if lens == "fisheye" else "OPENCV"
    try:
        return Camera(name, model, *size, (focal, focal, *middle, 0, 0, 0, 0), pose)
    except ValueError:
        return None


def _errors(camera: Camera, known: KnownPoints) -> FloatArray:
    """(N,) reprojection errors, px; infinite behind the camera."""
    error = np.linalg.norm(camera.project(known.points) - known.pixels, axis=1)
    return np.where(np.isfinite(error), error, np.inf)


def _resect(camera: Camera, known: KnownPoints) -> Camera:
    """Pose of a camera with a known lens."""
    points, name = known.points, camera.name
    if len(points) < FEWEST_WITH_LENS:
        raise CalibrationError(
            f"camera {name}: {len(points)} points, at least {FEWEST_WITH_LENS} are needed"
            + (": with three, up to four places fit" if len(points) == 3 else "")
        )
    shape = layout(points)
    if shape == "line":
        raise CalibrationError(
            f"camera {name}: all {len(points)} points lie on a line, about which the camera could turn freely; add "
            "points off the line"
        )
    slopes = camera.unproject(known.pixels)
    seen = np.isfinite(slopes).all(axis=1)
    if seen.sum() < FEWEST_WITH_LENS:
        raise CalibrationError(f"camera {name}: its lens reaches {seen.sum()} of the pixels; is it the right lens?")
    posed: list[Camera] = []
    ways = [cv2.SOLVEPNP_SQPNP] + ([cv2.SOLVEPNP_IPPE] if shape == "plane" else [])
    sets = [np.nonzero(seen)[0]]
    if seen.sum() > 5:
        rng = np.random.default_rng(0)
        sets += [np.sort(rng.choice(sets[0], 5, replace=False)) for _ in range(_SUBSETS // 3)]
    for rows in sets:
        if any(np.median(_errors(c, known)) < _FITS_PX for c in posed):
            break
        for way in ways:
            middle = points[rows].mean(axis=0)
            try:
                done = cv2.solvePnPGeneric(points[rows] - middle, slopes[rows], np.eye(3), np.zeros(4), flags=way)
            except cv2.error:
                continue
            for turn, shift in zip(done[1], done[2], strict=True):
                rotation = cv2.Rodrigues(turn)[0]
                pose = np.column_stack([rotation, shift.ravel() - rotation @ middle])
                posed.append(camera.posed(pose)) if np.isfinite(pose).all() else None
    errors = [float(np.median(_errors(c, known))) for c in posed]
    if not errors or not np.isfinite(min(errors)):
        raise CalibrationError(f"camera {name}: no place from which it would see these points at these pixels")
    return posed[int(np.argmin(errors))]


def _notes(answer: CalibrationResult) -> list[str]:
    notes = []
    names = answer.cameras.names
    for c, camera in enumerate(answer.cameras):
        mine = np.nonzero(answer.camera == c)[0]
        if answer.median_px[c] > _NONSENSE * camera.width:
            notes.append(
                f"camera {names[c]}: its points do not fit it at all (median error {answer.median_px[c]:.0f} px), so "
                "it is wrong: check that each of its rows has a point and its own pixel"
            )
            continue
        usual = max(float(np.median(answer.errors_px[mine])) / RAYLEIGH_MEDIAN, 0.1)
        wrong = [k for k in mine if not answer.errors_px[k] < max(_WRONG_SIGMAS * usual, 3.0)]
        for k in wrong[:5]:
            x, y, z = answer.points_world[k]
            notes.append(
                f"camera {names[c]}: point ({x:g}, {y:g}, {z:g}) is {answer.errors_px[k]:.0f} px off and was given "
                "little say: check it"
            )
        share = answer.focal_std_px[c] / camera.params[0]
        if share > 0.02:
            notes.append(
                f"camera {names[c]}: its focal length is known to {share:.0%} only, however small the residuals; add "
                "points at other depths, or calibrate its lens separately"
            )
    return notes
