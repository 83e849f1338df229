"""The compiled part of `whole_take`: one point from its views and from priors."""

import math

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.triangulation._kernel import (
    Limits,
    Rig,
    Views,
    compiled,
    inverse3,
    normal_equations,
    score_of_point,
)

_STEPS = 12
# Largest cost of leaving the path: more than one wrong view, so that the path decides between conflicting views, and
# less than two, so that it does not overrule agreeing views when somebody jumps.
_BREAK = 24.0


@compiled
def _far(point: FloatArray, mean: FloatArray, info: FloatArray) -> float:
    """Squared Mahalanobis distance."""
    total = 0.0
    for k in range(3):
        for m in range(3):
            total += (point[k] - mean[k]) * info[k, m] * (point[m] - mean[m])
    return total


@compiled
def _off_path(far: float, student_dof: float) -> tuple[float, float]:
    """Cost of a squared Mahalanobis distance from the path, and its derivative: Student's t, bounded.

    On the path the derivative is one: there the covariance holds.
    """
    heavy = student_dof + 3.0
    cost = heavy * math.log(1.0 + far / heavy)
    likely, broken = math.exp(-0.5 * cost), math.exp(-0.5 * _BREAK)
    return -2.0 * math.log(likely + broken), heavy / (heavy + far) * likely / (likely + broken)


@compiled
def _total(
    views: Views, point: FloatArray, limits: Limits, path: FloatArray, path_info: FloatArray,
    other: FloatArray, other_info: FloatArray,
    student_dof: float,
) -> float:  # fmt: skip
    """Twice the negative log posterior, up to a constant."""
    loss, _ = score_of_point(views, point, limits)
    off_path, _ = _off_path(_far(point, path, path_info), student_dof)
    return loss + off_path + _far(point, other, other_info)


@compiled
def _likeliest(
    views: Views, point: FloatArray, limits: Limits, path: FloatArray, path_info: FloatArray,
    other: FloatArray, other_info: FloatArray,
    student_dof: float, normal: FloatArray, covariance: FloatArray,
) -> float:  # fmt: skip
    """Damped Gauss-Newton in place; returns the cost, fills the covariance."""
    gradient, trial, damped, inverse = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 3))
    best = _total(views, point, limits, path, path_info, other, other_info, student_dof)
    damping = 1e-9
    for _ in range(_STEPS):
        normal_equations(views, point, limits, normal, gradient)
        _, weight = _off_path(_far(point, path, path_info), student_dof)
        for k in range(3):
            for m in range(3):
                normal[k, m] += weight * path_info[k, m] + other_info[k, m]
                gradient[k] += weight * path_info[k, m] * (point[m] - path[m])
                gradient[k] += other_info[k, m] * (point[m] - other[m])
        inverse3(normal, covariance)
        improved, decrease = False, 0.0
        while damping < 1e3:
            for k in range(3):
                for m in range(3):
                    damped[k, m] = normal[k, m]
                damped[k, k] += damping * (normal[0, 0] + normal[1, 1] + normal[2, 2])
            if not inverse3(damped, inverse):
                damping = max(damping * 100.0, 1e-6)
                continue
            decrease = 0.0
            for k in range(3):
                step = inverse[k, 0] * gradient[0] + inverse[k, 1] * gradient[1] + inverse[k, 2] * gradient[2]
                trial[k] = point[k] - step
                decrease += step * gradient[k]
            if decrease < 1e-4:
                break
            cost = _total(views, trial, limits, path, path_info, other, other_info, student_dof)
            if cost <= best:
                best, improved = cost, True
                point[:] = trial
                damping = max(damping * 0.1, 1e-9)
                break
            damping = max(damping * 100.0, 1e-6)
        if not improved:
            break
    return best


@compiled
def likeliest_points(
    rig: Rig, limits: Limits, seen: FloatArray, info: FloatArray, path: FloatArray, path_info: FloatArray,
    other: FloatArray, other_info: FloatArray, student_dof: float, points: FloatArray, covariances: FloatArray,
    begin: int, end: int,
) -> None:  # fmt: skip
    """Points `begin` to `end`, in place: the better of what is reached from the point and from its path.

    Args:
        rig, limits, seen, info: see `triangulation_kernel.solve_points`.
        path: (N, 3) where the landmark's path is expected to pass.
        path_info: (N, 3, 3) inverse covariance of the way off the path, of Student's t.
        other: (N, 3) what bones and recurrences say.
        other_info: (N, 3, 3) its inverse covariance.
        student_dof: of Student's t.
        points: (N, 3) starts, then results; NaN is left alone.
        covariances: (N, 3, 3) results.
        begin, end: which.
    """
    cameras = rig.poses.shape[0]
    rays = np.empty((cameras, 3))
    use = np.empty(cameras, dtype=np.int64)
    normal, first, second, trial = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for i in range(begin, end):
        if not np.isfinite(points[i, 0]):
            continue
        n = 0
        for c in range(cameras):
            if info[i, c] > 0.0:
                use[n] = c
                n += 1
        views = Views(rig.poses, rig.centers, seen[i], info[i], rays, use[:n])
        best = _likeliest(
            views, points[i], limits, path[i], path_info[i], other[i], other_info[i], student_dof, normal, first
        )
        trial[:] = path[i]
        cost = _likeliest(
            views, trial, limits, path[i], path_info[i], other[i], other_info[i], student_dof, normal, second
        )
        if cost < best - 1e-9:
            points[i, :] = trial
            covariances[i, :, :] = second
        else:
            covariances[i, :, :] = first
