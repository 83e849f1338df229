"""The problems of `muybridge.geometry.calibration.bundle_adjustment` for pycolmap's adjuster and for pyceres."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from itertools import product

import numpy as np
import pyceres
import pycolmap
from pycolmap import _core
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import parameter_kinds
from muybridge.geometry.calibration.bundle_adjustment.with_bones import ArticulatedProblem, ArticulatedState

_TOLERANCE = 1e-9  # relative decrease of the cost at which `adjust` stops
_BONES_TOLERANCE = 1e-5  # the same of `adjust_articulated`
_TERMS = _core.cost_functions


def lent_manifold() -> pyceres.Manifold:
    """The manifold of pycolmap's poses (7 numbers): pyceres cannot make it, so it comes out of an adjuster's problem.

    The problem that lends it must outlive the process: pyceres frees what belongs to pycolmap when the last reference
    goes, and the process crashes at its end.
    """
    rec = pycolmap.Reconstruction()
    rec.add_camera_with_trivial_rig(
        pycolmap.Camera(model="PINHOLE", width=9, height=9, params=[9, 9, 4, 4], camera_id=1)
    )
    spots = np.array([[0.1, 0, 3], [0, 0.1, 3], [0, 0, 3.1]])
    for k in (1, 2):
        seen = [pycolmap.Point2D(9 * p[:2] / p[2] + 4) for p in spots]
        image = pycolmap.Image(name=str(k), points2D=seen, camera_id=1, image_id=k)
        rec.add_image_with_trivial_frame(image, pycolmap.Rigid3d())
    for i, p in enumerate(spots):
        track = pycolmap.Track()
        track.add_element(1, i)
        track.add_element(2, i)
        rec.add_point3D(p, track)
    config = pycolmap.BundleAdjustmentConfig()
    config.add_image(1)
    config.add_image(2)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(pycolmap.BundleAdjustmentOptions(), config, rec)
    manifold = adjuster.problem.get_manifold(rec.images[1].frame.rig_from_world.params)
    for kept in (rec, adjuster, manifold):
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))
    return manifold


MANIFOLD = lent_manifold()


def pose_block(pose: FloatArray) -> FloatArray:
    """(7,) quaternion, x y z w, and translation of a (3, 4) pose."""
    return np.concatenate([Rotation.from_matrix(pose[:, :3]).as_quat(), pose[:, 3]])


def center_of(block: FloatArray) -> FloatArray:
    """(3,) where the camera of a pose block stands."""
    center: FloatArray = -Rotation.from_quat(block[:4]).inv().apply(block[4:])
    return center


@dataclass
class InCeres:
    """A problem as Ceres has it."""

    problem: pyceres.Problem
    lenses: list[FloatArray]
    poses: list[FloatArray]
    bodies: list[FloatArray]
    points: FloatArray
    summary: pyceres.SolverSummary


def solve(problem: pyceres.Problem, kind: pyceres.LinearSolverType, tolerance: float) -> pyceres.SolverSummary:
    """Solve with one thread."""
    options, summary = pyceres.SolverOptions(), pyceres.SolverSummary()
    options.linear_solver_type, options.num_threads, options.max_num_iterations = kind, 1, 100
    options.function_tolerance = tolerance
    options.gradient_tolerance = options.parameter_tolerance = 1e-14
    options.minimizer_progress_to_stdout = False
    options.logging_type = pyceres.LoggingType.SILENT
    pyceres.solve(options, problem, summary)
    return summary


def ceres_problem(p: AdjustProblem) -> InCeres:
    """An `AdjustProblem`, term by term, in C++ cost functions alone."""
    assert p.body is not None
    problem = pyceres.Problem()  # owns nothing: Python does
    lenses, poses = [np.array(c.params) for c in p.cameras], [pose_block(c.cam_from_world) for c in p.cameras]
    bodies, points = [pose_block(b) for b in p.bodies], np.array(p.points)
    loss = pyceres.CauchyLoss(p.loss_sigma)
    models = [getattr(pycolmap.CameraModelId, c.model) for c in p.cameras]
    rows = zip(p.camera, p.point, p.body, p.pixels, p.sigma_px, strict=True)
    for c, k, b, px, sigma in rows:
        if b < 0:
            term = _TERMS.ReprojErrorCost(models[c], np.eye(2) * sigma**2, px)
            problem.add_residual_block(term, loss, [points[k], poses[c], lenses[c]])
        else:
            term = _TERMS.RigReprojErrorCost(models[c], np.eye(2) * sigma**2, px)
            problem.add_residual_block(term, loss, [points[k], poses[c], bodies[b], lenses[c]])
    for k in np.unique(p.point):
        if not p.points_free[k]:
            problem.set_parameter_block_constant(points[k])
    for c, free in enumerate(p.free):
        kinds = parameter_kinds(p.cameras[c].model)
        held = [i for i, kind in enumerate(kinds) if not getattr(free, kind)]
        if len(held) == len(kinds):
            problem.set_parameter_block_constant(lenses[c])
        elif held:
            subset = pyceres.SubsetManifold(len(kinds), held)
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(subset))  # the problem doesn't own it
            problem.set_manifold(lenses[c], subset)
        problem.set_manifold(poses[c], MANIFOLD)
        if not free.pose:
            problem.set_parameter_block_constant(poses[c])
        if p.priors and p.priors[c] is not None:
            prior = p.priors[c]
            assert prior is not None
            covariance = np.linalg.inv(prior.information)
            problem.add_residual_block(pyceres.factors.NormalPrior(prior.mean[:, None], covariance), None, [lenses[c]])
    for b in np.unique(p.body[p.body >= 0]):
        problem.set_manifold(bodies[b], MANIFOLD)
    return InCeres(problem, lenses, poses, bodies, points, pyceres.SolverSummary())


def with_ceres(p: AdjustProblem) -> InCeres:
    """Build the problem and solve it."""
    out = ceres_problem(p)
    out.summary = solve(out.problem, pyceres.LinearSolverType.DENSE_SCHUR, _TOLERANCE)
    return out


class BoneTerm(pyceres.CostFunction):
    """A bone that keeps its length: logarithms compared, as ours does; a Python callback."""

    def __init__(self, stiffness: float):
        super().__init__()
        self.set_num_residuals(1)
        self.set_parameter_block_sizes([3, 3, 1])
        self.stiffness = stiffness

    def Evaluate(self, parameters, residuals, jacobians):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
        """pyceres' interface."""
        vector = parameters[0] - parameters[1]
        square = float(vector @ vector)
        residuals[0] = self.stiffness * (0.5 * np.log(square) - parameters[2][0])
        if jacobians is not None:
            slope = self.stiffness * vector / square
            if jacobians[0] is not None:
                jacobians[0][:] = slope
            if jacobians[1] is not None:
                jacobians[1][:] = -slope
            if jacobians[2] is not None:
                jacobians[2][:] = -self.stiffness
        return True


def bones_with_ceres(p: ArticulatedProblem, start: ArticulatedState) -> tuple[InCeres, FloatArray]:
    """An `ArticulatedProblem`; the solution and the lengths."""
    problem = pyceres.Problem()  # owns nothing: Python does
    poses = [pose_block(np.column_stack([r, -r @ c])) for r, c in zip(start.rotations, start.centers, strict=True)]
    points, lengths = np.array(start.points), np.log(start.lengths)[:, None].copy()
    lenses = [np.array([f, 0.0, 0.0]) for f in p.focal_px]
    loss, model = pyceres.CauchyLoss(p.loss_sigma), pycolmap.CameraModelId.SIMPLE_PINHOLE
    cameras, frames, count = p.sigma_px.shape
    known = np.isfinite(p.sigma_px).sum(axis=0) >= 2
    for c, t, k in product(range(cameras), range(frames), range(count)):
        if known[t, k] and np.isfinite(p.sigma_px[c, t, k]):
            term = _TERMS.ReprojErrorCost(model, np.eye(2) * p.sigma_px[c, t, k] ** 2, p.focal_px[c] * p.seen[c, t, k])
            problem.add_residual_block(term, loss, [points[t, k], poses[c], lenses[c]])
    for lens, pose in zip(lenses, poses, strict=True):
        problem.set_parameter_block_constant(lens)
        problem.set_manifold(pose, MANIFOLD)
    for t, (b, (i, j)) in product(range(frames), enumerate(p.bones)):
        if known[t, i] and known[t, j]:
            term = BoneTerm(start.lengths[b] / p.bone_sigma[b])
            problem.add_residual_block(term, loss, [points[t, i], points[t, j], lengths[b]])
    summary = solve(problem, pyceres.LinearSolverType.SPARSE_NORMAL_CHOLESKY, _BONES_TOLERANCE)
    return InCeres(problem, lenses, poses, [], points, summary), lengths


def with_pycolmap(p: AdjustProblem) -> tuple[pycolmap.Reconstruction, pycolmap.CeresBundleAdjustmentSummary]:
    """What its options express: one standard deviation for all; each lens is held whole, or has the same kinds free."""
    rec, sigma = pycolmap.Reconstruction(), float(np.median(p.sigma_px))
    options, config = pycolmap.BundleAdjustmentOptions(), pycolmap.BundleAdjustmentConfig()
    for c, camera in enumerate(p.cameras):
        rec.add_camera_with_trivial_rig(pycolmap.Camera(
            model=camera.model, width=camera.width, height=camera.height, params=camera.params, camera_id=c + 1
        ))  # fmt: skip
        seen = [pycolmap.Point2D(px) for px in p.pixels[p.camera == c]]
        image = pycolmap.Image(name=camera.name, points2D=seen, camera_id=c + 1, image_id=c + 1)
        rec.add_image_with_trivial_frame(image, pycolmap.Rigid3d(camera.cam_from_world))
        config.add_image(c + 1)
        if not p.free[c].focal:
            config.set_constant_cam_intrinsics(c + 1)
        if not p.free[c].pose:
            config.set_constant_rig_from_world_pose(rec.images[c + 1].frame_id)
    row = np.concatenate([np.arange(n) for n in np.bincount(p.camera, minlength=len(p.cameras))])
    for k in np.unique(p.point):
        track = pycolmap.Track()
        for n in np.flatnonzero(p.point == k):
            track.add_element(int(p.camera[n]) + 1, int(row[n]))
        rec.add_point3D(p.points[k], track)
    options.refine_focal_length, options.refine_principal_point, options.refine_extra_params = True, False, True
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = p.loss_sigma * sigma
    options.ceres.solver_options.num_threads = 1
    options.ceres.solver_options.function_tolerance = _TOLERANCE
    options.print_summary = False
    return rec, pycolmap.create_default_ceres_bundle_adjuster(options, config, rec).solve()


def error_behind() -> list[float]:
    """Residuals of pycolmap's reprojection term for a point behind its camera, observed 600 px from the centre."""
    problem = pyceres.Problem()
    term = _TERMS.ReprojErrorCost(pycolmap.CameraModelId.PINHOLE, np.eye(2), np.array([40.0, 360.0]))
    pose, lens = np.array([0, 0, 0, 1.0, 0, 0, 0]), np.array([900.0, 900.0, 640.0, 360.0])
    problem.add_residual_block(term, None, [np.array([0.1, 0.0, -3.0]), pose, lens])
    return [float(r) for r in problem.evaluate_residuals()]
