"""Frames of a video that FFmpeg decoded from damaged data.

Where a few bits of a recording are wrong, decoders put pieces of neighbouring frames in place of what they cannot read
and go on. Such frames carry a flag; frames that are predicted from them are as wrong without one, up to the next frame
that stands alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from muybridge.arrays import BoolArray, IntArray
from muybridge.infer.session.probe import VideoInfo

# Ranges of frames that a sentence lists.
_LISTED = 6


class DamageWatch:
    """Collects what the decoder says of a video's frames, given in order."""

    def __init__(self, info: VideoInfo) -> None:
        self._info = info
        self._corrupt = np.zeros(info.frames, dtype=np.bool_)

    def see(self, index: int, frame: Any) -> None:
        """Note the decoded frame (an `av.VideoFrame`) of this number."""
        if frame.is_corrupt and index < len(self._corrupt):
            self._corrupt[index] = True

    def damaged(self) -> BoolArray:
        """(frames,) which frames of the video are damaged, as far as it was decoded."""
        return spread(self._corrupt, self._info.coded_at, self._info.stands_alone)


def spread(corrupt: BoolArray, coded_at: IntArray, stands_alone: BoolArray) -> BoolArray:
    """(F,) the corrupt frames and those that are predicted from them, directly or not.

    Args:
        corrupt: (F,) in the order in which frames are shown.
        coded_at: (F,) the place of each among all frames in the order in which they are decoded.
        stands_alone: (F,) whether decoding can begin with it.
    """
    damaged = corrupt.copy()
    shown = np.arange(len(corrupt))
    alone = np.flatnonzero(stands_alone)
    for at in np.flatnonzero(corrupt):
        later = alone[coded_at[alone] > coded_at[at]]
        # Frames that are decoded after the next one that stands alone and shown before it may lean on both sides.
        end = later[np.argmin(coded_at[later])] if len(later) else len(corrupt)
        damaged |= (coded_at >= coded_at[at]) & (shown < end)
    return damaged


def frame_ranges(frames: BoolArray) -> str:
    """The true ones of (F,) frames in words: `frame 3`, `frames 12 to 20`, `frames 3, 12 to 20 and 40`."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], frames, [False]]).astype(np.int8)))
    parts = [f"{a}" if b - a == 1 else f"{a} to {b - 1}" for a, b in edges.reshape(-1, 2)]
    if len(parts) > _LISTED:
        parts = [*parts[: _LISTED - 1], f"{len(parts) - _LISTED + 1} more places"]
    listed = " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)
    return f"frame{'s' if frames.sum() > 1 else ''} {listed}"


def damage_notice(name: str, damaged: BoolArray) -> str | None:
    """A sentence about the damaged frames of a video; None where there are none.

    Args:
        name: of the video.
        damaged: (F,) its frames.
    """
    count = int(damaged.sum())
    if not count:
        return None
    verb = "is" if count == 1 else "are"
    share = "" if count == 1 else f" ({count} of {len(damaged)})"
    return (
        f"{name}: {frame_ranges(damaged)}{share} {verb} damaged (decoded from broken data): nothing is read there; "
        "copy the video again from the camera"
    )
