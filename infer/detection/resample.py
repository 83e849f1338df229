"""2D landmarks at the take's moments, where a camera's pictures were taken at others.

A take runs in even steps. Where cameras have other rates, a varying one or a table of times, each moment has the
picture that is nearest in time, up to half a step off. And films of a varying rate that were converted to an even one,
as phones and recorders of webcams do, repeat pictures: they show where somebody was. At 5 m/s a thirtieth of a second
is 17 cm. So a camera's landmarks are put between those of its own pictures before cameras are compared.
"""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from muybridge.geometry.numerics.robust import row_median
from muybridge.infer.detection.tracks import CameraTracks, missing_value
from muybridge.infer.session.session import Session

# Pictures are compared by the means of squares of so many pixels: alike if none differs by more, of 255. An arm that
# moves by a pixel changes as much.
_BLOCK_PX, _ALIKE = 8, 12
# Who moves between two new pictures and has gone less of the way in those that look alike stood still there. What is
# taken for people and is not jumps about, and tells nothing.
_STOOD = 0.3
# Pictures so far apart, in seconds and in steps of the take, have landmarks between them: 18 mm off at 10 m/s^2.
_MOST_S, _MOST_STEPS = 0.12, 1.5
# What lies between pictures farther apart is missing where somebody moved by more, in sides of their box.
_STILL = 0.01
# A picture is as good as the moment's own, in steps, and near enough to learn from.
_EXACT, _ON_TIME = 0.02, 0.25
# A film hangs to its end where its last pictures are alike for so long, in seconds, and everybody whom the other
# cameras have goes by so many sides of their box meanwhile.
_HANGS_S, _GOES = 0.4, 0.15
# From so many frames on, and such a share of them, it is said that a film repeats pictures.
_TOLD, _TOLD_SHARE = 5, 0.04


class Repeats:
    """Tells which of a film's frames, given in order, show the picture before once more.

    A repeated picture is not the same to the bit once a film is encoded. So they are compared coarsely, and with the
    last new one, that what moves slowly is new at some time.
    """

    def __init__(self) -> None:
        self._last: ByteArray | None = None
        self._told: list[bool] = []

    def see(self, frame: ByteArray) -> None:
        """Looks at the next frame, (H, W, 3)."""
        height, width = (max(1, side // _BLOCK_PX) for side in frame.shape[:2])
        coarse = np.asarray(cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        same = self._last is not None and int(cv2.absdiff(coarse, self._last).max()) <= _ALIKE
        self._told.append(same)
        self._last = self._last if same else coarse

    @property
    def alike_from(self) -> int:
        """The frame from which all are the one before once more, up to the last; how many there are if none is."""
        told = np.array(self._told, dtype=np.bool_)
        return int(len(told) - np.argmin(np.append(told[::-1], False)))

    def confirmed(self, tracks: CameraTracks) -> BoolArray:
        """(T,) which of the frames seen so far are repeated while somebody moves. None are if people moved in them:
        then the pictures are only alike, dark or flat as they are. Nor are any if nobody tells.

        Args:
            tracks: what was found in the T frames.
        """
        told = np.array(self._told, dtype=np.bool_)
        low, high = _pictures_around(~told)
        same = (tracks.ids == tracks.ids[low]) & (tracks.ids == tracks.ids[high])
        way, gone = (
            tracks.body.points_px[high] - tracks.body.points_px[low],
            tracks.body.points_px - tracks.body.points_px[low],
        )
        # Of most landmarks: one that jumps is no movement.
        moved = row_median(np.linalg.norm(way, axis=-1)) / _side(tracks, low)
        telling = same & told[:, None] & (moved > _STILL)
        known = np.isfinite(way + gone)
        along, whole = (np.where(known, each * way, 0.0).sum((2, 3)) for each in (gone, way))
        share = (np.arange(len(told)) - low) / np.maximum(high - low, 1)
        ratio = along / np.maximum(share[:, None] * whole, 1e-9)
        slots = [slot for slot in range(same.shape[1]) if telling[:, slot].sum() >= _TOLD]
        if not any(np.median(ratio[telling[:, slot], slot]) < _STOOD for slot in slots):
            return np.zeros_like(told)
        return np.asarray(told & (same & (_moved(tracks, low, high) > _STILL)).any(1))


def _pictures_around(new: BoolArray) -> tuple[IndexArray, IndexArray]:
    """(T,) the last new picture up to each frame, the first of which is new, and the first after that; the last of all
    again where none is."""
    pictures = np.flatnonzero(new)
    last = np.cumsum(new) - 1
    return pictures[last], pictures[np.minimum(last + 1, len(pictures) - 1)]


def frozen(found: Sequence[CameraTracks], alike_from: Sequence[int], fps: float) -> list[int | None]:
    """The frame from which each film hangs to its end, None where it does not: pictures that are alike may be of
    somebody who stands still, but not while everybody moves whom another camera has.

    Args:
        found: what each camera found.
        alike_from: of each, `Repeats.alike_from`.
        fps: frames a second.
    """
    ends = [len(tracks.body.points_px) for tracks in found]
    hung: list[int | None] = []
    for c, start in enumerate(alike_from):
        others = [
            _all_went(found[o], start, min(ends[c], alike_from[o]))
            for o in range(len(found))
            if o != c and min(ends[c], alike_from[o]) - start >= _HANGS_S * fps
        ]
        told = 0 < start < ends[c] and True in others and False not in others
        hung.append(start if told else None)
    return hung


def _all_went(tracks: CameraTracks, start: int, end: int) -> bool | None:
    """Whether everybody whom a camera has in a frame moves from there up to another; None if nobody is there."""
    low = np.full(end - start, start)
    moved = _moved(tracks, low, np.arange(start, end))
    farthest = np.where(np.isfinite(moved), moved, 0.0).max(0)
    there = tracks.ids[start] >= 0
    return bool((farthest[there] > _GOES).all()) if there.any() else None


def on_time(session: Session, c: int, repeats: BoolArray) -> BoolArray:
    """(T,) in which of the take's frames, of which `repeats` has all that the camera had, people are where they are at
    that moment."""
    late = 0.0 if session.late is None else session.late[c, : len(repeats)] * session.fps
    return np.asarray(~repeats[: session.frame_indices.shape[1]] & (np.abs(late) <= _ON_TIME))


def in_time(session: Session, c: int, tracks: CameraTracks, repeats: BoolArray) -> CameraTracks:
    """A camera's tracks at the take's moments.

    Args:
        session: says which frames they are of, and how late these were taken.
        c: the camera.
        tracks: of the session's first T frames, as the pictures show them.
        repeats: (T,) or more, which frames are the one before once more.

    Returns:
        the same, linearly between two pictures that show the same person, as they are before the first and after the
        last picture, and else those of a picture within half a step. Nobody is where there is no such picture, or where
        two are far apart and they moved.
    """
    count = len(tracks.body.points_px)
    steps = np.arange(count)
    at = steps + (session.late[c, :count] * session.fps if session.late is not None else 0.0)
    index = session.frame_indices[c, :count]
    new = np.append(True, index[1:] != index[:-1])[:count] & ~(repeats[:count] & (steps > 0))
    if new.all() and np.abs(at - steps).max(initial=0.0) < _EXACT:
        return tracks
    pictures = np.flatnonzero(new)
    last = np.searchsorted(at[pictures], steps + _EXACT, side="right") - 1
    low, high = (pictures[np.clip(last + k, 0, len(pictures) - 1)] for k in (0, 1))
    apart = at[high] - at[low]
    share = np.clip((steps - at[low]) / np.where(apart > 0, apart, 1.0), 0.0, 1.0)
    share[(apart <= 0) | (np.abs(steps - at[low]) < _EXACT)] = 0.0
    nearer = np.where(share > 0.5, high, low)
    outside = (last < 0) | (last == len(pictures) - 1)
    # What is told to repeat the last picture hangs: it shows nothing of that moment.
    near = (np.abs(steps - at[nearer]) <= 0.5 + _EXACT) | (outside & ~repeats[:count])
    between = (tracks.ids[low] == tracks.ids[high]) & (apart > 0)[:, None] & (share > 0)[:, None]
    far = apart > max(_MOST_S * session.fps, _MOST_STEPS)
    between &= ~(far[:, None] & (_moved(tracks, low, high) > _STILL))
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


def _moved(tracks: CameraTracks, low: IndexArray, high: IndexArray) -> FloatArray:
    """(n, P) how far people moved from frames `low` (n,) to `high` (n,), in sides of their box: the mean of what moved
    and what did not; infinite where they are not in both."""
    away = np.linalg.norm(tracks.body.points_px[high] - tracks.body.points_px[low], axis=-1)
    there = np.isfinite(away)
    mean = np.where(there, away, 0.0).sum(-1) / np.maximum(there.sum(-1), 1) / _side(tracks, low)
    return np.where(there.any(-1) & np.isfinite(mean), mean, np.inf)


def _side(tracks: CameraTracks, frames: IndexArray) -> FloatArray:
    """(n, P) the longer side of people's boxes in these frames, px; NaN where nobody is."""
    boxes = tracks.boxes_px[frames]
    return np.asarray((boxes[..., 2:] - boxes[..., :2]).max(-1))


def repeats_notice(session: Session, c: int, repeats: BoolArray) -> str | None:
    """What is said of a film some of whose pictures, `repeats` (T,) or more, are shown once more; None of others."""
    index = session.frame_indices[c, : len(repeats)]
    repeats = repeats[: len(index)]
    # Those that the session repeats have been said.
    count = int((repeats & np.append(True, index[1:] != index[:-1])).sum())
    if count < max(_TOLD, _TOLD_SHARE * len(repeats)):
        return None
    return (
        f"{session.videos[c].path.name} shows the picture before once more in {count} of {len(repeats)} "
        "frames while somebody moves (a varying rate that was converted to an even one, or a camera that hung): "
        f"landmarks are put between those of its own pictures, and left out where these are over {_MOST_S:g} s apart"
    )
