"""`timestamps.csv`: when each frame of each video was taken, as written by recorders of several webcams.

Such cameras drop frames and do not start together, so that frame numbers do not tell the time. The columns are
`sync_index` (the moment that a frame belongs to), `cam_id` (the camera: a video's name, or the number at its end) and
`frame_time` (seconds of one common clock), with one row per frame.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from reprlib import repr as shorten

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import MuybridgeError, SessionError, parsing
from muybridge.infer.session.probe import VideoInfo

# Names of the file; the second is that of older recordings.
TIMESTAMPS = ("timestamps.csv", "frame_time_history.csv")
_COLUMNS = "it needs the columns sync_index, cam_id, frame_time (finite numbers), a row per frame"
_LATEST_S = 1e13  # since 1970, in milliseconds too
_LAST_MOMENT = 2**62  # some count moments in nanoseconds since 1970
_SPREAD, _FEW = 100, 10_000  # a take of more moments, per frame of its shortest video, has damaged times


def read_time_table(
    path: Path, videos: Sequence[VideoInfo], error: type[MuybridgeError]
) -> list[tuple[FloatArray, IntArray]]:
    """Time (seconds) and moment of every frame of the videos, in the videos' order.

    Args:
        path: of the table.
        videos: that the rows are of.
        error: raised where the table cannot be read or does not fit the videos.
    """
    with parsing(path, error, "a table of time stamps"):
        return _read_time_table(path, videos, error)


def _read_time_table(
    path: Path, videos: Sequence[VideoInfo], error: type[MuybridgeError]
) -> list[tuple[FloatArray, IntArray]]:
    rows: dict[str, list[tuple[float, int]]] = {}
    with path.open(newline="", encoding="utf-8-sig") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            camera, time, moment = _row(row, f"{path}: line {line}", error)
            rows.setdefault(camera, []).append((time, moment))
    out = []
    for video in videos:
        stem = video.path.stem
        key = stem if stem in rows else "".join(re.findall(r"\d+$", stem)).lstrip("0") or "0"
        if key not in rows:
            raise error(f"{path}: no rows for {stem}; it has cam_id {', '.join(sorted(rows))}")
        if len(rows[key]) != video.frames:
            raise error(
                f"{path}: {len(rows[key])} rows for {stem}, whose video has {video.frames} frames; they must match"
            )
        times, moments = zip(*sorted(rows[key]), strict=True)
        out.append((np.array(times), np.array(moments)))
    return out


def _row(row: Mapping[str, str | None], where: str, error: type[MuybridgeError]) -> tuple[str, float, int]:
    """Camera, time and moment of a row."""
    camera = row.get("cam_id") or row.get("port") or row.get("camera")
    if camera is None:
        raise error(f"{where} names no camera in a column cam_id; {_COLUMNS}")
    texts = row.get("frame_time"), row.get("sync_index")
    try:
        time, moment = float(texts[0] or ""), int(texts[1] or "")
    except ValueError:
        time, moment = np.nan, 0
    if not (abs(time) < _LATEST_S and abs(moment) < _LAST_MOMENT):
        raise error(f"{where} has frame_time {shorten(texts[0])} and sync_index {shorten(texts[1])}; {_COLUMNS}")
    return camera.strip(), time, moment


def time_table_in(folder: Path) -> Path | None:
    """The table in a folder; None where there is none."""
    return next((folder / name for name in TIMESTAMPS if (folder / name).is_file()), None)


def paired_by_time(path: Path, videos: Sequence[VideoInfo]) -> tuple[float, IntArray, FloatArray, list[str]]:
    """The time line of a take by its table of time stamps.

    The take runs from the first to the last time that all videos cover, in even steps of the slowest video's usual one.

    Returns:
        frames per second; (C, T) the frame of every video at each time; (C, T) seconds by which it was taken later; and
        notices.

    Raises:
        SessionError: a table that does not fit the videos, or videos that were not taken at the same time.
    """
    times = [time for time, _ in read_time_table(path, videos, SessionError)]
    if min(len(t) for t in times) < 2:
        raise SessionError(f"{path}: a video has one frame: the frame rate of the take cannot be determined")
    step = max(float(np.median(np.diff(t))) for t in times)
    begin, end = max(t[0] for t in times), min(t[-1] for t in times)
    if end < begin or step <= 0:
        raise SessionError(f"{path}: the videos were not taken at the same time; is it another take's table?")
    if (end - begin) / step > _SPREAD * min(len(t) for t in times) + _FEW:
        raise SessionError(f"{path}: its times span {end - begin:.4g} s in steps of {step:.4g} s, more than the "
                           "videos have frames; is a time damaged?")  # fmt: skip
    grid = begin + step * np.arange(int((end - begin) / step + 0.5) + 1)
    at = [nearest(t, grid) for t in times]
    late = np.stack([t[k] - grid for t, k in zip(times, at, strict=True)])
    notice = (
        f"frames are paired by {path.name}: {len(grid)} moments at {1 / step:.4g} fps, a frame is off its moment by "
        f"{1000 * np.abs(late).max():.0f} ms at most, and its landmarks are interpolated"
    )
    return 1 / step, np.stack(at), late, [notice]


def nearest(times: FloatArray, grid: FloatArray) -> IntArray:
    """Index of the time nearest to each grid point; both sorted, so the result never decreases."""
    if len(times) < 2:
        return np.zeros(len(grid), dtype=np.int64)
    right = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    nearer_left = np.abs(grid - times[right - 1]) <= np.abs(times[right] - grid)
    return np.asarray(np.where(nearer_left, right - 1, right), dtype=np.int64)
