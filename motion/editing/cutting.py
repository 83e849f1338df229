"""Cutting a clip, and putting clips one behind the other."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.editing.channels import T, check_editable, duration, frame_count, select_frames


def trim_frames(thing: Motion | Points3D, start: float = 0.0, end: float | None = None) -> tuple[int, int]:
    """First frame that `trim` keeps, and the frame after the last.

    Raises:
        MuybridgeError: the clip has no such frames.
    """
    check_editable(thing)
    count, last = frame_count(thing), duration(thing)
    end = last if end is None else end
    a, b = round(start * thing.fps), round(end * thing.fps)
    if a < 0:
        raise MuybridgeError(f"the clip begins at 0 s, after {start:g} s")
    if b > count:
        raise MuybridgeError(f"the clip ends at {last:g} s, before {end:g} s; without an end, all to its end is kept")
    if a >= count:
        raise MuybridgeError(f"the clip ends at {last:g} s, so no frame is left from {start:g} s on")
    if b <= a:
        raise MuybridgeError(f"no frame is left from {start:g} to {end:g} s: the end must be later than the start")
    return a, b


def trim(thing: T, start: float = 0.0, end: float | None = None) -> T:
    """Keep the frames from `start` up to `end`, so that clips cut at one time can be joined again.

    Args:
        thing: a motion or points.
        start: seconds from the beginning.
        end: seconds from the beginning; the frame at this time is the first that is left out. None: all to the end.

    Raises:
        MuybridgeError: the clip has no such frames.
    """
    a, b = trim_frames(thing, start, end)
    return select_frames(thing, slice(a, b))


def join(clips: Sequence[Motion]) -> Motion:
    """Clips of one skeleton, one behind the other, as they are: nothing is blended.

    Raises:
        MuybridgeError: there is none, or they differ in frame rate or skeleton.
    """
    if not clips:
        raise MuybridgeError("there are no clips to join")
    first = clips[0]
    for k, clip in enumerate(clips[1:], start=2):
        if not np.isclose(clip.fps, first.fps, rtol=1e-6):
            raise MuybridgeError(f"clip {k} has {clip.fps:g} frames/s and the first {first.fps:g}: resample one")
        one, other = clip.skeleton, first.skeleton
        if one.names != other.names or one.parents != other.parents or one.sliding != other.sliding:
            raise MuybridgeError(f"clip {k} has other joints than the first")
        if not np.allclose(one.offsets, other.offsets, atol=1e-6):
            raise MuybridgeError(f"clip {k} has bones of other lengths than the first")
    slides = [clip.translations for clip in clips if clip.translations is not None]
    return replace(
        first,
        root_positions_world=np.concatenate([clip.root_positions_world for clip in clips]),
        quat_wxyz=continuous_quat(np.concatenate([clip.quat_wxyz for clip in clips])),
        translations=np.concatenate(slides) if slides else None,
    )
