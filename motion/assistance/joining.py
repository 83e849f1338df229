"""Captured fragments put one behind the other: stretched in time, faded over where they meet."""

from collections.abc import Iterator, Sequence

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.motion.assistance.fragments import Fragment

_FADE = 0.25  # seconds over which one fragment fades into the next, or less in short ones


def times_in_takes(wanted: Sequence[Fragment], chosen: Sequence[Fragment], at: FloatArray) -> list[FloatArray]:
    """For each fragment (N,) the frames of its take that belong to frames of the clip, also beyond the fragment.

    Args:
        wanted: of the clip.
        chosen: of takes.
        at: (N,) frames of the clip.
    """
    out = []
    for mine, theirs in zip(wanted, chosen, strict=True):
        rate = (theirs.end - theirs.start) / max(mine.end - mine.start, 1)
        out.append(theirs.start + (at - mine.start) * rate)
    return out


def fade_weights(wanted: Sequence[Fragment], chosen: Sequence[Fragment], frames: int, fps: float) -> FloatArray:
    """(N, T) how much each fragment counts in each frame; one in total, and without a corner over time.

    Fragments that follow each other in their take count as one, whose times meet there already.
    """
    out = np.zeros((len(wanted), frames))
    at = np.arange(frames, dtype=np.float64)
    left = np.ones(frames)
    for n, mine in enumerate(wanted):
        if n + 1 == len(wanted):
            out[n] = left
            break
        half = 0.5 * min(_FADE * fps, mine.end - mine.start, wanted[n + 1].end - wanted[n + 1].start)
        s = np.clip((at - mine.end) / (2 * max(half, 1.0)) + 0.5, 0.0, 1.0)
        later = s * s * (3 - 2 * s)
        out[n], left = left * (1 - later), left * later
    return out


def joined_rotations(
    wanted: Sequence[Fragment], chosen: Sequence[Fragment], takes: Sequence[FloatArray], frames: int, fps: float
) -> FloatArray:
    """(T, F, 4) rotations of the chosen fragments, one fading into the next.

    Args:
        wanted: fragments of the clip.
        chosen: one of a take for each.
        takes: (T', F, 4) rotations of each take.
        frames: of the clip.
        fps: frames per second of the clip.
    """
    total = np.zeros((frames, *takes[0].shape[1:]))
    for rows, weights, at, take in _pieces(wanted, chosen, takes, frames, fps):
        values = _between(take, at)
        sign = np.where(np.sum(values * total[rows], axis=-1, keepdims=True) < 0, -1.0, 1.0)
        total[rows] += weights[:, None, None] * sign * values
    return continuous_quat(total / np.linalg.norm(total, axis=-1, keepdims=True))


def joined_vectors(
    wanted: Sequence[Fragment], chosen: Sequence[Fragment], takes: Sequence[FloatArray], frames: int, fps: float
) -> FloatArray:
    """(T, ...) as `joined_rotations`, of vectors (T', ...)."""
    total = np.zeros((frames, *takes[0].shape[1:]))
    for rows, weights, at, take in _pieces(wanted, chosen, takes, frames, fps):
        total[rows] += weights.reshape(-1, *[1] * (take.ndim - 1)) * _between(take, at)
    return total


def _pieces(
    wanted: Sequence[Fragment], chosen: Sequence[Fragment], takes: Sequence[FloatArray], frames: int, fps: float
) -> Iterator[tuple[IndexArray, FloatArray, FloatArray, FloatArray]]:
    """For each fragment: the frames in which it counts, how much, its take's frames there, and the take."""
    every = np.arange(frames, dtype=np.float64)
    times = times_in_takes(wanted, chosen, every)
    for fragment, weights, at in zip(chosen, fade_weights(wanted, chosen, frames, fps), times, strict=True):
        rows = np.flatnonzero(weights > 0)
        if len(rows):
            yield rows, weights[rows], at[rows], takes[fragment.clip]


def _between(values: FloatArray, at: FloatArray) -> FloatArray:
    """Values (T, ...) between frames; what lies beyond an end goes on as its mirror image in time."""
    last = len(values) - 1
    at = np.abs(at)
    at = np.clip(np.where(at > last, 2 * last - at, at), 0, last)
    before = np.minimum(at.astype(np.intp), max(last - 1, 0))
    after = np.minimum(before + 1, last)
    s = (at - before).reshape(-1, *[1] * (values.ndim - 1))
    slopes = np.gradient(values, axis=0)
    rise = values[after] - values[before]
    ends = s * (1 - s) ** 2 * slopes[before] + s * s * (s - 1) * slopes[after]
    return np.asarray(values[before] + s * s * (3 - 2 * s) * rise + ends)
