"""From labelled 3D points to a moving skeleton.

The recipe: clean the points, guess the body's size, pose it in closed form; then in turns weigh the points
by how well they fit, move the joints (whole take, with limits and smoothness), and re-estimate the lengths
from all frames with published proportions as the prior. Lengths are one set for the whole take.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.fitting._chain_kernel import rotations_of
from muybridge.geometry.fitting.bone_lengths import length_equations
from muybridge.geometry.fitting.gauss_newton import Pose, Problem, landmark_positions, solve_in_stretches
from muybridge.geometry.fitting.initial_pose import start_pose
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.covariances import inverses, squared_distances
from muybridge.geometry.numerics.rotations import continuous_quat, matrix_from_quat, quat_from_rotation
from muybridge.geometry.skeleton.body import BODY, SHAPE_PRIOR, STATURE_M, STATURE_SD_M, Body, BodyModel, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.smoothing.kalman import SmoothOptions, clean_points, known_points, smooth_points

_CHI2_3_MEDIAN = 2.366


@dataclass(frozen=True)
class FitOptions:
    """How a body is fitted to points.

    Attributes:
        rounds: how often weights, pose and lengths are re-estimated in turns.
        steps: Gauss-Newton steps a round.
        student_dof: degrees of freedom of Student's t, the robust loss: smaller trusts far points less.
        model_sigma: metres, how far a landmark is from its place on a rigid body even if seen perfectly.
        root_acceleration: metres per second squared, standard deviation of the root's acceleration.
        angular_acceleration: radians per second squared, of every angle's.
        root_velocity: metres per second, holds the root back across gaps.
        angular_velocity: radians per second, the same for angles.
        prior_weight: how much the weak prior on angles counts in a frame against a landmark's covariance.
        shape_frames: the take counts as so many independent frames when lengths are estimated: what the
            landmarks' errors have in common does not average out.
        clean: what is done to the points before; `smooth_points` itself is only used for the first guess.
    """

    rounds: int = 3
    steps: int = 2
    student_dof: float = 4.0
    model_sigma: float = 0.012
    root_acceleration: float = 6.0
    angular_acceleration: float = 40.0
    root_velocity: float = 3.0
    angular_velocity: float = 12.0
    prior_weight: float = 0.5
    shape_frames: int = 60
    clean: SmoothOptions = field(default_factory=SmoothOptions)


@dataclass(frozen=True, eq=False)
class BodyFit:
    """A person in motion, and how the points agree.

    Attributes:
        motion: the skeleton over time.
        body: the same skeleton with the landmarks on it.
        residual_m: (T, J) metres from each input point to the body's landmark; NaN where there was no
            point or the body has no such landmark. A point that was swapped with its other side is compared with that.
        weight: (T, J) 0..1, how much each point counted; 0 where missing or an outlier.
        noise_scale: the points' standard deviations had to be taken times this to agree with the fit.
    """

    motion: Motion
    body: Body
    residual_m: FloatArray
    weight: FloatArray
    noise_scale: float


def fit_motion(points: Points3D, options: FitOptions | None = None) -> Motion:
    """The motion of `fit_body`."""
    return fit_body(points, options).motion


def fit_body(points: Points3D, options: FitOptions | None = None) -> BodyFit:
    """Fit a skeleton with constant bones to labelled points.

    Args:
        points: (T, J, 3) metres with covariances (NaN: unknown); NaN where missing. Landmarks are matched by
            name with those of BODY23; others are left out.
        options: see FitOptions.

    Returns:
        A BodyFit whose motion has every frame of the take and no NaN: where nothing is known between known
        frames it is interpolated, beyond them held still.

    Raises:
        MuybridgeError: no frame has a point, or neither both hips nor both shoulders are ever known.
    """
    options = options or FitOptions()
    model = BODY
    column, first, last = _check(model, points)
    inside = replace(
        points,
        landmarks=LandmarkSet("fit", model.landmark_names, ()),
        points_world=_columns(points.points_world[first : last + 1], column),
        covariance_world=_columns(points.covariance_world[first : last + 1], column),
    )
    cleaned = clean_points(inside, options.clean)
    targets, covariance = known_points(cleaned, options.clean.default_sigma)
    fill = replace(options.clean, unflip=False, hampel_window=0.0, max_gap=np.inf, extrapolate=True)
    filled = smooth_points(cleaned, fill).points_world
    shape = _first_shape(model, filled)
    pose = Pose(*start_pose(model, shape, filled))
    known = np.isfinite(targets[..., 0])
    scale = 1.0
    weight = known.astype(np.float64)
    for k in range(options.rounds + 1):
        problem = fitting_problem(model, shape, targets, covariance, scale, known, weight, points.fps, options)
        pose = solve_in_stretches(problem, pose, options.steps)
        if k < options.rounds:
            shape = _fit_shape(model, problem, pose, options.shape_frames)
            problem = replace(problem, landmark_offsets=model.landmark_offsets(shape), skeleton=model.skeleton(shape))
            scale, weight = _weights(problem, pose, covariance, known, scale, options)
    body = Body(
        skeleton=model.skeleton(shape),
        landmark_names=model.landmark_names,
        landmark_joints=model.landmark_joints,
        landmark_offsets=model.landmark_offsets(shape),
        stature_m=_stature(shape),
    )
    error = np.linalg.norm(landmark_positions(problem, pose) - targets, axis=-1)
    motion = _motion(problem, pose, points.fps, first, len(points.points_world) - 1 - last)
    residual = np.full(points.points_world.shape[:2], np.nan)
    counted = np.zeros(residual.shape)
    has = column >= 0
    residual[first : last + 1, column[has]] = error[:, has]
    counted[first : last + 1, column[has]] = weight[:, has]
    return BodyFit(motion, body, residual, counted, float(np.sqrt(scale)))


def landmarks_from_motion(motion: Motion, body: Body, landmarks: LandmarkSet) -> FloatArray:
    """Where the body's landmarks are: consistent with constant bones, known in every frame.

    Args:
        motion: of the same skeleton as `body`.
        body: where the landmarks sit.
        landmarks: the order wanted.

    Returns:
        (T, J, 3) metres, NaN for a landmark that the body does not have.
    """
    turns, places = motion.skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))
    j = body.landmark_joints
    at = places[:, j] + (turns[:, j] @ body.landmark_offsets[..., None])[..., 0]
    return _columns(at, _column_of(landmarks.names, body.landmark_names))


def _column_of(wanted: tuple[str, ...], names: tuple[str, ...]) -> IndexArray:
    """For each wanted name its column in `names`, or -1."""
    return np.array([names.index(n) if n in names else -1 for n in wanted], dtype=np.intp)


def _columns(values: FloatArray, column: IndexArray) -> FloatArray:
    """`values` (T, J, ...) reordered; NaN where the column is -1."""
    out = np.array(values[:, column], dtype=np.float64)
    out[:, column < 0] = np.nan
    return out


def _check(model: BodyModel, points: Points3D) -> tuple[IndexArray, int, int]:
    """Columns of the model's landmarks, first and last frame with a point; errors where there is none."""
    if not points.fps > 0:
        raise ValueError(f"fps must be above zero, not {points.fps}")
    column = _column_of(model.landmark_names, points.landmarks.names)
    finite = np.all(np.isfinite(points.points_world), axis=-1)
    ever = {n: c >= 0 and bool(finite[:, c].any()) for n, c in zip(model.landmark_names, column, strict=True)}
    if not any(ever.values()):
        raise MuybridgeError(
            "the take has no 3D point of any landmark that the body knows; check the overlay videos for 2D "
            "detections and the calibration for cameras that agree"
        )
    if not any(ever[f"left_{k}"] and ever[f"right_{k}"] for k in ("hip", "shoulder")):
        raise MuybridgeError(
            "neither both hips nor both shoulders are known in 3D in any frame, so the body has no place; "
            "more cameras must see the trunk"
        )
    frames = np.flatnonzero(finite[:, column[column >= 0]].any(axis=1))
    return column, int(frames[0]), int(frames[-1])


def _first_shape(model: BodyModel, filled: FloatArray) -> FloatArray:
    """Published proportions, with the stature that fits the median lengths of trunk and limbs."""
    at = {name: filled[:, i] for i, name in enumerate(model.landmark_names)}
    pairs = {"upper_arm": ("shoulder", "elbow"), "forearm": ("elbow", "wrist"), "thigh": ("hip", "knee"),
             "shin": ("knee", "ankle"), "trunk": ("hip", "shoulder")}  # fmt: skip
    statures, weights = [STATURE_M], [1.0 / STATURE_SD_M**2]
    for name, (a, b) in pairs.items():
        ratio, spread = SHAPE_PRIOR[name]
        for side in ("left_", "right_"):
            length = np.linalg.norm(at[side + a] - at[side + b], axis=-1)
            if np.isfinite(length).all():
                statures.append(float(np.median(length)) / ratio)
                weights.append((ratio / spread / statures[-1]) ** 2)
    order = np.argsort(statures)
    share = np.cumsum(np.array(weights)[order])
    return prior_shape(float(np.array(statures)[order][np.searchsorted(share, 0.5 * share[-1])]))


def _stature(shape: FloatArray) -> float:
    """The most likely stature of the shape, by the prior's proportions."""
    ratio, spread = np.array(list(SHAPE_PRIOR.values())).T
    information = np.sum((ratio / spread / STATURE_M) ** 2) + 1 / STATURE_SD_M**2
    pull = np.sum(ratio * shape / (spread * STATURE_M) ** 2) + STATURE_M / STATURE_SD_M**2
    return float(pull / information)


def fitting_problem(
    model: BodyModel, shape: FloatArray, targets: FloatArray, covariance: FloatArray, scale: float,
    known: BoolArray, weight: FloatArray, fps: float, options: FitOptions,
) -> Problem:  # fmt: skip
    noise = covariance * scale + np.eye(3) * options.model_sigma**2
    information = inverses(noise) * (weight * known)[..., None, None]
    j_count = len(model.joint_names)
    spread = np.maximum(model.spread, 1e-3)
    acceleration = np.full(6 + 3 * j_count, (fps**2 / options.angular_acceleration) ** 2)
    acceleration[:3] = (fps**2 / options.root_acceleration) ** 2
    velocity = np.full(6 + 3 * j_count, (fps / options.angular_velocity) ** 2)
    velocity[:3] = (fps / options.root_velocity) ** 2
    return Problem(
        skeleton=model.skeleton(shape),
        landmark_joints=model.landmark_joints,
        landmark_offsets=model.landmark_offsets(shape),
        targets=np.where(known[..., None], targets, 0.0),
        information=information,
        rest=model.rest,
        prior=options.prior_weight / spread**2,
        acceleration=acceleration,
        velocity=velocity,
    )


def _weights(
    problem: Problem,
    pose: Pose,
    covariance: FloatArray,
    known: BoolArray,
    scale: float,
    options: FitOptions,
) -> tuple[float, FloatArray]:
    """Scale of the covariances by the median squared distance, and Student's t weights (T, L)."""
    error = landmark_positions(problem, pose) - problem.targets
    floor = np.eye(3) * options.model_sigma**2

    def far(factor: float) -> FloatArray:
        return squared_distances(error, covariance * factor + floor)

    # Two fixed-point steps: the model's own share of the noise is not scaled.
    for _ in range(2):
        ratio = float(np.median(far(scale)[known])) / _CHI2_3_MEDIAN
        scale = float(np.clip(scale * np.clip(ratio, 0.2, 5.0), 0.05, 400.0))
    weight = (options.student_dof + 3) / (options.student_dof + far(scale))
    return scale, np.where(known, np.minimum(weight, 1.0), 0.0)


def _fit_shape(model: BodyModel, problem: Problem, pose: Pose, shape_frames: int) -> FloatArray:
    """Lengths and landmark offsets by linear least squares, given the pose; the root's place is left free.

    Unknown are the shape and the stature; the stature's share of each length is the prior's mean.
    """
    matrix, vector = length_equations(problem, pose, model.joint_basis, model.landmark_basis)
    size = len(vector)
    share = min(1.0, shape_frames / (len(pose) / max(len(pose) // 1000, 1)))
    ratio, spread = np.array(list(SHAPE_PRIOR.values())).T
    certain = 1.0 / (spread * STATURE_M) ** 2
    full = np.zeros((size + 1, size + 1))
    full[:size, :size] = share * matrix + np.diag(certain)
    full[:size, size] = full[size, :size] = -certain * ratio
    full[size, size] = np.sum(certain * ratio**2) + 1 / STATURE_SD_M**2
    solved = np.linalg.solve(full, np.r_[share * vector, STATURE_M / STATURE_SD_M**2])
    shape = np.asarray(solved[:size], dtype=np.float64)
    # No length may vanish or turn round, whatever the data; offsets of small landmarks may.
    mean = prior_shape(_stature(shape))
    return np.where(ratio > 0.05, np.clip(shape, 0.4 * mean, 2.0 * mean), shape)


def _motion(problem: Problem, pose: Pose, fps: float, before: int, after: int) -> Motion:
    """The motion, its first frame held for `before` frames and its last for `after`."""
    rotations = rotations_of(problem.chain, pose.turn, pose.angles)
    quat = continuous_quat(quat_from_rotation(rotations))
    return Motion(
        skeleton=problem.skeleton,
        fps=fps,
        root_positions_world=np.pad(pose.root, ((before, after), (0, 0)), mode="edge"),
        quat_wxyz=np.pad(quat, ((before, after), (0, 0), (0, 0)), mode="edge"),
    )
