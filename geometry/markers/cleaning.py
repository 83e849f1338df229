"""Cleaning of labelled markers: spikes are removed, gaps are filled, and every changed sample is marked.

A gap is filled by the one of three methods that predicts the frames beside it best: a curve through the marker's own
path (short gaps), the rigid body of the markers whose distance to it varies least, or a regression on these markers in
the frame of that body, which also models the sliding of the skin.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from muybridge.geometry.smoothing.gap_models import (
    cubic_gap,
    edge_velocity,
    gap_share,
    gaps_of,
    rigid_gap,
    rigid_motion,
)


class Sample(IntEnum):
    """Origin of a sample."""

    MISSING = 0
    MEASURED = 1
    CURVE = 2
    RIGID = 3
    PATTERN = 4


@dataclass(frozen=True)
class CleanOptions:
    """How markers are cleaned.

    Attributes:
        fill: whether gaps are filled.
        curve_frames: longest gap that a curve may fill.
        longest_s: longest gap that is filled at all, seconds.
        partners: number of other markers from which a gap is filled.
        sure_frames: longest gap that a curve fills without comparison to other methods, ...
        sure_m: ... if its error in the frames beside the gap is at most this, metres.
        spike: distance of a spike from its neighbours in time, in robust standard deviations, ...
        spike_m: ... and at least this far, metres.
        trust_m: largest error in the frames beside a gap at which it is filled, metres.
    """

    fill: bool = True
    curve_frames: int = 10
    longest_s: float = 2.0
    partners: int = 12
    sure_frames: int = 3
    sure_m: float = 0.002
    spike: float = 8.0
    spike_m: float = 0.02
    trust_m: float = 0.05


@dataclass(frozen=True)
class Cleaned:
    """Markers after cleaning.

    Attributes:
        points: (T, M, 3) metres, NaN where missing.
        sample: (T, M) origin of each sample, a `Sample`.
        spikes: (T, M) removed samples.
        error_m: (T, M) error of the chosen method in the frames beside the gap, metres; NaN outside of gaps.
    """

    points: FloatArray
    sample: ByteArray
    spikes: BoolArray
    error_m: FloatArray


def clean_markers(points: FloatArray, fps: float, options: CleanOptions = CleanOptions(),
                  settled: BoolArray | None = None) -> Cleaned:  # fmt: skip
    """Remove spikes and fill gaps.

    Args:
        points: (T, M, 3) metres, any axis up.
        fps: frames per second.
        options: see `CleanOptions`.
        settled: (T, M) samples that a person has confirmed, which are no spikes.
    """
    spikes = find_spikes(points, _partners(points), options)
    if settled is not None:
        spikes &= ~settled
    known = np.where(spikes[..., None], np.nan, points)
    sample = np.where(np.isfinite(known[..., 0]), Sample.MEASURED, Sample.MISSING).astype(np.uint8)
    error = np.full(sample.shape, np.nan)
    filled = known.copy()
    if options.fill and len(points) > 4:
        partners = _partners(known)
        for marker in range(points.shape[1]):
            _fill_marker(marker, known, partners[marker], fps, options, filled, sample, error)
    return Cleaned(filled, sample, spikes, error)


def find_spikes(points: FloatArray, partners: IndexArray, options: CleanOptions = CleanOptions()) -> BoolArray:
    """(T, M) samples that deviate for one or two frames.

    They deviate from the line through the samples around them, more than the marker's own motion nearby, and from the
    position that the rigid body of its partners predicts, so that an impact is no spike.
    """
    out = np.zeros(points.shape[:2], bool)
    if len(points) < 7:
        return out
    for first, second in ((1, 1), (1, 2), (2, 1)):  # single samples; first and second of two
        between = points[: len(points) - first - second] * second + points[first + second :] * first
        off = np.full(points.shape[:2], np.nan)
        inner = slice(first, len(points) - second)
        off[inner] = np.linalg.norm(points[inner] - between / (first + second), axis=-1)
        with np.errstate(invalid="ignore"):
            usual = np.fmax(np.roll(off, 4, 0), np.roll(off, -4, 0))
            out |= (off > options.spike * _median(off)) & (off > options.spike_m) & (off > 4 * np.nan_to_num(usual))
    out &= ~_outdone(points, out)
    for t, m in zip(*np.nonzero(out), strict=True):
        a, b = max(t - 2, 1), min(t + 3, len(points) - 1)
        body = partners[m][np.isfinite(points[a - 1 : b + 1, partners[m], 0]).all(0)][:4]
        carried = rigid_gap(points[:, m], points[:, body], a, b) if len(body) >= 3 else None
        if carried is not None:
            out[t, m] = np.linalg.norm(carried[t - a] - points[t, m]) > 1.5 * options.spike_m
    return out


def _outdone(points: FloatArray, spikes: BoolArray) -> BoolArray:
    """Spikes beside a larger one."""
    off = np.full(points.shape[:2], np.nan)
    off[1:-1] = np.linalg.norm(points[1:-1] - (points[:-2] + points[2:]) / 2, axis=-1)
    off = np.where(spikes, np.nan_to_num(off), 0.0)
    nearby = np.zeros_like(off)
    nearby[1:] = np.maximum(nearby[1:], off[:-1])
    nearby[:-1] = np.maximum(nearby[:-1], off[1:])
    return spikes & (nearby > 1.5 * off)


def _median(values: FloatArray) -> FloatArray:
    filled = np.where(np.isfinite(values).any(0), values, 0.0)
    return np.asarray(np.nanmedian(filled, 0) + 1e-4)


def _partners(points: FloatArray) -> IndexArray:
    """(M, M - 1) the other markers, sorted by the variation of their distance over the recording."""
    some = points[:: max(1, len(points) // 400)]
    count = points.shape[1]
    spread = np.full((count, count), np.inf)
    for m in range(count):
        distance = np.linalg.norm(some - some[:, m : m + 1], axis=-1)
        enough = np.isfinite(distance).sum(0) > 3
        spread[m, enough] = np.nanstd(distance[:, enough], 0)
        # A distant marker says less about the rotation of this part of the body.
        spread[m, enough] += 0.02 * np.nanmean(distance[:, enough], 0)
        spread[m, m] = np.inf
    return np.argsort(spread, 1, kind="stable")[:, : count - 1]


def _fill_marker(marker: int, known: FloatArray, partners: IndexArray, fps: float, options: CleanOptions,
                 filled: FloatArray, sample: ByteArray, error: FloatArray) -> None:  # fmt: skip
    there = np.isfinite(known[:, marker, 0])
    if there.all() or there.sum() < 4:
        return
    for a, b in gaps_of(there):
        if b - a > options.longest_s * fps:
            continue
        if b - a <= options.sure_frames and _sure_curve(marker, a, b, known, options, filled, sample, error):
            continue
        ways = _ways(marker, a, b, known, partners, options)
        scores = {way: _trial(way, marker, a, b, known, ways[way][1], options) for way in ways}
        fitting = {w: e for w, e in scores.items() if np.isfinite(e)}
        # Where no method could be tested, a curve over a short gap is safe.
        if not fitting and Sample.CURVE in ways and b - a <= options.curve_frames // 2:
            fitting = {Sample.CURVE: 0.0}
        if not fitting:
            continue
        best = min(fitting, key=lambda w: fitting[w])
        if fitting[best] <= options.trust_m:
            filled[a:b, marker] = ways[best][0]
            sample[a:b, marker] = best
            error[a:b, marker] = fitting[best]


def _sure_curve(marker: int, a: int, b: int, known: FloatArray, options: CleanOptions, filled: FloatArray,
                sample: ByteArray, error: FloatArray) -> bool:  # fmt: skip
    """Fill a short gap by a curve if its error in the frames beside the gap is small enough; returns whether it is."""
    curve = fill_curve(known[:, marker], a, b)
    if curve is None:
        return False
    missed = _trial(Sample.CURVE, marker, a, b, known, np.zeros(0, np.intp), options)
    if missed > options.sure_m:
        return False
    filled[a:b, marker], sample[a:b, marker], error[a:b, marker] = curve, Sample.CURVE, missed
    return True


def _ways(marker: int, a: int, b: int, known: FloatArray, partners: IndexArray,
          options: CleanOptions) -> dict[Sample, tuple[FloatArray, IndexArray]]:  # fmt: skip
    """Every method that can fill the gap, with its result and the partners that it uses."""
    out: dict[Sample, tuple[FloatArray, IndexArray]] = {}
    none = np.zeros(0, np.intp)
    if b - a <= options.curve_frames:
        curve = fill_curve(known[:, marker], a, b)
        if curve is not None:
            out[Sample.CURVE] = (curve, none)
    seen = np.asarray(np.isfinite(known[max(a - 1, 0) : b + 1, :, 0]).all(axis=0))
    chosen = partners[seen[partners]][: options.partners]
    if len(chosen) >= 3:
        for way, fill in ((Sample.RIGID, rigid_gap), (Sample.PATTERN, fill_pattern)):
            body = chosen[:4] if way == Sample.RIGID else chosen
            found = fill(known[:, marker], known[:, body], a, b)
            if found is not None:
                out[way] = (found, body)
    return out


def _trial(way: Sample, marker: int, a: int, b: int, known: FloatArray, body: IndexArray,
           options: CleanOptions) -> float:  # fmt: skip
    """Median error of a method in artificial gaps of the same length beside this one, metres.

    Shorter ones where there is no room; infinite where none fits.
    """
    path, errors = known[:, marker], list[float]()
    whole = np.isfinite(path[:, 0]) & np.isfinite(known[:, body, 0]).all(1)
    for length in (b - a, (b - a + 1) // 2, (b - a + 3) // 4):
        steps = [k * (length + 2) for k in range(1, 7)]
        for start in [at for step in steps for at in (a - step, b + step - length)]:
            end = start + length
            if len(errors) == 4 or start < 1 or end >= len(path) or not whole[start - 1 : end + 1].all():
                continue
            hidden = path.copy()
            hidden[start:end] = np.nan
            found = _fill(way, hidden, known[:, body], start, end)
            if found is not None and np.isfinite(found).all():
                errors.append(float(np.median(np.linalg.norm(found - path[start:end], axis=1))))
        if errors:
            return float(np.mean(errors))
    return float("inf")


def _fill(way: Sample, path: FloatArray, body: FloatArray, a: int, b: int) -> FloatArray | None:
    if way == Sample.CURVE:
        return fill_curve(path, a, b)
    return rigid_gap(path, body, a, b) if way == Sample.RIGID else fill_pattern(path, body, a, b)


def fill_curve(path: FloatArray, a: int, b: int, support: int = 4) -> FloatArray | None:
    """(b - a, 3) cubic curve over the gap, from position and velocity at its edges.

    None where the two frames next to an edge are not known.
    """
    if a < 2 or b + 2 > len(path) or not np.isfinite(path[[a - 2, a - 1, b, b + 1]]).all():
        return None
    before, after = edge_velocity(path, a - 1, -1, support, True), edge_velocity(path, b, 1, support, True)
    return None if before is None or after is None else cubic_gap(path, a, b, before, after)


def fill_pattern(
    path: FloatArray, body: FloatArray, a: int, b: int, ridge: float = 1e-3, most: int = 600
) -> FloatArray | None:
    """(b - a, 3) regression over the gap.

    In the frame of the body, the marker's position is a linear function of its partners' positions, learned from the
    frames around the gap in which all are known (Gloersen and Federolf 2016 use principal components for the same
    purpose). The error at the edges of the gap is subtracted along it.
    """
    known = np.nonzero(np.isfinite(path[:, 0]) & np.isfinite(body).all((1, 2)))[0]
    if len(known) < 40:
        return None
    known = known[np.argsort(np.minimum(np.abs(known - a), np.abs(known - b)), kind="stable")[:most]]
    shape = body[known[len(known) // 2]]
    frames = np.concatenate([known, np.arange(a, b)])
    turn, middle = rigid_motion(body[frames], shape)
    local = np.einsum("tji,tbj->tbi", turn, body[frames] - middle[:, None]).reshape(len(frames), -1)
    target = np.einsum("tji,tj->ti", turn[: len(known)], path[known] - middle[: len(known)])
    mean, aim = local[: len(known)].mean(0), target.mean(0)
    x, y = local - mean, target - aim
    gram = x[: len(known)].T @ x[: len(known)]
    weights = np.linalg.solve(gram + ridge * np.eye(len(gram)), x[: len(known)].T @ y)
    found = np.einsum("tij,tj->ti", turn, x @ weights + aim) + middle
    out = found[len(known) :]
    share = gap_share(a, b)
    miss = {int(f): path[f] - found[i] for i, f in enumerate(known) if f in (a - 1, b)}
    if not miss:
        return None
    before, after = miss.get(a - 1), miss.get(b)
    if before is None:
        return np.asarray(out + after)
    return np.asarray(out + before if after is None else out + before * (1 - share) + after * share)
