"""Bundle adjustment of cameras, points and rigid boards, with what is known of their uncertainty.

One robust Levenberg-Marquardt over everything that is free: per camera the focal lengths, principal point,
distortion and pose; world points; and bodies, rigid sets of known points (a calibration board) with a pose per
frame. Every observation touches one camera and one point or body, so those are eliminated (Schur complement;
Triggs et al., "Bundle adjustment, a modern synthesis", 2000), and the reduced system's inverse gives the standard
deviations. Each camera's parameter kinds can be held alone and each observation has its own standard deviation,
which pycolmap 4.2's adjuster cannot express; neither can it hold a board's shape while cameras and boards move.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.calibration.bundle_adjustment.lens_jacobians import parameter_kinds, project_terms, term_map
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3

_GIVEN_DEGREES = 4.0


@dataclass(frozen=True)
class FreeCamera:
    """What of a camera is adjusted."""

    focal: bool = False
    principal: bool = False
    distortion: bool = False
    pose: bool = True


@dataclass(frozen=True)
class LensPrior:
    """What is known of a lens beforehand: a Gaussian over its parameters.

    Attributes:
        mean: (D,) the model's parameters.
        information: (D, D) inverse covariance; zero where nothing is known.
    """

    mean: FloatArray
    information: FloatArray


@dataclass(frozen=True)
class AdjustProblem:
    """What is adjusted, and where it starts.

    Attributes:
        cameras: the start, C cameras.
        camera: (N,) camera of each observation.
        point: (N,) its point, a row of `points`.
        pixels: (N, 2) px.
        sigma_px: (N,) its standard deviation, px.
        points: (P, 3) metres, in world axes, or in a body's axes where observed on a body.
        points_free: (P,) whether a world point is adjusted; a body's points are held.
        body: (N,) the body that the point is on, -1 for the world; None if all are.
        bodies: (B, 3, 4) world_from_body.
        free: one for each camera.
        loss_sigma: error, in standard deviations, where the Cauchy loss starts to bend; inf for least squares.
        max_iterations: at most.
        priors: one for each camera, None where a lens is left to the observations; empty for none at all.
        sway: (C, B, 6, R) how a body may have moved (rotation, then shift of its origin, world axes) between a
            camera's exposure and the time of `bodies`: R independent movements of one standard deviation each.
            None where all cameras expose at once.
        sway_mean: (C, B, R) how many standard deviations of each movement to expect; None for zero.
    """

    cameras: CameraGroup
    camera: IntArray
    point: IntArray
    pixels: FloatArray
    sigma_px: FloatArray
    points: FloatArray
    points_free: BoolArray
    free: tuple[FreeCamera, ...]
    body: IntArray | None = None
    bodies: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 4)))
    loss_sigma: float = 3.0
    max_iterations: int = 50
    priors: tuple[LensPrior | None, ...] = ()
    sway: FloatArray | None = None
    sway_mean: FloatArray | None = None

    def __post_init__(self) -> None:
        count = len(self.camera)
        body = np.full(count, -1) if self.body is None else np.asarray(self.body)
        object.__setattr__(self, "body", body)
        if not (len(self.point) == len(self.pixels) == len(self.sigma_px) == len(body) == count):
            raise ValueError("camera, point, pixels, sigma_px and body must have one row for each observation")
        if len(self.free) != len(self.cameras) or len(self.points_free) != len(self.points):
            raise ValueError("free must have one entry for each camera, points_free one for each point")
        if np.any(np.asarray(self.points_free)[self.point[body >= 0]]):
            raise ValueError("points on a body cannot be free")
        if len(self.priors) not in (0, len(self.cameras)):
            raise ValueError("priors must be empty or have one entry for each camera")
        if self.sway is not None and self.sway.shape[:3] != (len(self.cameras), len(self.bodies), 6):
            raise ValueError(f"sway must be ({len(self.cameras)}, {len(self.bodies)}, 6, R), not {self.sway.shape}")


@dataclass(frozen=True)
class AdjustResult:
    """Adjusted cameras, points and bodies.

    Attributes:
        cameras: as adjusted.
        points: (P, 3).
        bodies: (B, 3, 4).
        residuals_px: (N, 2) projected minus observed; NaN behind a camera.
        weights: (N,) the robust weight each observation ended with, 1 for a full say.
        noise: observed size of the errors in given standard deviations; scales the figures below.
        focal_std: (C,) px, of the first focal length; 0 where it was held.
        position_std: (C,) metres, length of the standard deviations along the axes; relative to all cameras
            where nothing fixes the world.
        iterations: done.
        covariances: for each camera (D + 6, D + 6): lens parameters, rotation about the camera's axes, centre in
            world axes; zero where held.
        swayed: (C, B, R) the movements found, in their standard deviations; None without `sway`.
        swayed_variance: (C, B, R) what stayed unknown of them (1: nothing was seen).
    """

    cameras: CameraGroup
    points: FloatArray
    bodies: FloatArray
    residuals_px: FloatArray
    weights: FloatArray
    noise: float
    focal_std: FloatArray
    position_std: FloatArray
    iterations: int
    covariances: tuple[FloatArray, ...]
    swayed: FloatArray | None = None
    swayed_variance: FloatArray | None = None


@dataclass
class _State:
    params: list[FloatArray]
    rotations: FloatArray
    centers: FloatArray
    points: FloatArray
    bodies: FloatArray
    swayed: FloatArray


@dataclass(frozen=True)
class _Swayed:
    """What takes a step of a camera and its bodies back to the movements between exposures."""

    camera: int
    body: IntArray
    local: IntArray
    solved: FloatArray
    inner: FloatArray


class _Solver:
    def __init__(self, problem: AdjustProblem):
        self.problem = problem
        self.maps = [term_map(c.model) for c in problem.cameras]
        self.fisheye = ["FISHEYE" in c.model for c in problem.cameras]
        self.sizes = [m.shape[1] + 6 for m in self.maps]
        self.offsets = np.concatenate([[0], np.cumsum(self.sizes)])
        self.free = np.concatenate(
            [
                [getattr(f, kind) for kind in parameter_kinds(c.model)] + [f.pose] * 6
                for c, f in zip(problem.cameras, problem.free, strict=True)
            ]
        )
        assert problem.body is not None
        self.on_body = problem.body >= 0
        local = np.where(self.on_body, len(problem.points) + problem.body, problem.point)
        self.order = [np.nonzero(problem.camera == c)[0] for c in range(len(problem.cameras))]
        self.order = [rows[np.argsort(local[rows], kind="stable")] for rows in self.order]
        self.used, self.local = np.unique(local, return_inverse=True)
        self.is_body = self.used >= len(problem.points)
        none = np.zeros((len(problem.cameras), len(problem.bodies), 6, 0))
        self.sway = none if problem.sway is None else problem.sway
        mean = problem.sway_mean
        self.sway_mean = np.zeros((*self.sway.shape[:2], self.sway.shape[3])) if mean is None else mean
        known = [p is not None and any((f.focal, f.principal, f.distortion))
                 for p, f in zip(problem.priors, problem.free, strict=False)]  # fmt: skip
        self.priors = [(c, p) for c, p in enumerate(problem.priors) if p is not None and known[c]]

    def start(self) -> _State:
        cameras = self.problem.cameras
        return _State(
            [np.array(c.params) for c in cameras],
            np.stack([c.rotation for c in cameras]),
            cameras.centers_world.copy(),
            np.array(self.problem.points, dtype=float),
            np.array(self.problem.bodies, dtype=float),
            self.sway_mean.copy(),
        )

    def world(self, s: _State) -> tuple[FloatArray, FloatArray]:
        """(N, 3) observed points in world axes, and turned (not moved) by their body."""
        x = s.points[self.problem.point]
        turned = x.copy()
        assert self.problem.body is not None
        on, b = self.on_body, self.problem.body[self.on_body]
        turned[on] = np.einsum("nij,nj->ni", s.bodies[b, :, :3], x[on])
        world = turned.copy()
        world[on] += s.bodies[b, :, 3]
        if s.swayed.size:
            moved = np.einsum("cbdr,cbr->cbd", self.sway, s.swayed)[self.problem.camera[on], b]
            turned[on] = np.einsum("nij,nj->ni", exp_so3(moved[:, :3]), turned[on])
            world[on] = turned[on] + s.bodies[b, :, 3] + moved[:, 3:]
        return world, turned

    def evaluate(self, s: _State, jacobian: bool) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """(N, 2) errors in px, each camera's (n, 2, D) derivatives in `order`, (N, 2, 6) by point or body."""
        world, turned = self.world(s)
        error = np.empty((len(world), 2))
        by_camera: list[FloatArray] = []
        by_local = np.zeros((len(world), 2, 6))
        for c, rows in enumerate(self.order):
            rel = (world[rows] - s.centers[c]) @ s.rotations[c].T
            px, by_point, by_terms = project_terms(self.maps[c] @ s.params[c], self.fisheye[c], rel)
            error[rows] = px - self.problem.pixels[rows]
            if not jacobian:
                continue
            by_world = by_point @ s.rotations[c]
            turn = np.cross(rel[:, None], by_point)  # d/dw of exp(w) rel
            by_camera.append(np.concatenate([by_terms @ self.maps[c], turn, -by_world], axis=-1))
            on = self.on_body[rows, None, None]
            about = np.cross(turned[rows][:, None], by_world)
            by_local[rows, :, :3] = np.where(on, about, by_world)
            by_local[rows, :, 3:] = np.where(on, by_world, 0.0)
            held = ~self.on_body[rows] & ~np.asarray(self.problem.points_free)[self.problem.point[rows]]
            by_local[rows[held]] = 0.0
        return error, by_camera, by_local

    def weigh(self, error: FloatArray) -> tuple[float, FloatArray]:
        """Robust cost, and the weight of each observation."""
        r2 = ((error / self.problem.sigma_px[:, None]) ** 2).sum(axis=1)
        r2 = np.where(np.isfinite(r2), r2, 1e8)
        k2 = self.problem.loss_sigma**2
        if np.isinf(k2):
            return float(0.5 * r2.sum()), np.where(r2 < 1e8, 1.0, 0.0)
        return float(0.5 * k2 * np.log1p(r2 / k2).sum()), np.where(r2 < 1e8, 1 / (1 + r2 / k2), 0.0)

    def cost(self, s: _State) -> float:
        """What is made small: robust errors, movements between exposures, what is known of the lenses."""
        known = sum(d @ p.information @ d for c, p in self.priors for d in [s.params[c] - p.mean])
        return self.weigh(self.evaluate(s, False)[0])[0] + 0.5 * float(((s.swayed - self.sway_mean) ** 2).sum() + known)

    def normal(self, s: _State) -> tuple[tuple[FloatArray, ...], list[_Swayed]]:
        """The normal equations, the movements between exposures eliminated, and what takes a step back to them."""
        error, by_camera, by_local = self.evaluate(s, True)
        root = np.sqrt(self.weigh(error)[1]) / self.problem.sigma_px
        good = root > 0
        r = np.where(good[:, None], error, 0.0) * root[:, None]
        jl = np.where(good[:, None, None], by_local, 0.0) * root[:, None, None]
        count, total = len(self.used), self.offsets[-1]
        hcc, bc = np.zeros((total, total)), np.zeros(total)
        hlc, hll, bl = np.zeros((count, 6, total)), np.zeros((count, 6, 6)), np.zeros((count, 6))
        back: list[_Swayed] = []
        for c, rows in enumerate(self.order):
            if not len(rows):
                continue
            at = slice(self.offsets[c], self.offsets[c + 1])
            jc = np.where(good[rows, None, None], by_camera[c], 0.0) * root[rows, None, None]
            flat = jc.reshape(-1, jc.shape[-1])
            hcc[at, at] = flat.T @ flat
            bc[at] = flat.T @ r[rows].ravel()
            index = self.local[rows]
            first = np.nonzero(np.r_[True, np.diff(index) != 0])[0]
            jt = np.swapaxes(jl[rows], 1, 2)
            hlc[index[first], :, at] = np.add.reduceat(jt @ jc, first)
            hll[index[first]] += np.add.reduceat(jt @ jl[rows], first)
            bl[index[first]] += np.add.reduceat((jt @ r[rows, :, None])[..., 0], first)
            if self.sway.size:
                back += self.eliminate(s, c, rows, (jc, jl[rows], r[rows]), (hcc, bc, hlc, hll, bl))
        for c, prior in self.priors:
            at = slice(self.offsets[c], self.offsets[c] + len(prior.mean))
            hcc[at, at] += prior.information
            bc[at] += prior.information @ (s.params[c] - prior.mean)
        hcc, bc, hlc = hcc[np.ix_(self.free, self.free)], bc[self.free], hlc[:, :, self.free]
        return (hcc, bc, hlc, hll, bl), back

    def eliminate(
        self,
        s: _State,
        c: int,
        rows: IntArray,
        by: tuple[FloatArray, FloatArray, FloatArray],
        normal: tuple[FloatArray, ...],
    ) -> list[_Swayed]:
        """Take a camera's movements between exposures out of the normal equations (changed in place)."""
        jc, jl, r = by
        hcc, bc, hlc, hll, bl = normal
        at, d = slice(self.offsets[c], self.offsets[c + 1]), jc.shape[-1]
        index = self.local[rows]
        first = np.nonzero(np.r_[True, np.diff(index) != 0])[0]
        views = np.nonzero(self.is_body[index[first]])[0]
        if not len(views):
            return []
        local = index[first][views]
        body = self.used[local] - len(s.points)
        way = np.zeros((len(first), 6, self.sway.shape[3]))
        way[views] = self.sway[c, body]
        ut = np.swapaxes(jl @ way[np.repeat(np.arange(len(first)), np.diff([*first, len(rows)]))], 1, 2)
        uj = np.add.reduceat(ut @ np.concatenate([jc, jl, r[..., None]], axis=-1), first)[views]
        uj[..., -1] += (s.swayed - self.sway_mean)[c, body]
        inner = np.add.reduceat(ut @ np.swapaxes(ut, 1, 2), first)[views] + np.eye(way.shape[2])
        k = np.linalg.solve(inner, uj).astype(np.float64)
        ct, lt = np.swapaxes(uj[..., :d], 1, 2), np.swapaxes(uj[..., d:-1], 1, 2)
        hcc[at, at] -= (ct @ k[..., :d]).sum(axis=0)
        bc[at] -= (ct @ k[..., -1:]).sum(axis=0)[:, 0]
        hlc[local, :, at] -= lt @ k[..., :d]
        hll[local] -= lt @ k[..., d:-1]
        bl[local] -= (lt @ k[..., -1:])[..., 0]
        return [_Swayed(c, body, local, k, inner)]

    @staticmethod
    def reduce(normal: tuple[FloatArray, ...], damping: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Reduced system and right side, and (L, 6, G + 1) what takes a camera step back to points and bodies."""
        hcc, bc, hlc, hll, bl = normal
        diagonal = np.einsum("lii->li", hll)
        damped = hll.copy()
        np.einsum("lii->li", damped)[...] += damping * diagonal + np.where(diagonal > 0, 1e-12 * diagonal, 1.0)
        solved = np.linalg.solve(damped, np.concatenate([hlc, bl[..., None]], axis=-1))
        size = len(bc)
        flat = hlc.reshape(6 * len(hll), size).T @ solved.reshape(6 * len(hll), size + 1)
        return hcc - flat[:, :-1], bc - flat[:, -1], solved

    def stepped(self, s: _State, normal: tuple[FloatArray, ...], back: list[_Swayed], damping: float) -> _State:
        reduced, right, solved = self.reduce(normal, damping)
        full = np.zeros(self.offsets[-1])
        step = np.zeros(len(right))
        if len(right):
            diagonal = np.diag(normal[0])
            step[:] = -np.linalg.solve(reduced + np.diag(damping * diagonal + 1e-12 * diagonal + 1e-30), right)
            full[self.free] = step
        local = -(solved[..., -1] + solved[..., :-1] @ step)
        kept = (s.rotations, s.centers, s.points, s.bodies, s.swayed)
        out = _State(list(s.params), *(a.copy() for a in kept))
        for v in back:
            at = slice(self.offsets[v.camera], self.offsets[v.camera + 1])
            d = self.sizes[v.camera]
            moved = np.einsum("vrk,vk->vr", v.solved[..., d:-1], local[v.local])
            out.swayed[v.camera, v.body] -= v.solved[..., :d] @ full[at] + moved + v.solved[..., -1]
        for c in range(len(s.params)):
            of = full[self.offsets[c] : self.offsets[c + 1]]
            out.params[c] = s.params[c] + of[:-6]
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

    def covariance(self, s: _State) -> FloatArray:
        """(total, total) of all camera parameters, zero where held; what is free as a whole is taken out."""
        out = np.zeros((self.offsets[-1],) * 2)
        if not self.free.any():
            return out
        reduced = self.reduce(self.normal(s)[0], 1e-10)[0]
        root = np.sqrt(np.maximum(np.diag(reduced), 1e-30))
        scaled = reduced / root / root[:, None]
        modes = self.gauge(s)[self.free] * root[:, None]
        moving = np.linalg.norm(modes, axis=0) > 0
        modes /= np.maximum(np.linalg.norm(modes, axis=0), 1e-30)
        loose = moving & (np.einsum("gk,gh,hk->k", modes, scaled, modes) < 1e-7)
        if loose.any():
            q, _ = np.linalg.qr(modes[:, loose])
            inverse = np.linalg.pinv(scaled + q @ q.T, hermitian=True) - q @ q.T
        else:
            inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True)
        inverse = inverse / root / root[:, None]
        if loose.any():  # seen relative to all cameras together, not to the scaled axes above
            g = self.gauge(s)[self.free][:, loose]
            away = np.eye(len(g)) - g @ np.linalg.pinv(g)
            inverse = away @ inverse @ away.T
        out[np.ix_(self.free, self.free)] = inverse
        return out

    def has_focal_lengths(self, s: _State) -> bool:
        """Whether every focal length, the second too, is one: pixels that fit no camera push them below zero."""
        models = [camera.model for camera in self.problem.cameras]
        return all(
            value > 0
            for model, params in zip(models, s.params, strict=True)
            for kind, value in zip(parameter_kinds(model), params, strict=True)
            if kind == "focal"
        )

    def gauge(self, s: _State) -> FloatArray:
        """(total, 7) how the cameras change if the world is moved, turned and scaled."""
        out = np.zeros((self.offsets[-1], 7))
        middle = s.centers.mean(axis=0)
        for c in range(len(s.params)):
            end = self.offsets[c + 1]
            for axis in range(3):
                out[end - 3 + axis, axis] = 1.0
                omega = np.eye(3)[axis]
                out[end - 6 : end - 3, 3 + axis] = -s.rotations[c] @ omega
                out[end - 3 : end, 3 + axis] = np.cross(omega, s.centers[c] - middle)
            out[end - 3 : end, 6] = s.centers[c] - middle
        return out


def adjust(problem: AdjustProblem) -> AdjustResult:
    """Adjust everything that is free so that the (robust) reprojection errors become smallest.

    Raises:
        ValueError: arrays that do not fit together, a lens model without derivatives (`ADJUSTABLE_MODELS`).
    """
    solver = _Solver(problem)
    state, damping, done = solver.start(), 1e-4, 0
    cost = solver.cost(state)
    while done < problem.max_iterations:
        done += 1
        normal, back = solver.normal(state)
        gain = 0.0
        while damping < 1e8:
            try:
                trial = solver.stepped(state, normal, back, damping)
                trial_cost = solver.cost(trial)
            except np.linalg.LinAlgError:
                trial_cost = np.inf
            if trial_cost <= cost and solver.has_focal_lengths(trial):
                gain, state, cost = (cost - trial_cost) / max(cost, 1e-30), trial, trial_cost
                damping = max(damping / 10, 1e-12)
                break
            damping *= 10
        if gain < 1e-9:
            break
    return _result(problem, solver, state, done)


def _result(problem: AdjustProblem, solver: _Solver, state: _State, done: int) -> AdjustResult:
    error = solver.evaluate(state, False)[0]
    weights = solver.weigh(error)[1]
    r2 = ((error / problem.sigma_px[:, None]) ** 2).sum(axis=1)
    loose = np.asarray(problem.points_free)[solver.used[~solver.is_body]].sum()
    degrees = 2 * weights.sum() - solver.free.sum() - 3 * loose - 6 * solver.is_body.sum()
    degrees += sum(np.linalg.matrix_rank(p.information) for _, p in solver.priors)
    # The given precision counts like a few observations, for problems with hardly more of them than unknowns.
    squares = np.nansum(weights * r2) + _GIVEN_DEGREES
    noise = float(np.sqrt(squares / (max(degrees, 0.0) + _GIVEN_DEGREES)))
    covariance = noise**2 * solver.covariance(state)
    variance = np.maximum(np.diag(covariance), 0.0)
    variance_of = np.ones_like(state.swayed)
    for v in solver.normal(state)[1]:
        variance_of[v.camera, v.body] = np.einsum("vrr->vr", np.linalg.inv(v.inner))
    cameras = []
    for c, camera in enumerate(problem.cameras):
        pose = np.column_stack([state.rotations[c], -state.rotations[c] @ state.centers[c]])
        cameras.append(replace(camera, params=tuple(state.params[c]), cam_from_world=_orthonormal(camera, pose)))
    ends = solver.offsets[1:]
    return AdjustResult(
        CameraGroup(tuple(cameras)), state.points, state.bodies, error, weights, noise,
        np.sqrt(variance[solver.offsets[:-1]]),
        np.sqrt(np.stack([variance[e - 3 : e].sum() for e in ends])), done,
        tuple(covariance[a:e, a:e] for a, e in zip(solver.offsets[:-1], ends, strict=True)),
        *((None, None) if problem.sway is None else (state.swayed, variance_of)),
    )  # fmt: skip


def _orthonormal(camera: Camera, pose: FloatArray) -> FloatArray:
    u, _, vt = np.linalg.svd(pose[:, :3])
    return np.column_stack([u @ vt, pose[:, 3]])
