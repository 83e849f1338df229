"""Movements of a body between the exposures of the cameras, taken out of the normal equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.geometry.calibration.bundle_adjustment.solver import NormalEquations


@dataclass(frozen=True)
class Swayed:
    """What takes a step of a camera and its bodies back to the movements between exposures.

    Attributes:
        camera: which.
        unknowns: of the camera, among all cameras'.
        body: (V,) the bodies that it sees.
        local: (V,) their blocks in the normal equations.
        solved: (V, R, D + 7) the movements' own equations solved for camera, body and gradient.
        inner: (V, R, R) these equations.
    """

    camera: int
    unknowns: slice
    body: IntArray
    local: IntArray
    solved: FloatArray
    inner: FloatArray

    def step(self, of_cameras: FloatArray, of_blocks: FloatArray) -> FloatArray:
        """(V, R) what is subtracted from the movements after a step of the cameras (all unknowns) and blocks."""
        mine = of_cameras[self.unknowns]
        moved = np.einsum("vrk,vk->vr", self.solved[..., len(mine) : -1], of_blocks[self.local])
        out: FloatArray = self.solved[..., : len(mine)] @ mine + moved + self.solved[..., -1]
        return out


def eliminate(
    camera: int,
    unknowns: slice,
    views: tuple[IntArray, IntArray, IntArray],
    terms: tuple[FloatArray, FloatArray, FloatArray],
    sway: FloatArray,
    off: FloatArray,
    equations: NormalEquations,
) -> list[Swayed]:
    """Take a camera's movements between exposures out of the normal equations (changed in place).

    Args:
        camera: which.
        unknowns: of the camera, among all cameras'.
        views: the camera's points and bodies as blocks of the equations, bodies (-1 for a point), and the first of the
            rows of each.
        terms: (n, 2, D) and (n, 2, 6) derivatives by camera and by body, (n, 2) residuals, weighted, in those rows.
        sway: (B, 6, R) of the camera, as in `AdjustProblem`.
        off: (B, R) the movements less what was expected of them.
        equations: of all.
    """
    jc, jl, r = terms
    locals_, bodies, first = views
    seen = np.nonzero(bodies >= 0)[0]
    if not len(seen):
        return []
    d = jc.shape[-1]
    local, body = locals_[seen], bodies[seen]
    way = np.zeros((len(first), 6, sway.shape[-1]))
    way[seen] = sway[body]
    ut = np.swapaxes(jl @ way[np.repeat(np.arange(len(first)), np.diff([*first, len(r)]))], 1, 2)
    uj = np.add.reduceat(ut @ np.concatenate([jc, jl, r[..., None]], axis=-1), first)[seen]
    uj[..., -1] += off[body]
    inner = np.add.reduceat(ut @ np.swapaxes(ut, 1, 2), first)[seen] + np.eye(way.shape[2])
    k = np.linalg.solve(inner, uj).astype(np.float64)
    ct, lt = np.swapaxes(uj[..., :d], 1, 2), np.swapaxes(uj[..., d:-1], 1, 2)
    equations.shared[unknowns, unknowns] -= (ct @ k[..., :d]).sum(axis=0)
    equations.shared_gradient[unknowns] -= (ct @ k[..., -1:]).sum(axis=0)[:, 0]
    equations.cross[local, :, unknowns] -= lt @ k[..., :d]
    equations.blocks[local] -= lt @ k[..., d:-1]
    equations.block_gradient[local] -= (lt @ k[..., -1:])[..., 0]
    return [Swayed(camera, unknowns, body, local, k, inner)]
