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
from muybridge.motion.formats.points.common import (
    METRES_OF_UNIT,
    UNIT_WORDS,
    UP_PERMUTATION,
    check_unit,
    check_up,
    frames_of_rows,
    in_frames,
    points_of_file,
)

_COLUMN = re.compile(
    r"^(?P<name>.+?)(?:[\s_.:\-/|(\[]+(?P<a>[xyzXYZ])|(?<=[a-z0-9])(?P<b>[XYZ]))[)\]]?"
    rf"(?:[\s_(\[]+(?P<unit>(?i:{'|'.join(UNIT_WORDS)}))[)\]]?)?$"
)
# Frames per second: what is slower has times in another unit.
_SLOWEST = 0.9
TIMES = ("time", "t", "time_s", "time(s)", "time[s]", "time (s)", "time [s]", "seconds", "timestamp")
FRAMES = ("frame", "frame#", "frames", "frame_index", "index", "sync_index")
_NAMES = ("name", "landmark", "marker", "label", "joint", "keypoint", "point", "point_name")


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


def points_of(
    path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], fps: float | None, unit: str | None, up: str
) -> tuple[Points3D, float]:
    """Points of a table, and the first frame's time in seconds, 0 where there are no times.

    Args:
        path: for the message.
        columns: by name, equally long; empty cells NaN, or texts in a column of names.
        fps: frames per second; None takes them from a column of times.
        unit: m, cm or mm; None for what the column names state, metres where they state none.
        up: y or z.

    Raises:
        FormatError: no landmark has three columns, the units differ, or there is no frame rate.
    """
    lower = {str(name).strip().lower(): name for name in columns}
    times = next((_numbers(path, columns, lower[k]) for k in TIMES if k in lower), None)
    if {"x", "y", "z"} <= set(lower):
        names, xyz, times = _long(path, columns, lower, times, fps)
        units: set[str] = set()
    else:
        names, xyz, units = _wide(path, columns)
        numbers = next((_numbers(path, columns, lower[k]) for k in FRAMES if k in lower), None)
        xyz, times = placed(path, xyz, numbers, times, fps)
    if len(units) > 1:
        raise FormatError(f"{path}: its columns have several units ({', '.join(sorted(units))}); give them one")
    if not len(xyz):
        raise FormatError(f"{path}: has a header and no row of points below; is it cut off?")
    metres = METRES_OF_UNIT[check_unit(path, unit or next(iter(units), "m"), "the unit")]
    xyz[~np.all(np.abs(xyz) < 1e12, axis=-1)] = np.nan
    points = points_of_file(
        path, names, xyz[..., UP_PERMUTATION[check_up(up)]] * metres, fps or rate_of(path, times), "table"
    )
    return points, 0.0 if times is None else float(np.nan_to_num(times[0]))


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


def _numbers(path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], name: str) -> FloatArray:
    try:
        return np.array([np.nan if v is None else v for v in columns[name]], dtype=np.float64)
    except (TypeError, ValueError):
        raise FormatError(f"{path}: the column {name!r} holds what is no number; empty means missing") from None


def _wide(path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]]) -> tuple[list[str], FloatArray, set[str]]:
    found: dict[str, dict[str, str]] = {}
    units: set[str] = set()
    for column in columns:
        match = _COLUMN.match(str(column).strip())
        if match is None:
            continue
        axis = (match["a"] or match["b"]).lower()
        if axis in found.setdefault(match["name"], {}):
            raise FormatError(f"{path}: {match['name']!r} has two columns for {axis}; rename one of them")
        found[match["name"]][axis] = column
        if match["unit"]:
            units.add(match["unit"].lower())
    names = [name for name, axes in found.items() if len(axes) == 3]
    if not names:
        raise FormatError(
            f"{path}: no landmark has columns for x, y and z; name them nose_x, nose_y, nose_z and so on in the "
            "first row"
        )
    xyz = [[_numbers(path, columns, found[name][axis]) for axis in "xyz"] for name in names]
    return names, np.moveaxis(np.array(xyz), -1, 0), units


def _long(
    path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], lower: Mapping[str, str], times: FloatArray | None,
    fps: float | None,
) -> tuple[list[str], FloatArray, FloatArray | None]:  # fmt: skip
    """One row per landmark and frame."""
    label = next((lower[k] for k in _NAMES if k in lower), None)
    frame = next((lower[k] for k in (*FRAMES, *TIMES) if k in lower), None)
    if label is None or frame is None:
        missing = "name" if label is None else "frame"
        raise FormatError(f"{path}: has columns x, y, z, but none called {missing}; add it")
    labels = [str(v) for v in columns[label]]
    keys = _numbers(path, columns, frame)
    if not np.isfinite(keys).all():
        raise FormatError(f"{path}: the column {frame!r} has an empty cell")
    frames, of_frame = np.unique(keys, return_inverse=True)
    numbered = frame.strip().lower() in FRAMES
    row = frames_of_rows(path, frames if numbered else None, None if numbered else frames, fps)[of_frame]
    names = list(dict.fromkeys(labels))
    column = np.array([names.index(n) for n in labels], dtype=np.intp)
    if len({*zip(row.tolist(), column.tolist(), strict=True)}) != len(row):
        raise FormatError(f"{path}: a landmark has two rows in one frame; keep one of them")
    count = int(row.max(initial=-1)) + 1
    xyz = np.full((count, len(names), 3), np.nan)
    xyz[row, column] = np.stack([_numbers(path, columns, lower[axis]) for axis in "xyz"], axis=1)
    return names, xyz, None if times is None else in_frames(times, row)
