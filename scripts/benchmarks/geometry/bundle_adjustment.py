"""Our bundle adjustment against pycolmap's adjuster and its Ceres terms through pyceres, on the same problems.

    pip install pyceres==2.6
    python -m scripts.benchmarks.geometry.bundle_adjustment

- points: cameras on a ring and world points, 5 % outliers, a standard deviation for each observation, and other
  parameters held in every camera. Solved by ours, by pyceres with pycolmap's reprojection terms, and by pycolmap's
  adjuster alone, which takes one standard deviation and one set of refined parameters for all cameras.
- boards: cameras and the poses of a rigid board, a Gaussian prior on every lens.
- bones: cameras, landmarks over time and bone lengths; the bone terms are Python callbacks in pyceres.
- covariances: of the cameras of `points` and `boards`.

One thread each, CPU seconds, the fastest of three runs. Everything is drawn from fixed seeds.
"""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
import pyceres
import pycolmap
from pycolmap import _core
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.adjustment import (
    AdjustProblem,
    AdjustResult,
    FreeCamera,
    LensPrior,
    adjust,
)
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import parameter_kinds
from muybridge.geometry.calibration.bundle_adjustment.with_bones import (
    ArticulatedProblem,
    ArticulatedState,
    adjust_articulated,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3
from scripts.benchmarks.geometry.calibration import ring

T = TypeVar("T")
_REPEATS = 3
_TOLERANCE = 1e-9  # relative decrease of the cost at which `adjust` stops
_TERMS = _core.cost_functions


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What a call returns, and the CPU seconds of the fastest of three."""
    best, out = np.inf, None
    for _ in range(_REPEATS):
        began = time.process_time()
        out = call()
        best = min(best, time.process_time() - began)
    assert out is not None
    return out, best


# ---- the problems


def shaken(cameras: CameraGroup, rng: np.random.Generator, held: int) -> CameraGroup:
    """The cameras, all but the first few turned by about 1 degree and moved by 5 cm."""
    out = list(cameras)[:held]
    for camera in list(cameras)[held:]:
        turned = exp_so3(rng.normal(size=3) * 0.02) @ camera.rotation
        center = camera.center_world + rng.normal(size=3) * 0.05
        out.append(camera.posed(np.column_stack([turned, -turned @ center])))
    return CameraGroup(tuple(out))


def points_problem(count: int = 8, points: int = 600) -> tuple[AdjustProblem, CameraGroup]:
    """Two cameras are held whole, two keep their lenses, and the others have a focal length or all but one free."""
    rng = np.random.default_rng(1)
    truth, world = ring(count, rng), rng.uniform([-1.5, -1.5, 0], [1.5, 1.5, 2], size=(points, 3))
    camera, point = np.nonzero(rng.random((count, points)) < 0.7)
    kept = np.bincount(point, minlength=points)[point] >= 2
    camera, point = camera[kept], point[kept]
    sigma = rng.uniform(0.3, 3.0, len(camera))
    pixels = truth.project(world)[camera, point] + rng.normal(size=(len(camera), 2)) * sigma[:, None]
    wrong = rng.random(len(camera)) < 0.05
    pixels[wrong] += rng.normal(size=(int(wrong.sum()), 2)) * 60
    kinds = (FreeCamera(pose=False),) * 2 + (FreeCamera(),) * 2 + (FreeCamera(focal=True),) * 2
    kinds += (FreeCamera(focal=True, distortion=True),) * (count - 6)
    start = tuple(replace(c, params=(*c.params[:4], 0.0, 0.0, 0.0, 0.0)) if free.distortion else c
                  for c, free in zip(shaken(truth, rng, 2), kinds, strict=True))  # fmt: skip
    return AdjustProblem(
        CameraGroup(start), camera, point, pixels, sigma, world + rng.normal(size=world.shape) * 0.03,
        np.ones(points, bool), kinds,
    ), truth  # fmt: skip


def boards_problem(count: int = 4, poses: int = 60) -> tuple[AdjustProblem, CameraGroup]:
    """A board of 9 x 6 corners, 80 mm apart, in many poses; the first camera is the world, lenses have a prior."""
    rng = np.random.default_rng(2)
    truth = ring(count, rng)
    corners = np.stack([*np.meshgrid(np.arange(9) * 0.08, np.arange(6) * 0.08), np.zeros((6, 9))], -1).reshape(-1, 3)
    corners -= corners.mean(axis=0)
    rows: list[tuple[int, int, int, FloatArray]] = []
    bodies = np.empty((poses, 3, 4))
    for b in range(poses):
        turn, place = exp_so3(rng.normal(size=3) * 1.2), np.array([0, 0, 1.0]) + rng.uniform(-0.8, 0.8, size=3)
        bodies[b] = np.column_stack([turn, place])
        for c, camera in enumerate(truth):
            px = camera.project(corners @ turn.T + place)
            if abs(turn[:, 2] @ camera.rotation[2]) > 0.3 and np.all((px > 0) & (px < [1919, 1079])):
                rows += [(c, b, k, p) for k, p in enumerate(px + rng.normal(size=px.shape) * 0.3)]
    camera_of, body, point = (np.array([r[i] for r in rows]) for i in range(3))
    spread = np.array([200.0, 200, 40, 40, 0.1, 0.1, 0.005, 0.005])
    priors = tuple(LensPrior(np.array(c.params), np.diag(spread**-2)) for c in truth)
    bodies[:, :, :3] = exp_so3(rng.normal(size=(poses, 3)) * 0.02) @ bodies[:, :, :3]
    bodies[:, :, 3] += rng.normal(size=(poses, 3)) * 0.02
    free = (FreeCamera(True, True, True, pose=False), *(FreeCamera(True, True, True),) * (count - 1))
    return AdjustProblem(
        shaken(truth, rng, 1), camera_of, point, np.array([r[3] for r in rows]), np.full(len(rows), 0.3), corners,
        np.zeros(len(corners), bool), free, body, bodies, priors=priors,
    ), truth  # fmt: skip


def bones_problem(count: int = 4, frames: int = 100) -> tuple[ArticulatedProblem, ArticulatedState, CameraGroup]:
    """A chain of 16 landmarks with constant lengths that moves about; 3 px of noise, 5 % outliers, 10 % missing."""
    rng = np.random.default_rng(3)
    lenses = ring(count, rng)
    truth = CameraGroup(tuple(Camera(c.name, "SIMPLE_PINHOLE", c.width, c.height, (c.params[0], 960.0, 540.0),
                                     c.cam_from_world) for c in lenses))  # fmt: skip
    bones = np.stack([np.arange(15), np.arange(1, 16)], axis=1)
    way = np.cumsum(rng.normal(size=(frames, 15, 3)) * 0.2, axis=0) + rng.normal(size=(15, 3)) * 2
    way *= rng.uniform(0.1, 0.4, 15)[:, None] / np.linalg.norm(way, axis=-1, keepdims=True)
    world = np.concatenate([np.zeros((frames, 1, 3)), np.cumsum(way, axis=1)], axis=1)
    world += rng.uniform(-0.8, 0.8, size=(frames, 1, 3)) + [0, 0, 1.0]
    px = truth.project(world) + rng.normal(size=(count, frames, 16, 2)) * 3
    wrong = rng.random(px.shape[:-1]) < 0.05
    px[wrong] += rng.normal(size=(int(wrong.sum()), 2)) * 60
    sigma = np.where(rng.random(px.shape[:-1]) < 0.1, np.nan, rng.uniform(2, 6, px.shape[:-1]))
    focal = np.array([c.params[0] for c in truth])
    start = shaken(truth, rng, 0)
    problem = ArticulatedProblem(truth.unproject(px), focal, sigma, bones, np.full(15, 0.02))
    lengths = np.linalg.norm(world[0, bones[:, 0]] - world[0, bones[:, 1]], axis=-1) * 1.02
    points = world + rng.normal(size=world.shape) * 0.03
    return problem, ArticulatedState(start.cam_from_world[:, :, :3], start.centers_world, np.zeros(count), points,
                                lengths), truth  # fmt: skip


# ---- pyceres


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
    summary = solve(problem, pyceres.LinearSolverType.SPARSE_NORMAL_CHOLESKY, 1e-5)
    return InCeres(problem, lenses, poses, [], points, summary), lengths


# ---- pycolmap's adjuster alone


def with_pycolmap(p: AdjustProblem) -> tuple[pycolmap.Reconstruction, pycolmap.CeresBundleAdjustmentSummary]:
    """What its options can say: one standard deviation for all; each lens is held whole, or has the same kinds free."""
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


# ---- what is compared


def robust_cost(p: AdjustProblem, residuals: FloatArray, lenses: list[FloatArray]) -> float:
    """What both make small."""
    r2 = ((residuals / p.sigma_px[:, None]) ** 2).sum(axis=1)
    known = [d @ q.information @ d for q, lens in zip(p.priors, lenses, strict=False) if q for d in [lens - q.mean]]
    return float(0.5 * p.loss_sigma**2 * np.log1p(r2 / p.loss_sigma**2).sum() + 0.5 * sum(known))


def off_mm(centers: FloatArray, truth: CameraGroup) -> float:
    """RMS error of the free cameras' places."""
    far = np.linalg.norm(centers - truth.centers_world, axis=1)
    return 1e3 * float(np.sqrt(np.mean(far[far > 0] ** 2)))


def line(*cells: object) -> None:
    """A row of a Markdown table."""
    print("| " + " | ".join(str(c) for c in cells) + " |", flush=True)


def compare(name: str, p: AdjustProblem, truth: CameraGroup) -> tuple[AdjustResult, InCeres]:
    """Ours and pyceres on one problem."""
    ours, took = timed(lambda: adjust(p))
    cost = robust_cost(p, ours.residuals_px, [np.array(c.params) for c in ours.cameras])
    line(name, len(p.camera), "ours", f"{off_mm(ours.cameras.centers_world, truth):.3f}", f"{cost:.6f}",
         ours.iterations, f"{took:.2f}")  # fmt: skip
    ceres, whole = timed(lambda: with_ceres(p))
    centers = np.array([center_of(b) for b in ceres.poses])
    s = ceres.summary
    line(name, len(p.camera), "pyceres", f"{off_mm(centers, truth):.3f}", f"{s.final_cost:.6f}",
         s.num_successful_steps + s.num_unsuccessful_steps,
         f"{whole:.2f} (solving: {s.total_time_in_seconds:.2f})")  # fmt: skip
    apart = np.linalg.norm(centers - ours.cameras.centers_world, axis=1).max()
    lens = max(np.abs(a - b.params).max() for a, b in zip(ceres.lenses, ours.cameras, strict=True))
    print(f"<!-- {name}: largest differences: {apart * 1e6:.2g} um, lens parameters {lens:.2g} -->")
    return ours, ceres


def alone(p: AdjustProblem, truth: CameraGroup) -> None:
    """pycolmap's adjuster on what it can say of the problem."""
    (rec, summary), took = timed(lambda: with_pycolmap(p))
    centers = np.array([rec.images[c + 1].projection_center() for c in range(len(p.cameras))])
    s = summary.ceres_summary
    line("points", len(p.camera), "pycolmap", f"{off_mm(centers, truth):.3f}", "another",
         s.num_successful_steps + s.num_unsuccessful_steps,
         f"{took:.2f} (solving: {s.total_time_in_seconds:.2f})")  # fmt: skip


def aligned(rotations: FloatArray, centers: FloatArray, truth: CameraGroup) -> tuple[FloatArray, FloatArray]:
    """Camera centres, and rotations, after the similarity that brings them nearest to the truth."""
    turn = Rotation.from_matrix(np.swapaxes(np.stack([c.rotation for c in truth]), 1, 2) @ rotations).mean()
    own, wanted = turn.apply(centers - centers.mean(0)), truth.centers_world - truth.centers_world.mean(0)
    scale = (own * wanted).sum() / (own**2).sum()
    return scale * own + truth.centers_world.mean(0), rotations @ turn.inv().as_matrix()


def bones() -> None:
    """People and bones."""
    problem, start, truth = bones_problem()
    ours, took = timed(lambda: adjust_articulated(problem, start))
    (ceres, _), whole = timed(lambda: bones_with_ceres(problem, start))
    poses = np.array(ceres.poses)
    turned = Rotation.from_quat(poses[:, :4]).as_matrix()
    count = int(np.isfinite(problem.sigma_px).sum())
    a, _ = aligned(ours.state.rotations, ours.state.centers, truth)
    b, _ = aligned(turned, np.array([center_of(x) for x in poses]), truth)
    s = ceres.summary
    line("bones", count, "ours", f"{off_mm(a, truth):.3f}", f"{ours.cost:.6f}", ours.iterations, f"{took:.2f}")
    line("bones", count, "pyceres", f"{off_mm(b, truth):.3f}", f"{s.final_cost:.6f}",
         s.num_successful_steps + s.num_unsuccessful_steps,
         f"{whole:.2f} (solving: {s.total_time_in_seconds:.2f})")  # fmt: skip
    print(f"<!-- bones: largest difference of a camera {1e6 * np.linalg.norm(a - b, axis=1).max():.2g} um -->")


def covariances(name: str, p: AdjustProblem, ours: AdjustResult, ceres: InCeres) -> None:
    """Standard deviations of the cameras' places and focal lengths, both from the given precision alone."""

    def of_ceres() -> tuple[FloatArray, FloatArray]:
        options = pyceres.CovarianceOptions()
        covariance = pyceres.Covariance(options)
        blocks = [(b, b) for b in (*ceres.poses, *ceres.lenses) if not ceres.problem.is_parameter_block_constant(b)]
        if not covariance.compute(blocks, ceres.problem):
            raise RuntimeError("Ceres finds no covariance")
        place, focal = np.zeros(len(ceres.poses)), np.zeros(len(ceres.poses))
        for c, (pose, lens) in enumerate(zip(ceres.poses, ceres.lenses, strict=True)):
            if not ceres.problem.is_parameter_block_constant(pose):
                block = covariance.get_covariance_block(pose, pose)
                step = np.eye(7) * 1e-6
                turn = np.stack([(center_of(pose + d) - center_of(pose - d)) / 2e-6 for d in step], axis=1)
                place[c] = np.sqrt(np.trace(turn @ block @ turn.T))
            if not ceres.problem.is_parameter_block_constant(lens):
                focal[c] = np.sqrt(covariance.get_covariance_block(lens, lens)[0, 0])
        return place, focal

    (place, focal), took = timed(of_ceres)
    free = place > 0
    a, b = ours.position_std[free] / ours.noise, place[free]
    line(name, "ours", f"{1e3 * a.mean():.4f}", f"{ours.focal_std[focal > 0].mean() / ours.noise:.4f}", "in the above")
    line(name, "pyceres", f"{1e3 * b.mean():.4f}", f"{focal[focal > 0].mean():.4f}", f"{took:.2f} more")
    print(
        f"<!-- {name}: standard deviations of places, ours over Ceres': {(a / b).min():.4f} to {(a / b).max():.4f} -->"
    )


def main() -> None:
    print(
        f"pycolmap {pycolmap.__version__}, pyceres with Ceres {pycolmap.__ceres_version__}, Python {sys.version[:6]}\n"
    )
    line("problem", "observations", "by", "RMS error of the cameras, mm", "cost at the end", "iterations", "CPU s")
    line(*["---"] * 7)
    of_points, of_boards = points_problem(), boards_problem()
    first = compare("points", *of_points)
    alone(*of_points)
    second = compare("boards", *of_boards)
    bones()
    print()
    line("covariances", "by", "places, mm", "focal lengths, px", "CPU s")
    line(*["---"] * 5)
    covariances("points", of_points[0], *first)
    covariances("boards", of_boards[0], *second)
    # Ceres' problems refer to manifolds that belong to pycolmap: they are not freed in an order that is safe.
    sys.stdout.flush()


if __name__ == "__main__":
    main()
