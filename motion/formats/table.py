"""Points as a table: what CSV and Parquet share.

One row a frame: `frame`, `time`, then three columns a landmark, `<name>_x`, `<name>_y`, `<name>_z`, in metres with Z
up. Read are also the other ways of writing such columns (`LASI.X`, `LASI:x`, `LASI X (mm)`, `noseX`), and tables with
one row a landmark and frame (`frame, name, x, y, z`).
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError
from muybridge.geometry.landmarks import Points3D
from muybridge.motion.formats.points3d import METRES_OF_UNIT, UP_PERMUTATION, check_unit, check_up, points_of_file

Array = NDArray[np.float64]

_COLUMN = re.compile(
    r"^(?P<name>.+?)(?:[\s_.:\-/|(\[]+(?P<a>[xyzXYZ])|(?<=[a-z0-9])(?P<b>[XYZ]))[)\]]?"
    r"(?:[\s_(\[]+(?P<unit>mm|cm|m)[)\]]?)?$"
)
_TIMES = ("time", "t", "time_s", "time (s)", "time [s]", "seconds", "timestamp")
_FRAMES = ("frame", "frame#", "frames", "frame_index", "index", "sync_index")
_NAMES = ("name", "landmark", "marker", "label", "joint", "keypoint", "point", "point_name")


def columns_of(points: Points3D) -> dict[str, Array]:
    """The table's columns by name, in order."""
    xyz = points.points_world
    out: dict[str, Array] = {
        "frame": np.arange(1, len(xyz) + 1, dtype=np.float64),
        "time": np.arange(len(xyz)) / points.fps,
    }
    for j, name in enumerate(points.landmarks.names):
        out |= {f"{name}_{axis}": xyz[:, j, k] for k, axis in enumerate("xyz")}
    return out


def points_of(
    path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], fps: float | None, unit: str | None, up: str
) -> Points3D:
    """Points of a table.

    Args:
        path: for the message.
        columns: by name, equally long; empty cells NaN, or texts in a column of names.
        fps: frames a second; None takes them from a column of times.
        unit: m, cm or mm; None for what the column names say, metres where they say nothing.
        up: y or z.

    Raises:
        FormatError: no landmark has three columns, the units differ, or there is no frame rate.
    """
    lower = {str(name).strip().lower(): name for name in columns}
    times = next((_numbers(path, columns, lower[k]) for k in _TIMES if k in lower), None)
    if {"x", "y", "z"} <= set(lower):
        names, xyz, times = _long(path, columns, lower, times)
        units: set[str] = set()
    else:
        names, xyz, units = _wide(path, columns)
    if len(units) > 1:
        raise FormatError(f"{path}: its columns have several units ({', '.join(sorted(units))}); give them one")
    if not len(xyz):
        raise FormatError(f"{path}: has a header and no row of points below; is it cut off?")
    metres = METRES_OF_UNIT[check_unit(path, unit or next(iter(units), "m"), "the unit")]
    xyz[~np.all(np.abs(xyz) < 1e12, axis=-1)] = np.nan
    return points_of_file(
        path, names, xyz[..., UP_PERMUTATION[check_up(up)]] * metres, fps or _rate(path, times), "table"
    )


def _rate(path: Path, times: Array | None) -> float:
    steps = np.diff(times) if times is not None else np.zeros(0)
    step = float(np.median(steps)) if len(steps) and np.isfinite(steps).all() else 0.0
    if not 1e-6 < step < 1e6:
        raise FormatError(f"{path}: has no column of rising times, so no frame rate; say it with --fps")
    even = float(np.mean(steps))
    fps = 1.0 / (even if abs(even - step) < 0.01 * step else step)
    return float(round(fps)) if abs(fps - round(fps)) < 1e-4 * fps else fps


def is_coordinate(column: str) -> bool:
    """Whether a column of this name holds coordinates."""
    return column.strip().lower() in ("x", "y", "z") or _COLUMN.match(column.strip()) is not None


def _numbers(path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], name: str) -> Array:
    try:
        return np.array([np.nan if v is None else v for v in columns[name]], dtype=np.float64)
    except (TypeError, ValueError):
        raise FormatError(f"{path}: the column {name!r} holds what is no number; empty means missing") from None


def _wide(
    path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]]
) -> tuple[list[str], Array, set[str]]:
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
            units.add(match["unit"])
    names = [name for name, axes in found.items() if len(axes) == 3]
    if not names:
        raise FormatError(
            f"{path}: no landmark has columns for x, y and z; name them nose_x, nose_y, nose_z and so on in the "
            "first row"
        )
    xyz = [[_numbers(path, columns, found[name][axis]) for axis in "xyz"] for name in names]
    return names, np.moveaxis(np.array(xyz), -1, 0), units


def _long(
    path: Path, columns: Mapping[str, Sequence[Any] | NDArray[Any]], lower: Mapping[str, str], times: Array | None
) -> tuple[list[str], Array, Array | None]:
    """One row a landmark and frame."""
    label = next((lower[k] for k in _NAMES if k in lower), None)
    frame = next((lower[k] for k in (*_FRAMES, *_TIMES) if k in lower), None)
    if label is None or frame is None:
        missing = "name" if label is None else "frame"
        raise FormatError(f"{path}: has columns x, y, z, but none called {missing}; add it")
    labels = [str(v) for v in columns[label]]
    keys = _numbers(path, columns, frame)
    if not np.isfinite(keys).all():
        raise FormatError(f"{path}: the column {frame!r} has an empty cell")
    frames, row = np.unique(keys, return_inverse=True)
    whole = frame.strip().lower() in _FRAMES and len(frames) and (frames == np.round(frames)).all()
    if whole and np.ptp(frames) < 100 * len(keys) + 1000:  # frames without any row are gaps
        row = np.asarray(keys - frames[0], dtype=np.intp)
        frames = np.arange(frames[0], frames[-1] + 1)
    names = list(dict.fromkeys(labels))
    column = np.array([names.index(n) for n in labels], dtype=np.intp)
    if len({*zip(row.tolist(), column.tolist(), strict=True)}) != len(row):
        raise FormatError(f"{path}: a landmark has two rows in one frame; keep one of them")
    xyz = np.full((len(frames), len(names), 3), np.nan)
    xyz[row, column] = np.stack([_numbers(path, columns, lower[axis]) for axis in "xyz"], axis=1)
    if times is not None:
        of_frame = np.full(len(frames), np.nan)
        of_frame[row] = times
        times = of_frame[np.isfinite(of_frame)] if np.isfinite(of_frame).all() else None
    return names, xyz, times
