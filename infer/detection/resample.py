"""2D landmarks resampled to the times of the take, where a camera's frames were taken at other times.

A take runs in even steps. Where cameras have other rates, a varying one or a table of times, each time has the frame
that is nearest, up to half a step off. And videos of a varying rate that were converted to an even one, as phones and
recorders of webcams do, repeat frames that show where somebody was before: at 5 m/s, a thirtieth of a second is 17 cm.
So a camera's landmarks are interpolated between its own frames before cameras are compared. And where people move
little from one frame to the next, not every frame has to be read.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.numerics.robust import row_median
from muybridge.infer.detection.frozen_frames import LONGEST_GAP_S, STILL, displacement
from muybridge.infer.detection.tracks import CameraTracks, missing_value
from muybridge.infer.session.session import Session

if TYPE_CHECKING:
    from muybridge.infer.detection.crop_reader import Poses

# Landmarks are interpolated between frames at most so many steps of the take apart, or LONGEST_GAP_S. Between frames
# farther apart they are missing where somebody moved.
_LONGEST_GAP_STEPS = 1.5
# Steps by which a frame may be off a time to be used as it is, and to learn from.
_EXACT, _ON_TIME = 0.02, 0.25
# Between two frames, somebody whose landmarks move by more than this share of their box is read in every frame.
_FAST = 0.06
# The same of so many landmarks, where the others say little: of somebody of 1.7 m, a limb at 1.5 m/s in 1/30 s.
_FAST_LIMB, _FEW = 0.03, 3


def on_time(session: Session, c: int, repeats: BoolArray) -> BoolArray:
    """(T,) frames of the take in which the camera shows people where they are at that time.

    Args:
        session: times of the frames.
        c: the camera.
        repeats: (T,) or more, which of the camera's frames repeat the one before.
    """
    late = 0.0 if session.late is None else session.late[c, : len(repeats)] * session.fps
    return np.asarray(~repeats[: session.frame_indices.shape[1]] & (np.abs(late) <= _ON_TIME))


def resample_tracks(session: Session, c: int, tracks: CameraTracks, repeats: BoolArray) -> CameraTracks:
    """A camera's tracks at the times of the take.

    Args:
        session: which frames they are of, and how late these were taken.
        c: the camera.
        tracks: of the session's first T frames.
        repeats: (T,) or more, which frames repeat the one before.

    Returns:
        The tracks, linearly interpolated between two frames that show the same person, constant before the first and
        after the last frame, and otherwise those of a frame within half a step. They are missing where there is no such
        frame, where two are far apart and the person moved, and after the end of a video that ends early.
    """
    count = len(tracks.body.points_px)
    steps = np.arange(count)
    at = steps + (session.late[c, :count] * session.fps if session.late is not None else 0.0)
    index = session.frame_indices[c, :count]
    new = np.append(True, index[1:] != index[:-1])[:count] & ~(repeats[:count] & (steps > 0))
    if new.all() and np.abs(at - steps).max(initial=0.0) < _EXACT:
        return tracks
    own = np.flatnonzero(new)
    last = np.searchsorted(at[own], steps + _EXACT, side="right") - 1
    low, high = (own[np.clip(last + k, 0, len(own) - 1)] for k in (0, 1))
    apart = at[high] - at[low]
    share = np.clip((steps - at[low]) / np.where(apart > 0, apart, 1.0), 0.0, 1.0)
    share[(apart <= 0) | (np.abs(steps - at[low]) < _EXACT)] = 0.0
    nearer = np.where(share > 0.5, high, low)
    outside = (last < 0) | (last == len(own) - 1)
    # Repeats of the last frame are a frozen video and show nothing of that time.
    near = (np.abs(steps - at[nearer]) <= 0.5 + _EXACT) | (outside & ~repeats[:count])
    between = (tracks.ids[low] == tracks.ids[high]) & (apart > 0)[:, None] & (share > 0)[:, None]
    far = apart > max(LONGEST_GAP_S * session.fps, _LONGEST_GAP_STEPS)
    between &= ~(far[:, None] & (displacement(tracks, low, high) > STILL))
    if session.ended is not None:
        near, between = near & ~session.ended[c, :count], between & ~session.ended[c, :count, None]
    nobody = ~between & ~near[:, None]

    def resampled(name: str, array: NDArray[Any]) -> NDArray[Any]:
        if name == "ids":
            return np.where(nobody, -1, array[nearer])
        shape = (count, -1, *[1] * (array.ndim - 2))
        weight = share.reshape(count, 1, *shape[2:])
        mixed = (1 - weight) * array[low] + weight * array[high]
        out = np.where(between.reshape(shape), mixed, array[nearer])
        return np.where(nobody.reshape(shape), missing_value(name), out)

    return tracks.map(resampled)


def fast_gaps(at: IndexArray, points_px: FloatArray, side: FloatArray, limbs: bool = False) -> list[tuple[int, int]]:
    """Pairs of successive frames `at` (n,) between which landmarks (n, J, 2) move far, by the `side` (n,) of a box:
    most of them or, where `limbs` count, a few."""
    moved = np.linalg.norm(np.diff(points_px, axis=0), axis=-1)
    if limbs:
        known = np.where(np.isfinite(moved), moved, 0.0)
        fast = np.sort(known, axis=1)[:, -_FEW] > _FAST_LIMB * side[1:]
    else:
        fast = ~(row_median(moved, 1) <= _FAST * side[1:])
    return [(int(low), int(high)) for low, high in zip(at[:-1][fast], at[1:][fast], strict=True)]


def runs_of(frames: IndexArray) -> list[IndexArray]:
    """Rows (K,) of ascending frames by runs of successive ones."""
    return np.split(np.arange(len(frames)), np.flatnonzero(np.diff(frames) != 1) + 1)


def enough_rows(frames: IndexArray, points_px: FloatArray, boxes_px: FloatArray, every: int) -> BoolArray:
    """(K,) which of a person's frames have to be read: every n-th of a run, its last, and all where they move fast.

    Args:
        frames: (K,) ascending.
        points_px: (K, J, 2) where the landmarks are about.
        boxes_px: (K, 4).
        every: n.
    """
    chosen = np.full(len(frames), every == 1)
    side = (boxes_px[:, 2:] - boxes_px[:, :2]).max(axis=1)
    for run in runs_of(frames) if every > 1 else ():
        at = np.unique(np.append(run[::every], run[-1]))
        chosen[at] = True
        for low, high in fast_gaps(at, points_px[at], side[at], limbs=True):
            chosen[low:high] = True
    return chosen


def scatter_poses(poses: Poses, at: BoolArray, boxes_px: FloatArray) -> Poses:
    """Poses of the rows `at` (K,) among empty ones, for boxes (K, 4)."""

    def spread(values: FloatArray) -> FloatArray:
        out = np.zeros((len(at), *values.shape[1:]))
        out[at] = values
        return out

    landmarks = {name: each.map(lambda _, a: spread(a)) for name, each in poses.landmarks.items()}
    return replace(poses, landmarks=landmarks, boxes_px=boxes_px)


def interpolate_poses(poses: Poses, rows: IndexArray, known: BoolArray) -> None:
    """Fill in, in place, a track's poses (rows) between those that are `known`, the first and the last among them."""
    at = np.flatnonzero(known)
    gaps = np.flatnonzero(~known)
    after = np.searchsorted(at, gaps)
    low, high = at[after - 1], at[after]
    share = (gaps - low) / np.maximum(high - low, 1)
    for landmarks in poses.landmarks.values():
        points, variance, score = landmarks.points_px, landmarks.variance_px2, landmarks.score
        points[rows[gaps]] += (1 - share)[:, None, None] * points[rows[low]] + share[:, None, None] * points[rows[high]]
        variance[rows[gaps]] = np.maximum(variance[rows[low]], variance[rows[high]])
        score[rows[gaps]] = np.minimum(score[rows[low]], score[rows[high]])
        there = np.isfinite(points[rows[gaps]]).all(-1)
        score[rows[gaps]] *= there
        variance[rows[gaps]] = np.where(there, variance[rows[gaps]], np.nan)
        if landmarks.visibility is not None:
            landmarks.visibility[rows[gaps]] = np.minimum(
                landmarks.visibility[rows[low]], landmarks.visibility[rows[high]]
            )
