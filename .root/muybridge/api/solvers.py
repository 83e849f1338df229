"""The geometry as functions: 3D points from 2D points, smoothing, body fitting and inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import LinearConstraint

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.fitting.body_fit import BodyFit, FitOptions
from muybridge.geometry.fitting.body_fit import fit_body as _fit_body
from muybridge.geometry.ik.pose_prior import PosePrior
from muybridge.geometry.ik.solver import IkOptions, IkResult
from muybridge.geometry.ik.solver import solve_ik as _solve_ik
from muybridge.geometry.ik.tree import Goal, KinematicTree
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation.multiview import TriangulateOptions
from muybridge.geometry.triangulation.multiview import triangulate as _triangulate


def make_points(
    points_world: ArrayLike,
    landmarks: LandmarkSet | Sequence[str] = BODY23,
    *,
    fps: float,
    covariance_world: ArrayLike | None = None,
) -> Points3D:
    """Wrap 3D points of your own for `smooth`, `fit_body` and `write_points`.

    Args:
        points_world: (T, J, 3) metres, Z up; NaN where missing.
        landmarks: what the J axis means: a landmark set, or J names.
        fps: frames a second.
        covariance_world: (T, J, 3, 3) square metres; unknown where it is None.

    Raises:
        ValueError: shapes that do not match, names that repeat, or a frame rate that is not above zero.

    Example:
        >>> import muybridge, numpy
        >>> ankles = numpy.zeros((10, 2, 3))
        >>> muybridge.make_points(ankles, ["left_ankle", "right_ankle"], fps=50).landmarks.names
        ('left_ankle', 'right_ankle')
    """
    points, named = np.asarray(points_world, dtype=np.float64), _landmark_set(landmarks)
    if points.ndim != 3 or points.shape[1:] != (len(named), 3):
        raise ValueError(f"points_world must be (T, {len(named)}, 3) for these landmarks, not {points.shape}")
    covariance = np.full((*points.shape, 3), np.nan)
    if covariance_world is not None:
        covariance = np.asarray(covariance_world, dtype=np.float64)
        if covariance.shape != (*points.shape, 3):
            raise ValueError(f"covariance_world must be {(*points.shape, 3)}, not {covariance.shape}")
    views = (0, *points.shape[:2])
    return Points3D(named, points, covariance, np.empty(views), np.empty(views, dtype=np.bool_), _checked_fps(fps))


def triangulate(
    cameras: CameraGroup,
    points_px: ArrayLike,
    landmarks: LandmarkSet | Sequence[str] = BODY23,
    *,
    fps: float,
    sd_px: ArrayLike = 2.0,
    options: TriangulateOptions | None = None,
) -> Points3D:
    """Triangulate one person's landmarks robustly: cameras that contradict the others do not count.

    Every landmark of every frame is solved by itself: pairs of cameras propose a point, all vote on it, and a robust
    reprojection error is minimised (Hartley and Zisserman, "Multiple View Geometry", 2004, chapter 12).

    Args:
        cameras: C calibrated cameras.
        points_px: (C, T, J, 2) px, (0, 0) the centre of the top-left pixel; NaN where a camera has no point.
        landmarks: what the J axis means: a landmark set, or J names.
        fps: frames a second; kept in the result.
        sd_px: standard deviation of each coordinate, px: (C, T, J), or anything that broadcasts to it.
        options: see `TriangulateOptions`.

    Returns:
        T frames of J points in metres, in the cameras' world, with covariances, residuals and the cameras that agree;
        NaN where too few do.

    Raises:
        ValueError: shapes that do not match, or a standard deviation that is not positive.

    Example:
        >>> import muybridge, numpy
        >>> cameras = muybridge.load_calibration("session/calibration.toml")
        >>> truth = numpy.array([[[0.1, 0.2, 1.0], [0.0, 0.0, 0.5]]])  # one frame, two points
        >>> points = muybridge.triangulate(cameras, cameras.project(truth), ["wrist", "hip"], fps=30)
        >>> bool(numpy.allclose(points.points_world, truth, atol=1e-6))
        True
    """
    px, named = np.asarray(points_px, dtype=np.float64), _landmark_set(landmarks)
    if px.ndim != 4 or px.shape[0] != len(cameras) or px.shape[2:] != (len(named), 2):
        raise ValueError(
            f"points_px must be ({len(cameras)}, T, {len(named)}, 2): cameras, frames, landmarks, xy; not {px.shape}"
        )
    variance = np.broadcast_to(np.asarray(sd_px, dtype=np.float64) ** 2, px.shape[:-1])
    found = _triangulate(cameras, px, variance, options)
    return Points3D(
        landmarks=named,
        points_world=found.points_world,
        covariance_world=found.covariance_world,
        residual_px=found.residual_px,
        inlier=found.inlier,
        fps=_checked_fps(fps),
    )


def smooth(points: Points3D, options: SmoothOptions | None = None) -> Points3D:
    """Clean and smooth points over time: left-right flips, outliers, short gaps, noise.

    By default a Kalman smoother (Rauch, Tung and Striebel, 1965) that weighs every point by its covariance and adds no
    lag.

    Args:
        points: T frames of J points, metres; NaN where missing.
        options: see `SmoothOptions`; `method` chooses other filters.

    Returns:
        The same landmarks and frames, with the covariance of the smoothed positions. Gaps longer than
        `options.max_gap` stay NaN.

    Raises:
        MuybridgeError: `options.cutoff_hz` is at or above half the frame rate.

    Example:
        >>> import muybridge, numpy
        >>> line = numpy.linspace(0.0, 1.0, 50)[:, None, None] * numpy.ones((1, 1, 3))
        >>> noisy = line + numpy.random.default_rng(0).normal(0, 0.01, line.shape)
        >>> points = muybridge.smooth(muybridge.make_points(noisy, ["wrist"], fps=50))
        >>> bool(numpy.abs(points.points_world - line).mean() < 0.5 * numpy.abs(noisy - line).mean())
        True
    """
    return smooth_points(points, options)


def fit_body(points: Points3D, options: FitOptions | None = None) -> BodyFit:
    """Fit a human skeleton with constant bones to labelled points.

    Bone lengths, joint angles and the points' weights are estimated in turns over the whole take, with published body
    proportions as the prior.

    Args:
        points: T frames of J points, metres, Z up; NaN where missing. Landmarks are matched by name with `BODY23`,
            others are left out.
        options: see `FitOptions`.

    Returns:
        `motion` with every frame of the take and no NaN, `body` with the bones and the estimated stature (metres), and
        how well each point agrees.

    Raises:
        MuybridgeError: no frame has a point, or neither both hips nor both shoulders are ever known.

    Example:
        >>> import muybridge
        >>> points = muybridge.capture("session").points["body23"]
        >>> fit = muybridge.fit_body(points)
        >>> len(fit.motion), 1.4 < fit.body.stature_m < 2.1
        (48, True)
    """
    return _fit_body(points, options)


def solve_ik(
    tree: KinematicTree,
    goals: Sequence[Goal],
    start: FloatArray | None = None,
    *,
    method: str = "damped",
    options: IkOptions | None = None,
    constraint: LinearConstraint | None = None,
    prior: PosePrior | None = None,
) -> IkResult:
    """Solve inverse kinematics: joint angles that bring end effectors to their goals, within the joints' limits.

    Args:
        tree: N hinges; `tree_of_skeleton` makes one of a skeleton, `chain_of_balls` of link lengths.
        goals: one an end effector, metres and radians in the base's axes; out of reach, the least sum of squares is
            looked for.
        start: (N,) radians; the tree's preferred angles where it is None.
        method: `transpose`, `pseudo_inverse`, `damped` (Buss, 2004), `null_space`, `ccd`, `fabrik` (Aristidou and
            Lasenby, 2011), `nonlinear` (nonlinear programming) or `gmm_prior` (with a prior of likely poses).
        options: see `IkOptions`.
        constraint: linear equations and inequalities between angles, for `nonlinear` alone.
        prior: of likely poses, for `gmm_prior` alone, which needs it.

    Returns:
        The angles, each goal's error, and whether all are within tolerance.

    Raises:
        ValueError: an unknown method, or an argument that this method does not take or lacks.

    Example:
        >>> import muybridge, numpy
        >>> arm = muybridge.chain_of_balls([0.3, 0.3])
        >>> hand = muybridge.Goal(joint=5, offset=numpy.array([0, 0, 0.3]), position=numpy.array([0.3, 0.0, 0.3]))
        >>> muybridge.solve_ik(arm, [hand]).success
        True
    """
    return _solve_ik(tree, goals, start, method, options, constraint, prior)


def _landmark_set(landmarks: LandmarkSet | Sequence[str]) -> LandmarkSet:
    if isinstance(landmarks, LandmarkSet):
        return landmarks
    names = tuple(str(name) for name in landmarks)
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(f"landmark names repeat: {', '.join(repeated)}")
    return LandmarkSet("landmarks", names, ())


def _checked_fps(fps: float) -> float:
    if not 0 < fps < float("inf"):
        raise ValueError(f"fps is {fps}: frames a second, above zero")
    return float(fps)
