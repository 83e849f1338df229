"""What the solver's network sees of a fitted body, and what its answer means.

Both training and inference go through here, so that they cannot differ.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.body import BODY
from muybridge.geometry.landmarks import SURFACE
from muybridge.geometry.marker_body import marker_body
from muybridge.geometry.marker_fit import MarkerFit
from muybridge.geometry.rotations import exp_so3, matrix_from_quat

Array = NDArray[np.float64]
F32 = NDArray[np.float32]

# Metres and radians of one unit of the network's.
LENGTH, ANGLE = 0.01, 0.1
# Residuals beyond this are as bad as missing, metres.
FAR = 0.06


def carriers() -> list[int]:
    """(M,) joint of BODY that carries each marker of SURFACE; a forearm's roll counts as the hand."""
    table = marker_body()
    return [BODY.joint_names.index(table.names[j].replace("forearm_roll", "hand")) for j in table.carrier]


@dataclass(frozen=True, eq=False)
class SolverInput:
    """The network's input for T frames: see `models.solver_net.SolverNet.forward`.

    Attributes:
        markers: (T, M, F); known: (T, M); joints: (T, J, 12).
        turns, places: (T, J, 3, 3) and (T, J, 3) of the fit, in the world.
    """

    markers: F32
    known: F32
    joints: F32
    turns: Array
    places: Array


def solver_input(fit: MarkerFit, points_world: Array, window: tuple[float, ...]) -> SolverInput:
    """Features of a fit.

    Args:
        fit: of the markers.
        points_world: (T, L, 3) metres, those that were fitted.
        window: seconds, frames about each.
    """
    table, motion, size = marker_body(), fit.motion, len(SURFACE)
    turns, places = motion.skeleton.forward(motion.root_positions_world, matrix_from_quat(motion.quat_wxyz))
    markers = fit.person.markers[: points_world.shape[1]]
    joint = np.array(carriers())
    off = np.einsum("tlji,tlj->tli", turns[:, joint[markers]], points_world - fit.markers_world) / LENGTH
    good = np.isfinite(off).all(-1) & (np.linalg.norm(np.nan_to_num(off), axis=-1) < FAR / LENGTH)
    off = np.where(good[..., None], off, 0.0)
    columns = []
    for seconds in window:
        at = np.clip(np.arange(len(off)) + round(seconds * motion.fps), 0, len(off) - 1)
        columns += [off[at], good[at][..., None].astype(float)]
    _, usual, _ = table.parts(table.mean)
    placed = fit.person.rigging.offsets[: len(markers)]
    columns += [np.broadcast_to((placed - usual[markers]) / (5 * LENGTH), off.shape),
                np.broadcast_to(usual[markers] / 0.2, off.shape)]  # fmt: skip
    out = np.zeros((len(off), size, sum(c.shape[-1] for c in columns)), np.float32)
    out[:, markers] = np.concatenate(columns, -1)
    known = np.zeros((len(off), size), np.float32)
    known[:, markers] = 1.0
    local = np.stack([turns[:, j] if p < 0 else np.swapaxes(turns[:, p], 1, 2) @ turns[:, j]
                      for j, p in enumerate(BODY.parents)], 1)  # fmt: skip
    # The root's own heading tells nothing: its tilt does.
    up = turns[:, 0, 2]
    six = local[..., :2].reshape(*local.shape[:2], 6)
    six[:, 0] = np.concatenate([up, np.zeros_like(up)], -1)
    above = six[:, np.maximum(np.array(BODY.parents), 0)]
    return SolverInput(out, known, np.concatenate([six, above], -1).astype(np.float32), turns, places)


def apply_corrections(given: SolverInput, answer: NDArray[np.floating]) -> tuple[Array, Array]:
    """Rotations (T, J, 3, 3) and places (T, J, 3) of the joints in the world, corrected by the network's answer
    (T, J, 6)."""
    said = np.asarray(answer, np.float64)
    turns = given.turns @ exp_so3(said[..., :3] * ANGLE)
    return turns, given.places + np.einsum("tjik,tjk->tji", given.turns, said[..., 3:] * LENGTH)


def target_of(given: SolverInput, turns: Array, places: Array) -> F32:
    """(T, J, 6) the answer that would be right, for the truth in the world."""
    from muybridge.geometry.rotations import log_so3

    off = log_so3(np.swapaxes(given.turns, -1, -2) @ turns) / ANGLE
    shift = np.einsum("tjik,tji->tjk", given.turns, places - given.places) / LENGTH
    return np.concatenate([off, shift], -1).astype(np.float32)
