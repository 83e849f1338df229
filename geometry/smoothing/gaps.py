"""Filling of gaps in the paths of landmarks, from frames before and after the gap and from neighbouring landmarks.

Sources: spline, rigid body and pattern fill are methods of marker software; low rank: O. Gloersen, P. Federolf,
"Predicting missing marker trajectories in human motion data using marker intercorrelations", PLOS ONE, 2016.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.smoothing.gap_models import cubic_gap, edge_velocity, gap_share, gaps_of, rigid_gap


@dataclass(frozen=True)
class GapOptions:
    """How gaps are filled.

    Attributes:
        max_gap: longest gap that is filled, seconds; the ends of the take are not filled.
        short: longest gap that `auto` fills with a spline where no rigid set of neighbours is known, seconds.
        rigid_spread: largest standard deviation of the distances within a set of points that counts as rigid, metres.
        rank: of `low_rank`: number of principal components of the other points.
        ridge: regularisation: principal components with less motion than this have little weight, metres.
    """

    max_gap: float = 2.0
    short: float = 0.2
    rigid_spread: float = 0.012
    rank: int = 24
    ridge: float = 0.003


def fill_gaps(xyz: FloatArray, fps: float, method: str = "auto", options: GapOptions | None = None) -> FloatArray:
    """Fill gaps between known frames.

    Args:
        xyz: (T, J, 3) metres, NaN where missing.
        fps: frames per second.
        method: `spline`, `rigid`, `pattern`, `low_rank`, or `auto`, which had the smallest errors in tests: a rigid set
            of neighbours where there is one, else a spline for few frames and low rank for more.
        options: see GapOptions.

    Returns:
        (T, J, 3); known points are unchanged. A gap for which the method lacks the data is filled with a spline.

    Raises:
        ValueError: an unknown method.
    """
    options = options or GapOptions()
    if method not in GAP_METHODS and method != "auto":
        raise ValueError(f"unknown method {method!r}: choose one of auto, {', '.join(GAP_METHODS)}")
    out = np.array(xyz, dtype=np.float64)
    out[~np.isfinite(out).all(axis=-1)] = np.nan
    known = np.isfinite(out[..., 0])
    gaps = [(j, *gap) for j in range(known.shape[1]) for gap in _inner_gaps(known[:, j], options.max_gap * fps)]
    if not gaps:
        return out
    source = out.copy()
    for j, start, stop in gaps:
        if method == "auto":
            filled = _rigid(source, j, start, stop, options)
            if filled is None and stop - start > options.short * fps:
                filled = _low_rank(source, j, start, stop, options)
        else:
            filled = GAP_METHODS[method](source, j, start, stop, options)
        out[start:stop, j] = _spline(source, j, start, stop, options) if filled is None else filled
    return out


def _inner_gaps(known: BoolArray, longest: float) -> list[tuple[int, int]]:
    """Gaps [start, stop) between known frames of a point, as long as `longest` frames at most."""
    return [(a, b) for a, b in gaps_of(known) if a > 0 and b < len(known) and b - a <= longest]


def _spline(xyz: FloatArray, j: int, start: int, stop: int, _: GapOptions) -> FloatArray:
    """Cubic Hermite spline between the edges, with the velocities on both sides."""
    path = xyz[:, j]
    # Damped in long gaps: a velocity says little about the motion seconds later.
    damping = min(1.0, 8.0 / (stop - start))
    speeds = (edge_velocity(path, edge, step, 5) for edge, step in ((start - 1, -1), (stop, 1)))
    before, after = (np.zeros(3) if speed is None else speed * damping for speed in speeds)
    return cubic_gap(path, start, stop, before, after)


def _through(xyz: FloatArray, j: int, start: int, stop: int) -> IndexArray:
    """Other landmarks that are known in the gap and at its edges."""
    known = np.asarray(np.isfinite(xyz[start - 1 : stop + 1, :, 0]).all(axis=0))
    known[j] = False
    return np.flatnonzero(known)


def _spreads(xyz: FloatArray, j: int, others: IndexArray, start: int, stop: int) -> FloatArray:
    """(K,) standard deviation of the distance to each other landmark, near the gap."""
    near = slice(max(start - 250, 0), stop + 250)
    distance = np.linalg.norm(xyz[near, others] - xyz[near, j : j + 1], axis=-1)
    count = np.isfinite(distance).sum(axis=0)
    return np.where(count > 5, np.nanstd(np.where(count > 5, distance, 0.0), axis=0), np.inf)


def _rigid(xyz: FloatArray, j: int, start: int, stop: int, options: GapOptions) -> FloatArray | None:
    """Transfer by the rigid body of three or more points that keep their distances to the landmark."""
    others = _through(xyz, j, start, stop)
    if len(others) < 3:
        return None
    spread = _spreads(xyz, j, others, start, stop)
    chosen = others[np.argsort(spread)][:4][np.sort(spread)[:4] < options.rigid_spread]
    if len(chosen) < 3:
        return None
    return rigid_gap(xyz[:, j], xyz[:, chosen], start, stop)


def _pattern(xyz: FloatArray, j: int, start: int, stop: int, _: GapOptions) -> FloatArray | None:
    """The path of the landmark whose distance varies least, shifted to meet both edges."""
    others = _through(xyz, j, start, stop)
    if not len(others):
        return None
    donor = others[int(np.argmin(_spreads(xyz, j, others, start, stop)))]
    return _meet_edges(xyz, xyz[:, donor : donor + 1].repeat(xyz.shape[1], 1), j, start, stop)


def _meet_edges(xyz: FloatArray, guess: FloatArray, j: int, start: int, stop: int) -> FloatArray:
    """A prediction (T, J, 3) over the gap, shifted linearly in time to meet the known points at the edges."""
    frames, share = np.arange(start, stop), gap_share(start, stop)
    off = [xyz[edge, j] - guess[edge, j] for edge in (start - 1, stop)]
    return np.asarray(guess[frames, j] + (1 - share) * off[0] + share * off[1])


def _low_rank(xyz: FloatArray, j: int, start: int, stop: int, options: GapOptions) -> FloatArray | None:
    """Prediction from the other points' principal components: regression over the frames that have all of them."""
    others = _through(xyz, j, start, stop)
    rows = np.flatnonzero(np.isfinite(xyz[:, others, 0]).all(axis=1))
    if len(others) < 4:
        return None
    centre = xyz[rows][:, others].mean(axis=1)
    local = xyz[rows] - centre[:, None]
    frame = _heading(local[:, others], int(np.searchsorted(rows, start - 1)))
    seen = (local[:, others] @ frame).reshape(len(rows), -1)
    wanted = (local[:, j, None] @ frame)[:, 0]
    known = np.flatnonzero(np.isfinite(wanted[:, 0]))
    known = known[:: max(1, len(known) // 3000)]
    if len(known) < 3 * options.rank:
        return None
    mean, mean_wanted = seen[known].mean(axis=0), wanted[known].mean(axis=0)
    _, axes = np.linalg.eigh((seen[known] - mean).T @ (seen[known] - mean))
    scores = (seen - mean) @ axes[:, -options.rank :]
    normal = scores[known].T @ scores[known] + len(known) * options.ridge**2 * np.eye(scores.shape[1])
    guess = scores @ np.linalg.solve(normal, scores[known].T @ (wanted[known] - mean_wanted)) + mean_wanted
    out = np.full((len(xyz), 1, 3), np.nan)
    out[rows, 0] = (guess[:, None] @ np.swapaxes(frame, -1, -2))[:, 0] + centre
    return _meet_edges(xyz[:, j : j + 1], out, 0, start, stop)


def _heading(local: FloatArray, at: int) -> FloatArray:
    """(T, 3, 3) rotations about z to the heading at which the body is most similar to frame `at`."""
    a, b = local[at, :, :2], local[:, :, :2]
    angle = np.unwrap(np.arctan2(
        np.sum(a[:, 0] * b[..., 1] - a[:, 1] * b[..., 0], axis=1), np.sum(a * b, axis=(1, 2))
    ))  # fmt: skip
    cosine, sine = np.cos(angle), np.sin(angle)
    out = np.zeros((len(local), 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1], out[:, 2, 2] = cosine, -sine, sine, cosine, 1.0
    return out


GAP_METHODS: dict[str, Callable[[FloatArray, int, int, int, GapOptions], FloatArray | None]] = {
    "spline": _spline,
    "rigid": _rigid,
    "pattern": _pattern,
    "low_rank": _low_rank,
}
