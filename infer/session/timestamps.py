"""`timestamps.csv`: when each frame of each film was taken, as recorders of several webcams write it.

Such cameras drop frames and do not start together, so that the number of a frame says little. The columns are
`sync_index` (the moment that a frame belongs to), `cam_id` (the camera: a film's name, or the number at its end) and
`frame_time` (seconds, of one clock for all); a row a frame.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import MuybridgeError, SessionError
from muybridge.infer.session.probe import VideoInfo

# What the file is called; the second name is that of older recordings.
TIMESTAMPS = ("timestamps.csv", "frame_time_history.csv")


def read_time_table(
    path: Path, films: Sequence[VideoInfo], error: type[MuybridgeError]
) -> list[tuple[FloatArray, IntArray]]:
    """Time (seconds) and moment of every frame of the films, in the films' order.

    Args:
        path: of the table.
        films: what the rows are of.
        error: what is raised where it cannot be read or does not fit the films.
    """
    rows: dict[str, list[tuple[float, int]]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for line, row in enumerate(csv.DictReader(file), start=2):
                camera = row.get("cam_id") or row.get("port") or row.get("camera")
                if camera is None:
                    raise ValueError(f"line {line} names no camera in a column cam_id")
                time = float(row["frame_time"])
                if not np.isfinite(time):
                    raise ValueError(f"line {line} has no time in the column frame_time")
                rows.setdefault(camera.strip(), []).append((time, int(row["sync_index"])))
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise error(
            f"{path}: cannot be read ({problem}); it needs the columns sync_index, cam_id, frame_time, a row a frame"
        ) from None
    out = []
    for film in films:
        stem = film.path.stem
        key = stem if stem in rows else "".join(re.findall(r"\d+$", stem)).lstrip("0") or "0"
        if key not in rows:
            raise error(f"{path}: no rows for {stem}; it has cam_id {', '.join(sorted(rows))}")
        if len(rows[key]) != film.frames:
            raise error(
                f"{path}: {len(rows[key])} rows for {stem}, whose film has {film.frames} frames; they must match"
            )
        times, moments = zip(*sorted(rows[key]), strict=True)
        out.append((np.array(times), np.array(moments)))
    return out


def time_table_in(folder: Path) -> Path | None:
    """The table in a folder; None where there is none."""
    return next((folder / name for name in TIMESTAMPS if (folder / name).is_file()), None)


def paired_by_time(path: Path, films: Sequence[VideoInfo]) -> tuple[float, IntArray, FloatArray, list[str]]:
    """Frames a second of the take, the frame (C, T) of every film at each of its moments, how many seconds (C, T) after
    the moment it was taken, and what was done.

    The take runs from the first to the last moment that all films know, in even steps of the slowest film's usual one.

    Raises:
        SessionError: a table that does not fit the films, or films that were not taken at the same time.
    """
    times = [time for time, _ in read_time_table(path, films, SessionError)]
    if min(len(t) for t in times) < 2:
        raise SessionError(f"{path}: a film has one frame: how fast the take runs cannot be told")
    step = max(float(np.median(np.diff(t))) for t in times)
    begin, end = max(t[0] for t in times), min(t[-1] for t in times)
    if end < begin or step <= 0:
        raise SessionError(f"{path}: the films were not taken at the same time; is it another take's table?")
    grid = begin + step * np.arange(int((end - begin) / step + 0.5) + 1)
    at = [nearest(t, grid) for t in times]
    late = np.stack([t[k] - grid for t, k in zip(times, at, strict=True)])
    said = (
        f"frames are paired by {path.name}: {len(grid)} moments at {1 / step:.4g} fps, a frame is off its moment by "
        f"{1000 * np.abs(late).max():.0f} ms at most, and its landmarks are put there"
    )
    return 1 / step, np.stack(at), late, [said]


def nearest(times: FloatArray, grid: FloatArray) -> IntArray:
    """Index of the time nearest to each grid point; both sorted, so the result never decreases."""
    if len(times) < 2:
        return np.zeros(len(grid), dtype=np.int64)
    right = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    nearer_left = np.abs(grid - times[right - 1]) <= np.abs(times[right] - grid)
    return np.asarray(np.where(nearer_left, right - 1, right), dtype=np.int64)
