"""A body fitted to the markers on its skin: the classical solve, made robust.

First the person, once for the take: size and build (components of a statistical body), lengths of bones and places of
markers beyond it, together with the poses of some frames (Gauss-Newton, the poses eliminated by Schur's complement).
Then all frames together, tied by smoothness. Student's t weighs points throughout, against how far skin takes each
marker from its bone.

Source of the idea that one statistical body explains both markers and build: M. Loper, N. Mahmood, M. J. Black, "MoSh:
Motion and shape capture from sparse markers", ACM Transactions on Graphics 33, 2014.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.fitting.gauss_newton import (
    Pose,
    Problem,
    landmark_positions,
    solve_in_stretches,
)
from muybridge.geometry.fitting.subject import (
    MarkerFitOptions,
    Person,
    calibrate_person,
    fitting_problem,
    follow_take,
    settle_frames,
    weights,
)
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.body import Body
from muybridge.geometry.skeleton.joint_centres import JointCentres
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.statistical_body import body_of, without_rolls


@dataclass(frozen=True, eq=False)
class MarkerFit:
    """A body in motion, and how the markers agree.

    Attributes:
        motion: of BODY's joints, in every frame.
        body: its skeleton and the landmarks of BODY23 on it.
        markers_world: (T, L, 3) metres, where the body has the markers.
        residual_m: (T, L) metres from each marker given; NaN where missing.
        weight: (T, L) 0..1, how much each counted.
        noise_scale: standard deviations had to be taken times this to agree with the fit.
        person: what was calibrated.
    """

    motion: Motion
    body: Body
    markers_world: FloatArray
    residual_m: FloatArray
    weight: FloatArray
    noise_scale: float
    person: Person


def fit_markers(
    points_world: FloatArray, markers: IndexArray, fps: float, options: MarkerFitOptions | None = None,
    centres: JointCentres | None = None, person: Person | None = None,
) -> MarkerFit:  # fmt: skip
    """Fit the body to labelled markers, all frames together.

    Args:
        points_world: (T, L, 3) metres, Z up; NaN where missing.
        markers: (L,) index of each in SURFACE.
        fps: frames per second.
        options: see MarkerFitOptions.
        centres: joint centres that count besides the markers.
        person: calibrated before, on another take with the same markers; None does it on this one.

    Raises:
        MuybridgeError: fewer than six markers are seen together in every frame.
    """
    options, centres = options or MarkerFitOptions(), centres or JointCentres()
    points = np.concatenate([points_world, centres.points_world], 1) if centres.names else points_world
    person = person or calibrate_person(points, markers, fps, options, centres)
    pose = settle_frames(person, points, follow_take(person, points, fps, options), options)
    scale, weight = 1.0, np.isfinite(points[..., 0]).astype(np.float64)
    for _ in range(options.rounds):
        problem = fitting_problem(person, points, weight, scale, fps, options)
        scale, weight = weights(problem, pose, person, points, scale, options)
        problem = fitting_problem(person, points, weight, scale, fps, options)
        pose = solve_in_stretches(problem, pose, options.steps)
    scale, weight = weights(problem, pose, person, points, scale, options)
    return _result(person, problem, pose, points, len(markers), weight, scale, fps)


def _result(
    person: Person,
    problem: Problem,
    pose: Pose,
    points: FloatArray,
    count: int,
    weight: FloatArray,
    scale: float,
    fps: float,
) -> MarkerFit:
    rotations = problem.skeleton.rotations_from_angles(pose.angles)
    rotations[:, 0] = pose.turn
    skeleton, rotations = without_rolls(person.skeleton, rotations)
    motion = Motion(skeleton, fps, pose.root, continuous_quat(quat_from_matrix(rotations)))
    at = landmark_positions(problem, pose)[:, :count]
    residual = np.linalg.norm(at - points[:, :count], axis=-1)
    # Stature is a body's of these thighs and shins, by the mean's proportions.
    legs = [skeleton.index(f"{s}_{p}") for s in ("left", "right") for p in ("shin", "foot")]
    stature = float(skeleton.bone_lengths[legs].sum()) / 2 / 0.4906
    body = body_of(skeleton, person.landmarks, stature)
    return MarkerFit(motion, body, at, residual, weight[:, :count], float(np.sqrt(scale)), person)
