"""Points as a table: the part that CSV and Parquet share.

One row per frame: `frame`, `time`, then three columns per landmark, `<name>_x`, `<name>_y`, `<name>_z`, in metres with
Z up. Other spellings of such columns are read too (`LASI.X`, `LASI:x`, `LASI X (mm)`, `noseX`), and so are tables with
one row per landmark and frame (`frame, name, x, y, z`).
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.common import UNIT_WORDS, check_unit, frames_of_rows, in_frames
from muybridge.motion.formats.points.world import Trajectories

# Separators begin where none is before them (or after one character): long runs of them take linear time.
_COLUMN = re.compile(
    r"^(?P<name>.+?)(?:(?:(?<![\s_.:\-/|(\[])|(?<=^.))[\s_.:\-/|(\[]+(?P<a>[xyzXYZ])|(?<=[a-z0-9])(?P<b>[XYZ]))[)\]]?"
    rf"(?:[\s_(\[]+(?P<unit>(?i:{'|'.join(UNIT_WORDS)}))[)\]]?)?$"
)
# Frames per second: what is slower has times in another unit.
_SLOWEST = 0.9
TIMES = ("time", "t", "time_s", "time(s)", "time[s]", "time (s)", "time [s]", "seconds", "timestamp")
FRAMES = ("frame", "frame#", "frames", "frame_index", "frame_number", "index", "sync_index", "fnum")
# A column's name and values.
Column = tuple[str, Sequence[Any] | NDArray[Any]]
_NAMES = ("name", "landmark", "marker", "label", "joint", "keypoint", "point", "point_name")
_ONCE = (*TIMES, *FRAMES, *_NAMES, "x", "y", "z")


def columns_of(points: Points3D) -> dict[str, FloatArray]:
    """The table's columns by name, in order."""
    xyz = points.points_world
    out: dict[str, FloatArray] = {
        "frame": np.arange(1, len(xyz) + 1, dtype=np.float64),
        "time": np.arange(len(xyz)) / points.fps,
    }
    for j, name in enumerate(points.landmarks.names):
        out |= {f"{name}_{axis}": xyz[:, j, k] for k, axis in enumerate("xyz")}
    return out


def trajectories_of(path: Path, columns: Sequence[Column], fps: float | None) -> Trajectories:
    """Points of a table.

    Args:
        path: for the message.
        columns: names and values, equally long; empty cells NaN, or texts in a column of names. Points of the same name
            may be there more than once.
        fps: frames per second; None takes them from a column of times.

    Raises:
        FormatError: no landmark has three columns, the units differ, or there is no frame rate.
    """
    lower: dict[str, Column] = {}
    for column in columns:
        key = column[0].strip().lower()
        if key in lower and key in _ONCE:
            raise _twice(path, column[0])
        lower.setdefault(key, column)
    times = next((_numbers(path, lower[k]) for k in TIMES if k in lower), None)
    if {"x", "y", "z"} <= set(lower):
        names, xyz, times = _long(path, lower, times, fps)
        units: set[str] = set()
    else:
        names, xyz, units = _wide(path, columns)
        numbers = next((_numbers(path, lower[k]) for k in FRAMES if k in lower), None)
        xyz, times = placed(path, xyz, numbers, times, fps)
    if len(units) > 1:
        raise FormatError(f"{path}: its columns have several units ({', '.join(sorted(units))}); give them one")
    if not len(xyz):
        raise FormatError(f"{path}: has a header and no row of points below; is it cut off?")
    unit = check_unit(path, units.pop(), "the unit") if units else ""
    start = 0.0 if times is None else float(np.nan_to_num(times[0]))
    return Trajectories(tuple(names), xyz, fps or rate_of(path, times), unit, "z", start)


def _twice(path: Path, name: str) -> FormatError:
    return FormatError(f"{path}: the column {name!r} appears more than once; rename one of them")


def placed(
    path: Path, xyz: FloatArray, numbers: FloatArray | None, times: FloatArray | None, fps: float | None
) -> tuple[FloatArray, FloatArray | None]:
    """Rows of points (N, ...) and their times (N,) at their frames; see `frames_of_rows`."""
    if numbers is None and times is None:
        return xyz, None
    row = frames_of_rows(path, numbers, times, fps)
    return in_frames(xyz, row), None if times is None else in_frames(times, row)


def rate_of(path: Path, times: FloatArray | None) -> float:
    """Frames per second by the times (T,) of frames, NaN where one has none.

    Raises:
        FormatError: they do not rise, or are no seconds.
    """
    known = np.nonzero(np.isfinite(times))[0] if times is not None else np.zeros(0, np.intp)
    steps = np.diff(times[known]) / np.diff(known) if times is not None else np.zeros(0)
    step = float(np.median(steps)) if len(steps) else 0.0
    if not step > 1e-6:
        raise FormatError(f"{path}: has no column of rising times, so no frame rate", remedy="fps_unstated")
    even = float(np.sum(steps * np.diff(known)) / (known[-1] - known[0]))
    fps = 1.0 / (even if abs(even - step) < 0.01 * step else step)
    if fps < _SLOWEST:
        raise FormatError(f"{path}: its times give {fps:.3g} frames per second: are they milliseconds?",
                          remedy="fps_unstated")  # fmt: skip
    return float(round(fps)) if abs(fps - round(fps)) < 1e-4 * fps else fps


def is_coordinate(column: str) -> bool:
    """Whether a column of this name holds coordinates."""
    return column.strip().lower() in ("x", "y", "z") or _COLUMN.match(column.strip()) is not None


def _numbers(path: Path, column: Column) -> FloatArray:
    name, values = column
    try:
        return np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    except (TypeError, ValueError):
        raise FormatError(f"{path}: the column {name!r} holds what is no number; empty means missing") from None


def _wide(path: Path, columns: Sequence[Column]) -> tuple[list[str], FloatArray, set[str]]:
    found: dict[str, dict[str, list[Column]]] = {}
    units: set[str] = set()
    for column in columns:
        match = _COLUMN.match(column[0].strip())
        if match is None:
            continue
        axis = (match["a"] or match["b"]).lower()
        found.setdefault(match["name"], {}).setdefault(axis, []).append(column)
        if match["unit"]:
            units.add(match["unit"].lower())
    triples: list[tuple[str, list[Column]]] = []
    for name, axes in found.items():
        counts = {axis: len(held) for axis, held in axes.items()}
        if max(counts.values()) > 1 and (len(counts) < 3 or len(set(counts.values())) > 1):
            axis, held = next((axis, held) for axis, held in axes.items() if len(held) > 1)
            if held[0][0] == held[1][0]:
                raise _twice(path, held[0][0])
            raise FormatError(f"{path}: {name!r} has two columns for {axis}; rename one of them")
        if len(counts) == 3:
            triples += [(name, list(held)) for held in zip(*(axes[axis] for axis in "xyz"), strict=True)]
    if not triples:
        raise FormatError(
            f"{path}: no landmark has columns for x, y and z; name them nose_x, nose_y, nose_z and so on in the "
            "first row"
        )
    # Twins keep their places in the file.
    places = {id(column): i for i, column in enumerate(columns)}
    triples.sort(key=lambda triple: min(places[id(column)] for column in triple[1]))
    xyz = [[_numbers(path, column) for column in held] for _, held in triples]
    return [name for name, _ in triples], np.moveaxis(np.array(xyz), -1, 0), units


def _long(
    path: Path, lower: Mapping[str, Column], times: FloatArray | None, fps: float | None
) -> tuple[list[str], FloatArray, FloatArray | None]:
    """One row per landmark and frame."""
    label = next((lower[k] for k in _NAMES if k in lower), None)
    frame = next((lower[k] for k in (*FRAMES, *TIMES) if k in lower), None)
    if label is None or frame is None:
        missing = "name" if label is None else "frame"
        raise FormatError(f"{path}: has columns x, y, z, but none called {missing}; add it")
    labels = [str(v) for v in label[1]]
    keys = _numbers(path, frame)
    if not np.isfinite(keys).all():
        raise FormatError(f"{path}: the column {frame[0]!r} has an empty cell")
    frames, of_frame = np.unique(keys, return_inverse=True)
    numbered = frame[0].strip().lower() in FRAMES
    row = frames_of_rows(path, frames if numbered else None, None if numbered else frames, fps)[of_frame]
    names = list(dict.fromkeys(labels))
    index = {name: i for i, name in enumerate(names)}
    column = np.array([index[n] for n in labels], dtype=np.intp)
    if len({*zip(row.tolist(), column.tolist(), strict=True)}) != len(row):
        raise FormatError(f"{path}: a landmark has two rows in one frame; keep one of them")
    count = int(row.max(initial=-1)) + 1
    xyz = np.full((count, len(names), 3), np.nan)
    xyz[row, column] = np.stack([_numbers(path, lower[axis]) for axis in "xyz"], axis=1)
    return names, xyz, None if times is None else in_frames(times, row)
