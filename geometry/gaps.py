"""Gaps in the paths of landmarks or markers, filled from what is known before, after and beside them.

Sources: spline, rigid body and pattern fill are what marker software offers under these names; low rank: O. Gloersen,
P. Federolf, "Predicting missing marker trajectories in human motion data using marker intercorrelations", PLOS ONE,
2016.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from muybridge.geometry.rotations import kabsch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GapOptions:
    """How gaps are filled.

    Attributes:
        max_gap: seconds; longer gaps stay open, as do the ends of the take.
        short: seconds; `auto` takes a spline up to here.
        rigid_spread: metres, standard deviation of the distances within a set of points that counts as rigid.
        rank: of `low_rank`, at most.
    """

    max_gap: float = 2.0
    short: float = 0.06
    rigid_spread: float = 0.012
    rank: int = 12


def fill_gaps(xyz: Array, fps: float, method: str = "auto", options: GapOptions | None = None) -> Array:
    """Fill gaps between known frames.

    Args:
        xyz: (T, J, 3) metres, NaN where missing.
        fps: frames a second.
        method: `spline`, `rigid`, `pattern`, `low_rank`, or `auto`, which takes the best by measurement: a spline for a
            few frames, then a rigid set of neighbours, else low rank.
        options: see GapOptions.

    Returns:
        (T, J, 3); known points are untouched. A gap for which the method lacks what it needs gets the spline.

    Raises:
        ValueError: an unknown method.
    """
    options = options or GapOptions()
    if method not in GAP_METHODS and method != "auto":
        raise ValueError(f"unknown method {method!r}: choose one of auto, {', '.join(GAP_METHODS)}")
    out = np.array(xyz, dtype=np.float64)
    out[~np.isfinite(out).all(axis=-1)] = np.nan
    known = np.isfinite(out[..., 0])
    gaps = [g for g in _gaps(known) if (g[2] - g[1]) <= options.max_gap * fps]
    if not gaps:
        return out
    source = out.copy()
    low_rank = _low_rank(source, options) if method == "low_rank" or (method == "auto" and out.shape[1] >= 8) else None
    for j, start, stop in gaps:
        filled = None
        if method == "auto":
            if stop - start > options.short * fps:
                filled = _rigid(source, j, start, stop, options)
                if filled is None and low_rank is not None:
                    filled = _joined(source, low_rank, j, start, stop)
        elif method == "low_rank":
            filled = None if low_rank is None else _joined(source, low_rank, j, start, stop)
        else:
            filled = GAP_METHODS[method](source, j, start, stop, options)
        out[start:stop, j] = _spline(source, j, start, stop, options) if filled is None else filled
    return out


def _gaps(known: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """(landmark, first missing frame, first known frame after) of every gap between known frames."""
    out = []
    for j in range(known.shape[1]):
        frames = np.flatnonzero(known[:, j])
        jumps = np.flatnonzero(np.diff(frames) > 1)
        out += [(j, int(frames[k]) + 1, int(frames[k + 1])) for k in jumps]
    return out


def _velocity(path: Array, at: int, towards: int) -> Array:
    """Velocity per frame at an edge of a gap, from up to four known frames on its outer side."""
    frames = [f for f in range(at, at + 5 * towards, towards) if 0 <= f < len(path) and np.isfinite(path[f, 0])]
    if len(frames) < 2:
        return np.zeros(3)
    return np.asarray(np.polyfit(frames, path[frames], 1)[0])


def _spline(xyz: Array, j: int, start: int, stop: int, _: GapOptions) -> Array:
    """A cubic from edge to edge with the velocities on both sides."""
    path, edges = xyz[:, j], [start - 1, stop]
    # Slower where the gap is long: a velocity says little about what happens seconds later.
    calm = min(1.0, 8.0 / (stop - start))
    speeds = np.stack([_velocity(path, start - 1, -1), _velocity(path, stop, 1)]) * calm
    return np.asarray(CubicHermiteSpline(edges, path[edges], speeds, axis=0)(np.arange(start, stop)))


def _through(xyz: Array, j: int, start: int, stop: int) -> NDArray[np.intp]:
    """Other landmarks that are known in the gap and at its edges."""
    known = np.isfinite(xyz[start - 1 : stop + 1, :, 0]).all(axis=0)
    known[j] = False
    return np.flatnonzero(known)


def _spreads(xyz: Array, j: int, others: NDArray[np.intp], start: int, stop: int) -> Array:
    """(K,) standard deviation of the distance to each other landmark, about the gap."""
    near = slice(max(start - 250, 0), stop + 250)
    distance = np.linalg.norm(xyz[near, others] - xyz[near, j : j + 1], axis=-1)
    count = np.isfinite(distance).sum(axis=0)
    return np.where(count > 5, np.nanstd(np.where(count > 5, distance, 0.0), axis=0), np.inf)


def _rigid(xyz: Array, j: int, start: int, stop: int, options: GapOptions) -> Array | None:
    """With three or more points that keep their distances: where the body that they are part of carries the point."""
    others = _through(xyz, j, start, stop)
    if len(others) < 3:
        return None
    spread = _spreads(xyz, j, others, start, stop)
    chosen = others[np.argsort(spread)][:4][np.sort(spread)[:4] < options.rigid_spread]
    if len(chosen) < 3:
        return None
    frames = np.arange(start, stop)
    parts = []
    for edge in (start - 1, stop):
        at_edge = xyz[edge, chosen]
        middle, centre = at_edge.mean(axis=0), xyz[frames][:, chosen].mean(axis=1)
        source = np.broadcast_to(at_edge - middle, (len(frames), *at_edge.shape))
        turn = kabsch(source, xyz[frames][:, chosen] - centre[:, None], np.ones(source.shape[:2]))
        parts.append(centre + turn @ (xyz[edge, j] - middle))
    share = ((frames - start + 1) / (stop - start + 1))[:, None]
    return np.asarray((1 - share) * parts[0] + share * parts[1])


def _pattern(xyz: Array, j: int, start: int, stop: int, _: GapOptions) -> Array | None:
    """The path of the point that keeps its distance best, shifted to meet both edges."""
    others = _through(xyz, j, start, stop)
    if not len(others):
        return None
    donor = others[int(np.argmin(_spreads(xyz, j, others, start, stop)))]
    return _joined(xyz, xyz[:, donor : donor + 1].repeat(xyz.shape[1], 1), j, start, stop)


def _joined(xyz: Array, guess: Array, j: int, start: int, stop: int) -> Array:
    """A guess (T, J, 3) over the gap, shifted linearly in time so that it meets what is known at the edges."""
    frames = np.arange(start, stop)
    share = ((frames - start + 1) / (stop - start + 1))[:, None]
    off = [xyz[edge, j] - guess[edge, j] for edge in (start - 1, stop)]
    return np.asarray(guess[frames, j] + (1 - share) * off[0] + share * off[1])


def _low_rank(xyz: Array, options: GapOptions, rounds: int = 30) -> Array | None:
    """(T, J, 3) by principal components of the whole body about its middle, missing values by alternation."""
    filled = xyz.copy()
    time = np.arange(len(xyz))
    for j in range(xyz.shape[1]):
        known = np.isfinite(xyz[:, j, 0])
        if known.any():
            for i in range(3):
                filled[:, j, i] = np.interp(time, time[known], xyz[known, j, i])
    seen = np.isfinite(filled[..., 0]).all(axis=0)
    if seen.sum() < 4 or len(xyz) < 10:
        return None
    missing = ~np.isfinite(xyz[:, seen, 0])
    body = filled[:, seen]
    centre = _middle(body, missing)
    frame = _heading(body - centre[:, None])
    local = (body - centre[:, None]) @ frame
    rank = min(options.rank, 3 * int(seen.sum()) - 1, len(xyz) - 1)
    for _ in range(rounds):
        flat = local.reshape(len(local), -1)
        mean = flat.mean(axis=0)
        _, vectors = np.linalg.eigh((flat - mean).T @ (flat - mean))
        basis = vectors[:, -rank:]
        again = (mean + (flat - mean) @ basis @ basis.T).reshape(local.shape)
        change = np.abs(again[missing] - local[missing]).max(initial=0.0)
        local[missing] = again[missing]
        if change < 1e-4:
            break
    out = filled
    out[:, seen] = local @ np.swapaxes(frame, -1, -2) + centre[:, None]
    return out


def _middle(body: Array, missing: NDArray[np.bool_]) -> Array:
    """(T, 3) the middle of the points that miss least, so that a gap does not move it."""
    steady = np.argsort(missing.sum(axis=0))[: max(4, body.shape[1] // 3)]
    return np.asarray(body[:, steady].mean(axis=1))


def _heading(local: Array) -> Array:
    """(T, 3, 3) turns about z to the heading in which the body looks most like its first frame."""
    a, b = local[0, :, :2], local[:, :, :2]
    angle = np.unwrap(np.arctan2(
        np.sum(a[:, 0] * b[..., 1] - a[:, 1] * b[..., 0], axis=1), np.sum(a * b, axis=(1, 2))
    ))  # fmt: skip
    cosine, sine = np.cos(angle), np.sin(angle)
    out = np.zeros((len(local), 3, 3))
    out[:, 0, 0], out[:, 0, 1], out[:, 1, 0], out[:, 1, 1], out[:, 2, 2] = cosine, -sine, sine, cosine, 1.0
    return out


GAP_METHODS: dict[str, Callable[[Array, int, int, int, GapOptions], Array | None]] = {
    "spline": _spline,
    "rigid": _rigid,
    "pattern": _pattern,
    "low_rank": _spline,  # solved for the whole take at once, in `fill_gaps`
}
