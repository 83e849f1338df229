"""Models that fill one gap in the path of a point; shared by the gap filling of landmarks and of markers.

A gap is the frames [start, stop): the first missing one and the first known one after it.
"""

from __future__ import annotations

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.numerics.rotations import kabsch


def gaps_of(known: BoolArray) -> list[tuple[int, int]]:
    """Gaps [start, stop) of a path with known frames (T,), including those at the ends."""
    edges = np.diff(np.concatenate([[True], known, [True]]).astype(int))
    return list(zip(np.nonzero(edges == -1)[0].tolist(), np.nonzero(edges == 1)[0].tolist(), strict=True))


def gap_share(start: int, stop: int) -> FloatArray:
    """(stop - start, 1) linear weights over a gap, 0 at the last frame before it and 1 at the first after it."""
    return (np.arange(start, stop) - start + 1)[:, None] / (stop - start + 1)


def edge_velocity(path: FloatArray, edge: int, step: int, support: int, parabola: bool = False) -> FloatArray | None:
    """Velocity per frame at an edge of a gap, from the known frames on its outer side.

    Args:
        path: (T, 3) metres, NaN where missing.
        edge: known frame at the edge.
        step: 1 for the edge after the gap, -1 for the edge before it.
        support: number of frames considered.
        parabola: fit a parabola where four frames are known, else a line.

    Returns:
        (3,), or None with fewer than two known frames.
    """
    frames = range(edge, edge + support * step, step)
    known = np.array([f for f in frames if 0 <= f < len(path) and np.isfinite(path[f, 0])], dtype=np.int64)
    if len(known) < 2:
        return None
    degree = 2 if parabola and len(known) >= 4 else 1
    return np.asarray(np.polynomial.polynomial.polyfit(known - edge, path[known], degree)[1])


def cubic_gap(path: FloatArray, start: int, stop: int, before: FloatArray, after: FloatArray) -> FloatArray:
    """(stop - start, 3) cubic Hermite curve over a gap, from the velocities (3,) per frame at both edges."""
    span, u = stop - start + 1, gap_share(start, stop)
    return np.asarray(
        (2 * u**3 - 3 * u**2 + 1) * path[start - 1] + (u**3 - 2 * u**2 + u) * span * before
        + (3 * u**2 - 2 * u**3) * path[stop] + (u**3 - u**2) * span * after
    )  # fmt: skip


def rigid_gap(path: FloatArray, body: FloatArray, start: int, stop: int) -> FloatArray | None:
    """Fill a gap from a rigid body: transfer the point from both edges of the gap and blend.

    Args:
        path: (T, 3) metres; one edge may be missing.
        body: (T, B, 3) at least three points that keep their distances, known in the gap.
        start, stop: the gap.

    Returns:
        (stop - start, 3), or None where neither edge is known.
    """
    transferred, weights = [], []
    for edge in (start - 1, stop):
        if 0 <= edge < len(path) and np.isfinite(path[edge, 0]) and np.isfinite(body[edge]).all():
            turn, middle = rigid_motion(body[start:stop], body[edge])
            transferred.append(np.einsum("tij,j->ti", turn, path[edge] - body[edge].mean(0)) + middle)
            share = gap_share(start, stop)
            weights.append(1 - share if edge < start else share)
    if not transferred:
        return None
    total = sum(weights)
    return np.asarray(sum(c * w for c, w in zip(transferred, weights, strict=True)) / total)


def rigid_motion(body: FloatArray, shape: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (T, 3, 3) and centroids (T, 3) that best map `shape` (B, 3) to the bodies (T, B, 3)."""
    middle = body.mean(1)
    return kabsch(shape - shape.mean(0), body - middle[:, None], np.ones(len(shape))), middle
