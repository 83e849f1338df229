"""Reprojection errors of landmarks over time, and bones that keep their lengths, as normal equations.

Unknown are the cameras' poses (and, where wanted, a factor on each focal length), every landmark in every frame, and
one length for each bone. Landmarks of one frame are coupled by the bones and no two frames are, so a frame is a block
that `solver` eliminates; cameras and lengths are the shared unknowns. Residuals are in standard deviations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.calibration.bundle_adjustment.solver import (
    POSE_SIZE,
    NormalEquations,
    by_pose,
    cauchy,
    damped_step,
)
from muybridge.geometry.numerics.rotations import exp_so3, log_so3

_MIN_DEPTH = 1e-3
_BEHIND = 1e6  # squared error, in standard deviations, of a point behind its camera: that of the whole image
BLOCK_RIDGE = 1e-9
"""Keeps a landmark that is hardly seen in its place."""
PER_CAMERA = POSE_SIZE + 1
"""Unknowns of a camera: its pose and the logarithm of the factor on its focal length."""


@dataclass(frozen=True)
class ArticulatedProblem:
    """What was seen, and how sure it is.

    Attributes:
        seen: (C, T, K, 2) undistorted normalised image coordinates; anything where `sigma_px` is not finite.
        focal_px: (C,) px per unit of `seen`.
        sigma_px: (C, T, K) standard deviation of each coordinate; NaN where nothing was seen.
        bones: (B, 2) indices into K.
        bone_sigma: (B,) in the unit of the start: how constant a length is in time.
        focal_sigma: standard deviation of the logarithm of a focal length about `focal_px`; 0 to hold it.
        pose_sigma: standard deviations of rotation (rad) and centre (m) about the start; None for no prior.
        prior_worth: how many frames count as one: errors are alike in neighbouring frames, so priors are weighed
            as if they had been seen in so many.
        loss_sigma: where Cauchy's loss bends, in standard deviations.
    """

    seen: FloatArray
    focal_px: FloatArray
    sigma_px: FloatArray
    bones: IndexArray
    bone_sigma: FloatArray
    focal_sigma: float = 0.0
    pose_sigma: tuple[float, float] | None = None
    prior_worth: float = 1.0
    loss_sigma: float = 2.0


@dataclass(frozen=True)
class ArticulatedState:
    """The unknowns.

    Attributes:
        rotations: (C, 3, 3) camera from world.
        centers: (C, 3).
        log_focal: (C,) logarithm of the factor on `focal_px`.
        points: (T, K, 3); NaN where unknown.
        lengths: (B,).
    """

    rotations: FloatArray
    centers: FloatArray
    log_focal: FloatArray
    points: FloatArray
    lengths: FloatArray


@dataclass(frozen=True)
class ArticulatedEquations:
    """Normal equations at a state, and the weighted terms of the reprojection that they are made of.

    Attributes:
        normal: blocks are frames of 3 K unknowns; shared are `PER_CAMERA` C unknowns of cameras and B logarithms of
            lengths.
        by_point: (C, T, K, 2, 3) derivatives of the weighted errors by the landmark; zero where not seen.
        by_camera: (C, T, K, 2, PER_CAMERA) the same by the camera's unknowns.
        error: (C, T, K, 2) the weighted errors, in standard deviations.
    """

    normal: NormalEquations
    by_point: FloatArray
    by_camera: FloatArray
    error: FloatArray


class ArticulatedSystem:
    """An `ArticulatedProblem` and its start.

    Attributes:
        problem: what was seen, without the landmarks that take no part.
        known: (T, K) landmarks that take part: a start is known, and two cameras or more see them.
        begin: the start; zeros for landmarks that take no part.
        prior_precision: (PER_CAMERA,) one over the standard deviations of the priors on a camera.
    """

    def __init__(self, problem: ArticulatedProblem, start: ArticulatedState):
        shared = np.isfinite(problem.sigma_px).sum(axis=0) >= 2
        self.known = np.isfinite(start.points).all(axis=-1) & shared
        self.problem = replace(problem, sigma_px=np.where(self.known[None], problem.sigma_px, np.nan))
        self._stiffness = start.lengths / problem.bone_sigma
        self.begin = replace(
            start,
            lengths=np.where(start.lengths > 0, start.lengths, 1.0),
            points=np.where(self.known[..., None], start.points, 0.0),
        )
        self.prior_precision = np.zeros(PER_CAMERA)
        if problem.pose_sigma is not None:
            self.prior_precision[:3] = 1 / problem.pose_sigma[0]
            self.prior_precision[3:6] = 1 / problem.pose_sigma[1]
        if problem.focal_sigma > 0:
            self.prior_precision[6] = 1 / problem.focal_sigma
        self.prior_precision *= np.sqrt(problem.prior_worth)

    def reprojection(self, state: ArticulatedState) -> tuple[FloatArray, FloatArray]:
        """(C, T, K, 2) error in px, NaN where not seen or behind the camera; (C, T, K, 3) points in camera axes."""
        problem = self.problem
        y = np.einsum("cij,ctkj->ctki", state.rotations, state.points[None] - state.centers[:, None, None])
        z = np.where(y[..., 2:] > _MIN_DEPTH, y[..., 2:], np.nan)
        scale = np.exp(state.log_focal)[:, None, None, None]
        error = problem.focal_px[:, None, None, None] * (scale * y[..., :2] / z - problem.seen)
        return np.where(np.isfinite(problem.sigma_px)[..., None], error, np.nan), y

    def _weighed(self, error: FloatArray, seen: BoolArray) -> tuple[float, FloatArray]:
        """Robust cost of the errors of landmarks that were seen, and their weights."""
        square = ((error[seen] / self.problem.sigma_px[seen][:, None]) ** 2).sum(axis=-1)
        return cauchy(square, self.problem.loss_sigma, _BEHIND)

    def _bones(self, state: ArticulatedState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(T, B) residuals in sigmas, (T, B, 3) derivative by the first end, (T, B) whether both ends are known.

        Lengths are compared as logarithms, so that the whole cannot gain by shrinking.
        """
        first, second = self.problem.bones[:, 0], self.problem.bones[:, 1]
        vector = state.points[:, first] - state.points[:, second]
        length = np.linalg.norm(vector, axis=-1)
        both = (self.known[:, first] & self.known[:, second] & (length > 1e-9)).astype(np.float64)
        length = np.where(both > 0, length, 1.0)
        residual = self._stiffness * np.log(length / state.lengths) * both
        return residual, (self._stiffness * both / length**2)[..., None] * vector, both

    def _prior(self, state: ArticulatedState) -> FloatArray:
        """(C, PER_CAMERA) residuals of the priors on the cameras."""
        turned = log_so3(state.rotations @ np.swapaxes(self.begin.rotations, 1, 2))
        off = np.concatenate([turned, state.centers - self.begin.centers, state.log_focal[:, None]], axis=1)
        return np.asarray(off * self.prior_precision)

    def cost(self, state: ArticulatedState) -> float:
        """What is minimised; infinite with everything behind the cameras."""
        error, y = self.reprojection(state)
        seen = np.isfinite(self.problem.sigma_px)
        if (y[..., 2][seen] <= _MIN_DEPTH).all():
            return np.inf
        bones = cauchy(self._bones(state)[0] ** 2, self.problem.loss_sigma)[0]
        return self._weighed(error, seen)[0] + bones + 0.5 * float((self._prior(state) ** 2).sum())

    def linearised(self, state: ArticulatedState) -> ArticulatedEquations:
        """Normal equations at a state, losses turned into weights."""
        cameras, frames, count = self.problem.sigma_px.shape
        jx, jg, residual = self._derivatives(state)
        out = NormalEquations.zeros(PER_CAMERA * cameras + len(self.problem.bones), frames, 3 * count)
        index, cut = np.arange(count), PER_CAMERA * cameras
        blocks = out.blocks.reshape(frames, count, 3, count, 3)
        blocks[:, index, :, index, :] = np.moveaxis(np.einsum("ctkra,ctkrb->tkab", jx, jx), 1, 0)
        cross = np.einsum("ctkra,ctkrg->tkacg", jx, jg)
        out.cross[..., :cut] = cross.reshape(frames, 3 * count, cut)
        out.block_gradient[:] = np.einsum("ctkra,ctkr->tka", jx, residual).reshape(frames, -1)
        own = np.einsum("ctkra,ctkrb->cab", jg, jg)
        for c in range(cameras):
            at = slice(PER_CAMERA * c, PER_CAMERA * (c + 1))
            out.shared[at, at] = own[c] + np.diag(self.prior_precision**2)
        gradient = np.einsum("ctkra,ctkr->ca", jg, residual) + self._prior(state) * self.prior_precision
        out.shared_gradient[:cut] = gradient.ravel()
        self._add_bones(state, out)
        return ArticulatedEquations(out, jx, jg, residual)

    def _derivatives(self, state: ArticulatedState) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Of the weighted reprojection errors by points and by cameras, and the errors; zero where not seen."""
        problem = self.problem
        error, y = self.reprojection(state)
        good = np.asarray(np.isfinite(error).all(axis=-1))
        weight = np.zeros(good.shape)
        weight[good] = np.sqrt(self._weighed(error, good)[1]) / problem.sigma_px[good]
        z = np.where(good, y[..., 2], 1.0)
        focal = problem.focal_px * np.exp(state.log_focal)
        gain = weight * focal[:, None, None] / z
        px, py = y[..., 0] / z, y[..., 1] / z
        by_y = np.zeros((*good.shape, 2, 3))
        by_y[..., 0, 0] = by_y[..., 1, 1] = gain
        by_y[..., 0, 2], by_y[..., 1, 2] = -gain * px, -gain * py
        jx, jg = np.empty_like(by_y), np.empty((*good.shape, 2, PER_CAMERA))
        for c, rotation in enumerate(state.rotations):
            jg[c, ..., :POSE_SIZE], jx[c] = by_pose(y[c], rotation, by_y[c])
        free = 1.0 if problem.focal_sigma > 0 else 0.0
        jg[..., 6] = free * (weight * focal[:, None, None])[..., None] * np.stack([px, py], axis=-1)
        jg[~good] = 0.0
        return jx, jg, np.where(good[..., None], error, 0.0) * weight[..., None]

    def _add_bones(self, state: ArticulatedState, equations: NormalEquations) -> None:
        """Add the bones' terms to the normal equations, in place."""
        residual, slope, both = self._bones(state)
        weight = both * cauchy(residual**2, self.problem.loss_sigma)[1]
        pull = weight * residual
        frames, count = self.known.shape
        blocks = equations.blocks.reshape(frames, count, 3, count, 3)
        cross = equations.cross.reshape(frames, count, 3, -1)
        gradient = equations.block_gradient.reshape(frames, count, 3)
        offset = len(equations.shared) - len(self.problem.bones)
        for b, (i, j) in enumerate(self.problem.bones):
            u, w, k, at = slope[:, b], weight[:, b], self._stiffness[b], offset + b
            block = w[:, None, None] * u[:, :, None] * u[:, None, :]
            for first, second, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                blocks[:, first, :, second, :] += sign * block
            for end, sign in ((i, 1), (j, -1)):
                cross[:, end, :, at] -= sign * k * w[:, None] * u
                gradient[:, end] += sign * pull[:, b, None] * u
            equations.shared[at, at] += k * k * w.sum()
            equations.shared_gradient[at] -= k * pull[:, b].sum()

    def stepped(self, state: ArticulatedState, at: ArticulatedEquations, damping: float) -> ArticulatedState:
        """The state one damped step on."""
        shared, blocks = damped_step(at.normal, damping, BLOCK_RIDGE)
        cut = PER_CAMERA * len(state.centers)
        of_camera = shared[:cut].reshape(-1, PER_CAMERA)
        return ArticulatedState(
            rotations=exp_so3(of_camera[:, :3]) @ state.rotations,
            centers=state.centers + of_camera[:, 3:6],
            log_focal=state.log_focal + (of_camera[:, 6] if self.problem.focal_sigma > 0 else 0.0),
            points=state.points + np.where(self.known[..., None], blocks.reshape(state.points.shape), 0.0),
            lengths=state.lengths * np.exp(shared[cut:]),
        )
