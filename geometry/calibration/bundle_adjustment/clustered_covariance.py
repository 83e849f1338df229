"""Covariance of cameras that were adjusted to people, by how the landmarks and the stretches of the take pull."""

from __future__ import annotations

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.bundle_adjustment.articulated import (
    BLOCK_RIDGE,
    PER_CAMERA,
    ArticulatedEquations,
    ArticulatedState,
    ArticulatedSystem,
)
from muybridge.geometry.calibration.bundle_adjustment.solver import POSE_SIZE, gauge, reduce


def clustered_covariance(
    system: ArticulatedSystem, state: ArticulatedState, equations: ArticulatedEquations
) -> FloatArray:
    """(7C, 7C) of rotation (rad), centre, log focal of each camera (a sandwich).

    A landmark that the 2D network places a little off does so in every frame, and neighbouring frames err
    alike, so errors are neither independent between frames nor between landmarks: their pulls on the cameras
    are summed by landmark and by stretch of time first, and squared then (two-way clustering; Cameron,
    Gelbach, Miller, "Robust inference with multiway clustering", 2011; without its subtracted term, which
    only makes it larger).

    Args:
        system: what was adjusted.
        state: as adjusted.
        equations: there.
    """
    size = PER_CAMERA * len(state.centers)
    reduced = reduce(equations.normal, BLOCK_RIDGE, BLOCK_RIDGE)
    matrix, gain = reduced.matrix, reduced.back[..., :-1]
    held = _unit_gauge(state, len(matrix))
    strength = np.trace(matrix) / len(matrix)
    matrix = matrix + strength * held @ held.T + 1e-12 * strength * np.eye(len(matrix))
    if system.problem.focal_sigma <= 0:
        at = np.arange(PER_CAMERA - 1, size, PER_CAMERA)
        matrix[at, at] += strength
    inverse = np.linalg.inv(matrix)
    total = _pulls(equations, gain, size)
    # What was given beforehand is off by its own standard deviation once, however many frames it is weighed as.
    weighed = np.tile(system.prior_precision, len(state.centers)) ** 2
    total[np.arange(size), np.arange(size)] += (system.problem.prior_worth - 1) * weighed
    bend = _bend(system.problem.loss_sigma, equations)
    spread = inverse @ total @ inverse / bend**2 + inverse / bend
    return np.asarray(spread[:size, :size])


def _pulls(equations: ArticulatedEquations, gain: FloatArray, size: int) -> FloatArray:
    """(G, G) sum of the squared pulls of landmarks and of stretches of time on the reduced system."""
    frames, count = equations.by_point.shape[1:3]
    by_point = np.einsum("ctkra,ctkr->tka", equations.by_point, equations.error)
    pull = -np.einsum("tka,tkag->tkg", by_point, gain.reshape(frames, count, 3, -1))
    pull[..., :size] += np.einsum("ctkra,ctkr->tkca", equations.by_camera, equations.error).reshape(frames, count, -1)
    stretches = np.array_split(np.arange(frames), min(10, frames))
    total = np.zeros((pull.shape[-1],) * 2)
    for groups in (pull.sum(axis=0), np.stack([pull[s].sum(axis=(0, 1)) for s in stretches])):
        if len(groups) > 1:
            centered = groups - groups.mean(axis=0)
            total += centered.T @ centered * len(groups) / (len(groups) - 1)
    return total


def _bend(loss_sigma: float, equations: ArticulatedEquations) -> float:
    """The loss' curvature over its weight, on average: weights alone pretend that outliers hold the cameras."""
    seen = np.abs(equations.by_point).sum(axis=(-1, -2)) > 0
    weighted = (equations.error**2).sum(axis=-1)[seen]  # w r^2 with w = 1 / (1 + r^2 / k^2)
    share = np.clip(weighted / loss_sigma**2, 0.0, 1 - 1e-9)  # r^2 / (k^2 + r^2)
    weight = 1 - share
    radial = weight**2 * (1 - share / weight)
    return float(np.clip((radial + weight).mean() / 2 / weight.mean(), 0.2, 1.0))


def _unit_gauge(state: ArticulatedState, size: int) -> FloatArray:
    """(G, 7) directions, of unit length, that move, turn and scale all cameras; bone lengths take no part."""
    out = np.zeros((size, 7))
    cameras = len(state.centers)
    by_camera = out[: PER_CAMERA * cameras].reshape(cameras, PER_CAMERA, 7)
    by_camera[:, :POSE_SIZE] = gauge(state.rotations, state.centers)
    return np.asarray(out / np.linalg.norm(out, axis=0))
