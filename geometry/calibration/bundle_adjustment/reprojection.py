"""Reprojection errors of cameras, points and rigid boards, and the normal equations that they make.

Every observation touches one camera and one point or body, so points and bodies are the blocks that `solver`
eliminates. A point's block has three unknowns of six; the others stay put.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import parameter_kinds, project_terms, term_map
from muybridge.geometry.calibration.bundle_adjustment.problem import AdjustProblem, FreeCamera
from muybridge.geometry.calibration.bundle_adjustment.solver import (
    POSE_SIZE,
    NormalEquations,
    by_pose,
    cauchy,
    damped_step,
    gauge,
)
from muybridge.geometry.calibration.bundle_adjustment.sway import Swayed, eliminate
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.numerics.rotations import exp_so3

_BEHIND = 1e8  # squared error, in standard deviations, of a point behind its camera


@dataclass
class State:
    """The unknowns.

    Attributes:
        params: each camera's (D,) lens parameters.
        rotations: (C, 3, 3) cam_from_world.
        centers: (C, 3) metres.
        points: (P, 3), as in `AdjustProblem`.
        bodies: (B, 3, 4) world_from_body.
        swayed: (C, B, R) movements between exposures, in their standard deviations.
    """

    params: list[FloatArray]
    rotations: FloatArray
    centers: FloatArray
    points: FloatArray
    bodies: FloatArray
    swayed: FloatArray


@dataclass(frozen=True)
class Linearised:
    """Normal equations at a state, and what takes a step back to the movements that are eliminated from them."""

    equations: NormalEquations
    swayed: list[Swayed]


def _free_unknowns(camera: Camera, free: FreeCamera) -> list[bool]:
    return [getattr(free, kind) for kind in parameter_kinds(camera.model)] + [free.pose] * POSE_SIZE


class ReprojectionSystem:
    """An `AdjustProblem` with its unknowns in order.

    Attributes:
        problem: what is adjusted.
        offsets: (C + 1,) where each camera's unknowns (lens, rotation, centre) begin.
        free: (offsets[-1],) which of them are free.
        used: (L,) the points and, numbered after them, the bodies that are observed.
        is_body: (L,) which of these are bodies.
        priors: (camera, prior) of the lenses that have one and something to adjust.
    """

    def __init__(self, problem: AdjustProblem):
        self.problem = problem
        cameras = list(zip(problem.cameras, problem.free, strict=True))
        self._maps = [term_map(c.model) for c in problem.cameras]
        self._fisheye = ["FISHEYE" in c.model for c in problem.cameras]
        self.offsets = np.concatenate([[0], np.cumsum([m.shape[1] + POSE_SIZE for m in self._maps])])
        self.free = np.concatenate([_free_unknowns(c, f) for c, f in cameras])
        assert problem.body is not None
        self._on_body = problem.body >= 0
        self._held = ~self._on_body & ~np.asarray(problem.points_free)[problem.point]
        local = np.where(self._on_body, len(problem.points) + problem.body, problem.point)
        order = [np.nonzero(problem.camera == c)[0] for c in range(len(problem.cameras))]
        self._order = [rows[np.argsort(local[rows], kind="stable")] for rows in order]
        self.used, self._local = np.unique(local, return_inverse=True)
        self.is_body = self.used >= len(problem.points)
        none = np.zeros((len(problem.cameras), len(problem.bodies), 6, 0))
        self._sway = none if problem.sway is None else problem.sway
        mean = problem.sway_mean
        self._sway_mean = np.zeros((*self._sway.shape[:2], self._sway.shape[3])) if mean is None else mean
        known = [p is not None and any((f.focal, f.principal, f.distortion))
                 for p, f in zip(problem.priors, problem.free, strict=False)]  # fmt: skip
        self.priors = [(c, p) for c, p in enumerate(problem.priors) if p is not None and known[c]]

    def start(self) -> State:
        """Where the problem begins."""
        cameras = self.problem.cameras
        return State(
            [np.array(c.params) for c in cameras],
            np.stack([c.rotation for c in cameras]),
            cameras.centers_world.copy(),
            np.array(self.problem.points, dtype=float),
            np.array(self.problem.bodies, dtype=float),
            self._sway_mean.copy(),
        )

    def world(self, s: State) -> tuple[FloatArray, FloatArray]:
        """(N, 3) observed points in world axes, and turned (not moved) by their body."""
        x = s.points[self.problem.point]
        turned = x.copy()
        assert self.problem.body is not None
        on, b = self._on_body, self.problem.body[self._on_body]
        turned[on] = np.einsum("nij,nj->ni", s.bodies[b, :, :3], x[on])
        world = turned.copy()
        world[on] += s.bodies[b, :, 3]
        if s.swayed.size:
            moved = np.einsum("cbdr,cbr->cbd", self._sway, s.swayed)[self.problem.camera[on], b]
            turned[on] = np.einsum("nij,nj->ni", exp_so3(moved[:, :3]), turned[on])
            world[on] = turned[on] + s.bodies[b, :, 3] + moved[:, 3:]
        return world, turned

    def evaluate(self, s: State, jacobian: bool) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """(N, 2) errors in px, each camera's (n, 2, D) derivatives in order of points, (N, 2, 6) by point or body."""
        world, turned = self.world(s)
        error = np.empty((len(world), 2))
        by_camera: list[FloatArray] = []
        by_local = np.zeros((len(world), 2, 6))
        for c, rows in enumerate(self._order):
            rel = (world[rows] - s.centers[c]) @ s.rotations[c].T
            px, by_point, by_terms = project_terms(self._maps[c] @ s.params[c], self._fisheye[c], rel)
            error[rows] = px - self.problem.pixels[rows]
            if not jacobian:
                continue
            pose, by_world = by_pose(rel, s.rotations[c], by_point)
            by_camera.append(np.concatenate([by_terms @ self._maps[c], pose], axis=-1))
            on = self._on_body[rows, None, None]
            by_local[rows, :, :3] = np.where(on, np.cross(turned[rows][:, None], by_world), by_world)
            by_local[rows, :, 3:] = np.where(on, by_world, 0.0)
        by_local[self._held] = 0.0
        return error, by_camera, by_local

    def weigh(self, error: FloatArray) -> tuple[float, FloatArray]:
        """Robust cost, and the weight of each observation."""
        return cauchy(((error / self.problem.sigma_px[:, None]) ** 2).sum(axis=1), self.problem.loss_sigma, _BEHIND)

    def cost(self, s: State) -> float:
        """What is minimised: robust errors, movements between exposures, what is known of the lenses.

        Infinite for a focal length, first or second, that is not above zero: pixels that fit no camera push it there.
        """
        kinds = [parameter_kinds(c.model) for c in self.problem.cameras]
        if any(v <= 0 for k, p in zip(kinds, s.params, strict=True) for kind, v in zip(k, p, strict=True)
               if kind == "focal"):  # fmt: skip
            return np.inf
        known = sum(d @ p.information @ d for c, p in self.priors for d in [s.params[c] - p.mean])
        errors = self.weigh(self.evaluate(s, False)[0])[0]
        return errors + 0.5 * float(((s.swayed - self._sway_mean) ** 2).sum() + known)

    def linearised(self, s: State) -> Linearised:
        """The normal equations of what is free, the movements between exposures eliminated."""
        error, by_camera, by_local = self.evaluate(s, True)
        root = np.sqrt(self.weigh(error)[1]) / self.problem.sigma_px
        good = root > 0
        r = np.where(good[:, None], error, 0.0) * root[:, None]
        jl = np.where(good[:, None, None], by_local, 0.0) * root[:, None, None]
        out = NormalEquations.zeros(int(self.offsets[-1]), len(self.used), 6)
        back: list[Swayed] = []
        for c, rows in enumerate(self._order):
            if not len(rows):
                continue
            at = slice(self.offsets[c], self.offsets[c + 1])
            jc = np.where(good[rows, None, None], by_camera[c], 0.0) * root[rows, None, None]
            flat = jc.reshape(-1, jc.shape[-1])
            out.shared[at, at] = flat.T @ flat
            out.shared_gradient[at] = flat.T @ r[rows].ravel()
            index = self._local[rows]
            first = np.nonzero(np.r_[True, np.diff(index) != 0])[0]
            jt = np.swapaxes(jl[rows], 1, 2)
            out.cross[index[first], :, at] = np.add.reduceat(jt @ jc, first)
            out.blocks[index[first]] += np.add.reduceat(jt @ jl[rows], first)
            out.block_gradient[index[first]] += np.add.reduceat((jt @ r[rows, :, None])[..., 0], first)
            if self._sway.size:
                bodies = np.where(self.is_body, self.used - len(s.points), -1)[index[first]]
                views = (index[first], bodies, first)
                off = (s.swayed - self._sway_mean)[c]
                back += eliminate(c, at, views, (jc, jl[rows], r[rows]), self._sway[c], off, out)
        for c, prior in self.priors:
            at = slice(self.offsets[c], self.offsets[c] + len(prior.mean))
            out.shared[at, at] += prior.information
            out.shared_gradient[at] += prior.information @ (s.params[c] - prior.mean)
        return Linearised(out.restricted(self.free), back)

    def stepped(self, s: State, at: Linearised, damping: float) -> State:
        """The state one damped step on."""
        step, local = damped_step(at.equations, damping)
        full = np.zeros(self.offsets[-1])
        full[self.free] = step
        kept = (s.rotations, s.centers, s.points, s.bodies, s.swayed)
        out = State(list(s.params), *(a.copy() for a in kept))
        for v in at.swayed:
            out.swayed[v.camera, v.body] -= v.step(full, local)
        for c in range(len(s.params)):
            of = full[self.offsets[c] : self.offsets[c + 1]]
            out.params[c] = s.params[c] + of[:-POSE_SIZE]
            if self.problem.free[c].pose:
                out.rotations[c] = exp_so3(of[-6:-3]) @ s.rotations[c]
                out.centers[c] = s.centers[c] + of[-3:]
        out.points[self.used[~self.is_body]] += local[~self.is_body, :3]
        bodies = self.used[self.is_body] - len(s.points)
        if len(bodies):
            moved = local[self.is_body]
            out.bodies[bodies, :, :3] = exp_so3(moved[:, :3]) @ s.bodies[bodies, :, :3]
            out.bodies[bodies, :, 3] += moved[:, 3:]
        return out

    def gauge(self, s: State) -> FloatArray:
        """(free unknowns, 7) how the cameras change if the world is moved, turned and scaled."""
        out = np.zeros((self.offsets[-1], 7))
        for end, modes in zip(self.offsets[1:], gauge(s.rotations, s.centers), strict=True):
            out[end - POSE_SIZE : end] = modes
        free: FloatArray = out[self.free]
        return free
