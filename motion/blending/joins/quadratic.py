"""A join smoothed by a parabola: fitted to the frames about it, and mixed in with a raised cosine.

As Huang and Chen 2004 describe it: over N frames on either side of the join, each degree of freedom is fitted by a
polynomial of the second degree; the fit counts fully at the join and not at all at the ends of the window. (Their
printed weight does not have these two values; the raised cosine here does.) A parabola cannot follow what bends twice
in the window, so detail is lost there, and a step is spread rather than removed.
"""

from dataclasses import replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics.rotations import (
    conjugate_quat,
    continuous_quat,
    multiply_quat,
    quat_from_rotvec,
    rotvec_from_quat,
)
from muybridge.geometry.skeleton.motion import Motion

FEWEST, MOST = 5, 20  # frames on either side of the join


def raised_cosine(frames: FloatArray, reach: int) -> FloatArray:
    """One at zero, zero from `reach` frames on to either side."""
    away = np.minimum(np.abs(np.asarray(frames, dtype=np.float64)) / reach, 1.0)
    return np.asarray(0.5 * (1 + np.cos(np.pi * away)))


def smooth_join(motion: Motion, join: float, reach: int) -> Motion:
    """Smooth a motion about a join by the quadratic fit.

    Args:
        motion: of both clips, one behind the other.
        join: frame at which they meet; it may lie between two frames.
        reach: N, frames on either side that the fit is made of; fewer are taken where a clip has fewer.
    """
    first, last = int(max(np.ceil(join - reach), 0)), int(min(np.floor(join + reach), len(motion) - 1))
    frames = np.arange(first, last + 1)
    x = (frames - join) / reach
    basis = np.stack([np.ones_like(x), x, x * x], axis=1)
    if len(frames) < basis.shape[1]:
        return motion
    project = basis @ np.linalg.pinv(basis)
    weight = raised_cosine(np.asarray(frames - join, dtype=np.float64), reach)

    def mixed(values: FloatArray) -> FloatArray:
        """(T, ...) with the fit mixed in."""
        piece = values[first : last + 1]
        w = weight.reshape(-1, *[1] * (values.ndim - 1))
        fit = np.tensordot(project, piece, axes=1)
        out = values.copy()
        out[first : last + 1] = (1 - w) * piece + w * fit
        return out

    # Rotations as vectors from the one in the middle of the window, where they are far from a half turn.
    middle = motion.quat_wxyz[int(np.clip(round(join), first, last))]
    piece = continuous_quat(multiply_quat(conjugate_quat(middle)[None], motion.quat_wxyz[first : last + 1]))
    vectors = rotvec_from_quat(piece)
    w = weight[:, None, None]
    vectors = (1 - w) * vectors + w * np.tensordot(project, vectors, axes=1)
    quat = motion.quat_wxyz.copy()
    quat[first : last + 1] = multiply_quat(middle[None], quat_from_rotvec(vectors))
    return replace(
        motion,
        root_positions_world=mixed(motion.root_positions_world),
        quat_wxyz=continuous_quat(quat),
        translations=None if motion.translations is None else mixed(motion.translations),
    )
