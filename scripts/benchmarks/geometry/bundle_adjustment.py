"""Our bundle adjustment against pycolmap's adjuster and its Ceres terms through pyceres, on the same problems.

    pip install pyceres==2.6
    python -m scripts.benchmarks.geometry.bundle_adjustment

- points: cameras on a ring and world points, 5 % outliers, a standard deviation for each observation, and other
  parameters held in every camera. Solved by ours, by pyceres with pycolmap's reprojection terms, and by pycolmap's
  adjuster alone, which takes one standard deviation and one set of refined parameters for all cameras.
- boards: cameras and the poses of a rigid board, a Gaussian prior on every lens.
- bones: cameras, landmarks over time and bone lengths; the bone terms are Python callbacks in pyceres.
- covariances: of the cameras of `points` and `boards`, and of `points` with no camera held, where the world may move
  as a whole.
- a point behind its camera: what the residual is.

One thread each, CPU seconds, the fastest of three runs. Everything is drawn from fixed seeds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pyceres
import pycolmap
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.adjustment import (
    AdjustProblem,
    AdjustResult,
    FreeCamera,
    LensPrior,
    adjust,
)
from muybridge.geometry.calibration.bundle_adjustment.with_bones import (
    ArticulatedProblem,
    ArticulatedState,
    adjust_articulated,
)
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3
from scripts.benchmarks.geometry.bundle_adjustment_ceres import (
    InCeres,
    bones_with_ceres,
    center_of,
    ceres_problem,
    error_behind,
    with_ceres,
    with_pycolmap,
)
from scripts.benchmarks.geometry.calibration import ring

T = TypeVar("T")
_REPEATS = 3


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What a call returns, and the CPU seconds of the fastest of three."""
    best, out = np.inf, None
    for _ in range(_REPEATS):
        began = time.process_time()
        out = call()
        best = min(best, time.process_time() - began)
    assert out is not None
    return out, best


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
    building = timed(lambda: ceres_problem(p))[1]
    ceres, whole = timed(lambda: with_ceres(p))
    centers = np.array([center_of(b) for b in ceres.poses])
    s = ceres.summary
    line(name, len(p.camera), "pyceres", f"{off_mm(centers, truth):.3f}", f"{s.final_cost:.6f}",
         s.num_successful_steps + s.num_unsuccessful_steps,
         f"{whole:.2f} (building {building:.2f})")  # fmt: skip
    apart = np.linalg.norm(centers - ours.cameras.centers_world, axis=1).max()
    lens = max(np.abs(a - b.params).max() for a, b in zip(ceres.lenses, ours.cameras, strict=True))
    line(name, "", "difference", f"{apart * 1e3:.1g} mm at most", f"lens parameters {lens:.1g} at most", "", "")
    return ours, ceres


def alone(p: AdjustProblem, truth: CameraGroup) -> None:
    """pycolmap's adjuster on the part of the problem that its options express."""
    (rec, summary), took = timed(lambda: with_pycolmap(p))
    centers = np.array([rec.images[c + 1].projection_center() for c in range(len(p.cameras))])
    s = summary.ceres_summary
    line("points", len(p.camera), "pycolmap", f"{off_mm(centers, truth):.3f}", "another",
         s.num_successful_steps + s.num_unsuccessful_steps,
         f"{took:.2f}")  # fmt: skip


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
         f"{whole:.2f}")  # fmt: skip
    apart = 1e3 * np.linalg.norm(a - b, axis=1).max()
    line("bones", "", "difference", f"{apart:.1g} mm at most", "", "", "")


def covariances(name: str, ours: AdjustResult, ceres: InCeres) -> None:
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
    line(name, "difference", f"{np.abs(a / b - 1).max():.1g} of each at most", "", "")


def without_gauge(p: AdjustProblem) -> None:
    """Covariances where no camera is held: the world may move, turn and grow as a whole."""
    p = replace(p, free=tuple(replace(f, pose=True) for f in p.free))
    ours, took = timed(lambda: adjust(p))
    line("points, none held", "ours", f"{1e3 * (ours.position_std / ours.noise).mean():.4f}", "",
         f"{took:.2f} with the adjustment")  # fmt: skip
    ceres = with_ceres(p)
    blocks = [(b, b) for b in ceres.poses]
    for kind in (pyceres.CovarianceAlgorithmType.SPARSE_QR, pyceres.CovarianceAlgorithmType.DENSE_SVD):
        options = pyceres.CovarianceOptions()
        options.algorithm_type = kind
        options.null_space_rank = -1 if kind == pyceres.CovarianceAlgorithmType.DENSE_SVD else 0
        began = time.process_time()
        found = pyceres.Covariance(options).compute(blocks, ceres.problem)
        took = time.process_time() - began
        outcome = "found" if found else "none: the Jacobian's rank is too small"
        line("points, none held", f"pyceres, {kind.name}", outcome, "", f"{took:.2f}")


def main() -> None:
    """Print the tables."""
    versions = f"pycolmap {pycolmap.__version__}, Ceres {pycolmap.__ceres_version__}, Python {sys.version.split()[0]}"
    print(versions + "\n")
    line("problem", "observations", "by", "RMS error of the cameras, mm", "cost at the end", "iterations", "CPU s")
    line(*["---"] * 7)
    of_points, of_boards = points_problem(), boards_problem()
    first = compare("points", *of_points)
    alone(*of_points)
    second = compare("boards", *of_boards)
    bones()
    print()
    line("covariances", "by", "mean standard deviation of places, mm", "of focal lengths, px", "CPU s")
    line(*["---"] * 5)
    covariances("points", *first)
    covariances("boards", *second)
    without_gauge(of_points[0])
    print(f"\nResidual of a point behind its camera in pycolmap's cost function: {error_behind()}")


if __name__ == "__main__":
    main()
