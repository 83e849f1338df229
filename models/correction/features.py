"""Features of a fitted body for the correction network, and the meaning of its output.

Training and inference share this code, so that they cannot differ.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from muybridge.arrays import Float32Array, FloatArray
from muybridge.geometry.fitting.marker_fit import MarkerFit
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.numerics.rotations import exp_so3, matrix_from_quat
from muybridge.geometry.skeleton.body import BODY
from muybridge.geometry.skeleton.statistical_body import marker_body

# Metres and radians per unit of the network's output.
LENGTH, ANGLE = 0.01, 0.1
# Larger residuals count as missing, metres.
FAR = 0.06


def carriers() -> list[int]:
    """(M,) joint of BODY that carries each marker of SURFACE; the roll joint of the forearm counts as the hand."""
    table = marker_body()
    return [BODY.joint_names.index(table.names[j].replace("forearm_roll", "hand")) for j in table.carrier]


@dataclass(frozen=True, eq=False)
class SolverInput:
    """The network's input for T frames: see `network.SolverNet.forward`.

    Attributes:
        markers: (T, M, F).
        known: (T, M) 1 for markers of the set.
        joints: (T, J, 17).
        turns, places: (T, J, 3, 3) and (T, J, 3) world_from_joint rotations and positions of the fit, metres.
    """

    markers: Float32Array
    known: Float32Array
    joints: Float32Array
    turns: FloatArray
    places: FloatArray


def solver_input(fit: MarkerFit, points_world: FloatArray, spans: tuple[float, ...]) -> SolverInput:
    """Features of a fit.

    Residuals are averaged over time with the fit's own weights, which suppresses noise and swapped markers the better
    the higher the frame rate is, and shrunk towards zero where few frames contribute.

    Args:
        fit: of the markers.
        points_world: (T, L, 3) metres, the fitted points.
        spans: standard deviations of the Gaussian windows, seconds; the mean over the whole take is added.
    """
    table, motion, size = marker_body(), fit.motion, len(SURFACE)
    turns, places = motion.skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))
    markers = fit.person.markers[: points_world.shape[1]]
    joint = np.array(carriers())[markers]
    off = np.einsum("tlji,tlj->tli", turns[:, joint], np.nan_to_num(points_world) - fit.markers_world) / LENGTH
    good = np.isfinite(points_world).all(-1) & (np.linalg.norm(off, axis=-1) < FAR / LENGTH)
    weight = np.where(good, fit.weight, 0.0)
    columns = []
    for seconds in (*spans, np.inf):
        mean, count = _smooth_residuals(off, weight, seconds * motion.fps)
        columns += [mean, np.log1p(count)[..., None] / 3]
    _, usual, _ = table.parts(table.mean)
    placed = fit.person.rigging.offsets[: len(markers)]
    columns += [np.broadcast_to((placed - usual[markers]) / (5 * LENGTH), off.shape),
                np.broadcast_to(usual[markers] / 0.2, off.shape)]  # fmt: skip
    out = np.zeros((len(off), size, sum(c.shape[-1] for c in columns)), np.float32)
    out[:, markers] = np.concatenate(columns, -1)
    known = np.zeros((len(off), size), np.float32)
    known[:, markers] = 1.0
    return SolverInput(out, known, _joint_features(fit, turns), turns, places)


def _smooth_residuals(off: FloatArray, weight: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Residuals averaged in a Gaussian window, shrunk as if one more frame had a residual of zero.

    Args:
        off: (T, L, 3) residuals.
        weight: (T, L).
        sigma: of the window, frames.

    Returns:
        Means (T, L, 3) and the weighted number of frames (T, L).
    """
    both = np.concatenate([off * weight[..., None], weight[..., None]], -1)
    if np.isinf(sigma):
        total = np.broadcast_to(both.sum(0), both.shape)
    else:
        reach = max(1, int(np.ceil(2.5 * sigma)))
        kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-3)) ** 2)
        total = scipy.ndimage.convolve1d(both, kernel, axis=0, mode="constant")
    count = total[..., 3]
    return total[..., :3] / (count[..., None] + 1.0), count


def _joint_features(fit: MarkerFit, turns: FloatArray) -> Float32Array:
    """(T, J, 17): rotation relative to the parent and the parent's own, the bone's difference to the statistical
    body's, the size of the person and the agreement of the markers."""
    local = np.stack([turns[:, j] if p < 0 else np.swapaxes(turns[:, p], 1, 2) @ turns[:, j]
                      for j, p in enumerate(BODY.parents)], 1)  # fmt: skip
    # The root's heading carries no information; its tilt does.
    up = turns[:, 0, 2]
    six = local[..., :2].reshape(*local.shape[:2], 6)
    six[:, 0] = np.concatenate([up, np.zeros_like(up)], -1)
    above = six[:, np.maximum(np.array(BODY.parents), 0)]
    table = marker_body()
    usual = table.parts(table.mean)[0][[table.names.index(n) for n in BODY.joint_names]]
    offsets = fit.motion.skeleton.offsets
    size = float(np.linalg.norm(offsets[1:], axis=1).sum() / np.linalg.norm(usual[1:], axis=1).sum())
    beyond = (offsets - size * usual) / (2 * LENGTH)
    beyond[0] = 0
    agree = np.log(max(fit.noise_scale, 0.1))
    person = np.concatenate([beyond, np.tile([(size - 1) / 0.2, agree], (len(beyond), 1))], 1)
    return np.concatenate([six, above, np.broadcast_to(person, (len(turns), *person.shape))], -1).astype(np.float32)


def mirrored(
    markers: Float32Array, known: Float32Array, joints: Float32Array, target: Float32Array
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array]:
    """The same features and targets for the mirrored person: (..., M, F), (..., M), (..., J, 17), (..., J, 6)."""
    of_markers = [SURFACE.index(_counterpart(n)) for n in SURFACE.names]
    of_joints = [BODY.joint_names.index(_counterpart(n)) for n in BODY.joint_names]
    spans = (markers.shape[-1] - 6) // 4
    vector, rotation = np.array([-1, 1, 1], np.float32), np.array([1, -1, -1], np.float32)
    sides = np.concatenate([np.tile(np.r_[vector, 1], spans), vector, vector]).astype(np.float32)
    # First two columns: in the mirrored R (S R S) the entries with exactly one index x change sign.
    six = np.array([1, -1, -1, 1, -1, 1], np.float32)
    about = np.concatenate([six, six, vector, [1, 1]]).astype(np.float32)
    turned = joints[..., of_joints, :] * about
    # The root's features are the up direction, and so are the parent's of its children.
    tilt = np.array([-1, 1, 1, 1, 1, 1], np.float32)
    for j, parent in enumerate(BODY.parents):
        if parent < 0:
            turned[..., j, :6] = joints[..., j, :6] * tilt
        if parent <= 0:
            turned[..., j, 6:12] = joints[..., of_joints[j], 6:12] * tilt
    answer = target[..., of_joints, :] * np.concatenate([rotation, vector])
    return markers[..., of_markers, :] * sides, known[..., of_markers], turned, answer


def _counterpart(name: str) -> str:
    """The name of the counterpart on the other side of the body."""
    flip = {"left_": "right_", "right_": "left_"}
    return next((flip[s] + name[len(s) :] for s in flip if name.startswith(s)), name)


def apply_corrections(given: SolverInput, answer: NDArray[np.floating]) -> tuple[FloatArray, FloatArray]:
    """Correct a fit.

    Args:
        given: the network's input.
        answer: (T, J, 6) its output.

    Returns:
        Rotations (T, J, 3, 3) and positions (T, J, 3) of the joints in the world.
    """
    output = np.asarray(answer, np.float64)
    turns = given.turns @ exp_so3(output[..., :3] * ANGLE)
    return turns, given.places + np.einsum("tjik,tjk->tji", given.turns, output[..., 3:] * LENGTH)


def target_of(given: SolverInput, turns: FloatArray, places: FloatArray) -> Float32Array:
    """(T, J, 6) the output that would be correct, given the true rotations (T, J, 3, 3) and positions (T, J, 3) in the
    world."""
    from muybridge.geometry.numerics.rotations import log_so3

    off = log_so3(np.swapaxes(given.turns, -1, -2) @ turns) / ANGLE
    shift = np.einsum("tjik,tji->tjk", given.turns, places - given.places) / LENGTH
    return np.concatenate([off, shift], -1).astype(np.float32)
