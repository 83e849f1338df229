"""Frames of a video that repeat the one before: of converted videos of a varying rate, and of cameras that froze."""

from collections.abc import Sequence

import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from muybridge.geometry.numerics.robust import row_median
from muybridge.infer.detection.tracks import CameraTracks
from muybridge.infer.session.frame_copies import halved_to
from muybridge.infer.session.session import Session

# Longest interval (seconds) over which landmarks are interpolated: at 10 m/s^2 the error is 18 mm.
LONGEST_GAP_S = 0.12
# Displacement, in sides of the box, up to which a person stands still.
STILL = 0.01
# Frames are compared by their mean colour in blocks of so many pixels: they look the same if no block differs by more,
# of 255. An arm that moves by a pixel changes as much.
_BLOCK_PX, _SAME = 8, 12
# Somebody who moves between two new frames and has covered a smaller share of the way in frames that look the same
# stood still there. False detections jump about and are no evidence.
_STOOD_STILL = 0.3
# A video is frozen to its end if its last frames look the same for so long, in seconds, while everybody whom the other
# cameras see moves by so many sides of their box.
_FROZEN_S, _FROZEN_MOVEMENT = 0.4, 0.15
# Repeated frames are reported from so many on, and from such a share of all frames.
_REPORTED, _REPORTED_SHARE = 5, 0.04


class RepeatedFrames:
    """Finds the frames of a video, given in order, that repeat the one before.

    Encoding changes the bits of a repeated frame. So frames are compared coarsely, and with the last new one, so that
    slow movements become visible.
    """

    def __init__(self, width: int, height: int) -> None:
        """For frames of a video of `width` x `height` px, which may be given at a smaller size."""
        self._grid = max(1, width // _BLOCK_PX), max(1, height // _BLOCK_PX)
        self._last: ByteArray | None = None
        self._repeats: list[bool] = []

    def add(self, frame: ByteArray) -> None:
        """Compare the next frame, (H, W, 3), of the video's size or scaled down."""
        small = halved_to(frame, max(self._grid))
        coarse = np.asarray(cv2.resize(small, self._grid, interpolation=cv2.INTER_AREA), np.uint8)
        same = self._last is not None and int(cv2.absdiff(coarse, self._last).max()) <= _SAME
        self._repeats.append(same)
        self._last = self._last if same else coarse

    def among_last(self, count: int) -> bool:
        """Whether any of the last `count` frames repeats the one before."""
        return any(self._repeats[-count:])

    @property
    def still_from(self) -> int:
        """The frame from which all to the end repeat the one before; the number of frames if none do."""
        repeats = np.array(self._repeats, dtype=np.bool_)
        return int(len(repeats) - np.argmin(np.append(repeats[::-1], False)))

    def confirmed(self, tracks: CameraTracks) -> BoolArray:
        """(T,) which of the frames so far are repeats while somebody moves.

        None if people moved in them, because then the frames only look the same (dark or flat images), and none if no
        person provides evidence.

        Args:
            tracks: of the T frames.
        """
        repeats = np.array(self._repeats, dtype=np.bool_)
        low, high = _new_frames_around(~repeats)
        same = (tracks.ids == tracks.ids[low]) & (tracks.ids == tracks.ids[high])
        way, gone = (
            tracks.body.points_px[high] - tracks.body.points_px[low],
            tracks.body.points_px - tracks.body.points_px[low],
        )
        # The median over landmarks: a single jumping one is no movement.
        moved = row_median(np.linalg.norm(way, axis=-1)) / _box_side(tracks, low)
        telling = same & repeats[:, None] & (moved > STILL)
        known = np.isfinite(way + gone)
        along, whole = (np.where(known, each * way, 0.0).sum((2, 3)) for each in (gone, way))
        share = (np.arange(len(repeats)) - low) / np.maximum(high - low, 1)
        ratio = along / np.maximum(share[:, None] * whole, 1e-9)
        slots = [slot for slot in range(same.shape[1]) if telling[:, slot].sum() >= _REPORTED]
        if not any(np.median(ratio[telling[:, slot], slot]) < _STOOD_STILL for slot in slots):
            return np.zeros_like(repeats)
        return np.asarray(repeats & (same & (displacement(tracks, low, high) > STILL)).any(1))


def _new_frames_around(new: BoolArray) -> tuple[IndexArray, IndexArray]:
    """(T,) the last new frame up to each frame, the first of which is new, and the next new one (the last one where
    there is none)."""
    at = np.flatnonzero(new)
    last = np.cumsum(new) - 1
    return at[last], at[np.minimum(last + 1, len(at) - 1)]


def find_frozen(found: Sequence[CameraTracks], still_from: Sequence[int], fps: float) -> list[int | None]:
    """The frame from which each video is frozen to its end; None where it is not.

    Frames that look the same may show somebody who stands still, but not while
    everybody moves in another camera's view.

    Args:
        found: each camera's tracks.
        still_from: of each, `RepeatedFrames.still_from`.
        fps: frames per second.
    """
    ends = [len(tracks.body.points_px) for tracks in found]
    starts: list[int | None] = []
    for c, start in enumerate(still_from):
        others = [
            _all_moved(found[o], start, min(ends[c], still_from[o]))
            for o in range(len(found))
            if o != c and min(ends[c], still_from[o]) - start >= _FROZEN_S * fps
        ]
        is_frozen = 0 < start < ends[c] and True in others and False not in others
        starts.append(start if is_frozen else None)
    return starts


def _all_moved(tracks: CameraTracks, start: int, end: int) -> bool | None:
    """Whether everybody whom a camera sees in frame `start` moves before frame `end`; None if nobody is there."""
    low = np.full(end - start, start)
    moved = displacement(tracks, low, np.arange(start, end))
    farthest = np.where(np.isfinite(moved), moved, 0.0).max(0)
    there = tracks.ids[start] >= 0
    return bool((farthest[there] > _FROZEN_MOVEMENT).all()) if there.any() else None


def displacement(tracks: CameraTracks, low: IndexArray, high: IndexArray) -> FloatArray:
    """(n, P) mean displacement of people's landmarks from frames `low` (n,) to `high` (n,), in sides of their box;
    infinite where they are not in both."""
    away = np.linalg.norm(tracks.body.points_px[high] - tracks.body.points_px[low], axis=-1)
    there = np.isfinite(away)
    mean = np.where(there, away, 0.0).sum(-1) / np.maximum(there.sum(-1), 1) / _box_side(tracks, low)
    return np.where(there.any(-1) & np.isfinite(mean), mean, np.inf)


def _box_side(tracks: CameraTracks, frames: IndexArray) -> FloatArray:
    """(n, P) longer side of people's boxes in these frames, px; NaN where nobody is."""
    boxes = tracks.boxes_px[frames]
    return np.asarray((boxes[..., 2:] - boxes[..., :2]).max(-1))


def repeats_notice(session: Session, c: int, repeats: BoolArray) -> str | None:
    """A notice about a video with many repeated frames; None for others.

    Args:
        session: its videos.
        c: the camera.
        repeats: (T,) or more, which frames repeat the one before.
    """
    index = session.frame_indices[c, : len(repeats)]
    repeats = repeats[: len(index)]
    # Frames that the session itself repeats are reported elsewhere.
    count = int((repeats & np.append(True, index[1:] != index[:-1])).sum())
    if count < max(_REPORTED, _REPORTED_SHARE * len(repeats)):
        return None
    return (
        f"{session.videos[c].path.name} repeats the frame before in {count} of {len(repeats)} frames "
        "while somebody moves (a varying frame rate converted to an even one, or a camera that froze): landmarks are "
        f"interpolated between its own frames, and left out where these are over {LONGEST_GAP_S:g} s apart"
    )
