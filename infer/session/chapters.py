"""The video of a camera that has a folder of its own: one file, or the chapters into which its recorder split it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import av
import av.error

from muybridge.errors import SessionError
from muybridge.infer.session.pairing import natural_key

# A file of one of these kinds that cannot be opened is a broken video; any other is something else.
VIDEO_SUFFIXES = frozenset(
    ".mp4 .m4v .mov .avi .mkv .webm .mpg .mpeg .mts .m2ts .ts .mxf .wmv .flv .3gp .h264 .hevc".split()
)

# GoPro: GX010012.MP4, GX020012.MP4 are chapters 1 and 2 of recording 0012; earlier ones GOPR0012.MP4, GP010012.MP4.
_GOPRO = re.compile(r"G[HXLS](?P<chapter>\d\d)(?P<recording>\d{4})", re.IGNORECASE)
_GOPRO_BEFORE = re.compile(r"G(?:OPR|P(?P<chapter>\d\d))(?P<recording>\d{4})", re.IGNORECASE)
# Recorders that number their files state when each began: the next one then begins where the last one ends, to seconds.
_CONTINUES_S = 2.5


def camera_videos(folder: Path) -> list[Path]:
    """The video files in a camera's own folder and in folders there, as memory cards have them, in natural order."""
    files = [p for p in folder.rglob("*") if p.suffix.lower() in VIDEO_SUFFIXES and p.is_file()]
    hidden = [p for p in files if any(part.startswith(".") for part in p.relative_to(folder).parts)]
    return sorted((p for p in files if p not in hidden), key=lambda p: natural_key(str(p.relative_to(folder))))


def recorded_order(folder: Path, videos: Sequence[Path]) -> tuple[Path, ...]:
    """A camera's files in the order in which they were recorded.

    Args:
        folder: the camera's, for messages.
        videos: its files, in natural order.

    Raises:
        SessionError: they are not chapters of one recording, or one is missing.
    """
    if len(videos) == 1:
        return tuple(videos)
    names = ", ".join(video.name for video in videos)
    for pattern in (_GOPRO, _GOPRO_BEFORE):
        matches = [pattern.fullmatch(video.stem) for video in videos]
        found = {int(m["chapter"] or 0): video for m, video in zip(matches, videos, strict=True) if m}
        if all(matches) and len({m["recording"] for m in matches if m}) == 1 and len(found) == len(videos):
            first = 1 if pattern is _GOPRO else 0
            lost = sorted(set(range(first, max(found) + 1)) - found.keys())
            if lost:
                raise SessionError(
                    f"{folder} has {names}: chapter {lost[0]} of this recording is missing; copy it from the card too"
                )
            return tuple(found[number] for number in sorted(found))
    if _continue(videos):
        return tuple(videos)
    raise SessionError(
        f"{folder} has {len(videos)} videos ({names}), which are not chapters of one recording: leave the one of this "
        "take there, or join them first (ffmpeg -f concat -safe 0 -i LIST.txt -c copy OUT.mp4)"
    )


def _continue(videos: Sequence[Path]) -> bool:
    """Whether each file begins, by its own word, where the one before ends."""
    spans = [_span(video) for video in videos]
    return all(
        a is not None and b is not None and b[0] > a[0] and abs(b[0] - a[1]) < _CONTINUES_S
        for a, b in zip(spans, spans[1:], strict=False)
    )


def _span(video: Path) -> tuple[float, float] | None:
    """When a recording began and ended, seconds; None where the file does not say."""
    try:
        with av.open(str(video)) as container:
            begin = datetime.fromisoformat(container.metadata["creation_time"]).timestamp()
            return begin, begin + (container.duration or 0) / av.time_base
    except (av.error.FFmpegError, OSError, KeyError, ValueError):
        return None
