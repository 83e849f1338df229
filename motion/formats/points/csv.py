"""Points as CSV: see `muybridge.motion.formats.points.columns` for the columns."""

import csv
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.columns import columns_of
from muybridge.motion.formats.points.common import check_up
from muybridge.motion.formats.points.tables.layouts import read_layout
from muybridge.motion.formats.points.tables.plain import read_plain
from muybridge.motion.formats.points.tables.sheet import read_sheet
from muybridge.motion.formats.points.world import PointsOfFile, points_of_file


def write_csv(path: Path, points: Points3D) -> None:
    """Write one row per frame in metres, Z up; what is missing is an empty cell.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = columns_of(points)
    table = np.stack(list(columns.values()), axis=1)
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in table:
            cells = ["" if np.isnan(v) else f"{v:.6f}" for v in row[2:]]
            writer.writerow([int(row[0]), f"{row[1]:.9f}", *cells])


def read_csv(path: Path, fps: float | None = None, unit: str | None = None, up: str | None = None) -> Points3D:
    """Read points into metres, Z up.

    Args:
        path: a table separated by commas, semicolons or tabs, with names in its first row, or as a program of
            `muybridge.motion.formats.points.tables.layouts` lays it out.
        fps: frames per second; None takes them from the file.
        unit: m, cm or mm; None for what the file states, metres where it states none.
        up: y or z; None for z, or what the program has.

    Raises:
        FormatError: malformed; the message names the line.
    """
    return read_csv_from(path, fps, unit, up).points


def read_csv_from(path: Path, fps: float | None = None, unit: str | None = None, up: str | None = None) -> PointsOfFile:
    """The points as `read_csv` has them, the first frame's time, and what was left out."""
    path, up = Path(path), None if up is None else check_up(up)
    with parsing(path, FormatError, "a table of points"):
        sheet = read_sheet(path)
        found = read_layout(sheet, fps) or read_plain(sheet, fps)
        return points_of_file(path, found, "table", unit, up, fps)
