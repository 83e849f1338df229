"""Points as CSV: see `muybridge.motion.formats.points.columns` for the columns."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.columns import columns_of, is_coordinate, points_of
from muybridge.motion.formats.points.common import read_text

_MISSING = ("", "nan", "na", "null", "none", "-")


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


def read_csv(path: Path, fps: float | None = None, unit: str | None = None, up: str = "z") -> Points3D:
    """Read points into metres, Z up.

    Args:
        path: a table separated by commas, semicolons or tabs, with names in its first row.
        fps: frames per second; None takes them from a column of times.
        unit: m, cm or mm; None for what the column names state, metres where they state none.
        up: y or z; the format does not state it.

    Raises:
        FormatError: malformed; the message names the line.
    """
    return read_csv_from(path, fps, unit, up)[0]


def read_csv_from(
    path: Path, fps: float | None = None, unit: str | None = None, up: str = "z"
) -> tuple[Points3D, float]:
    """The points as `read_csv` has them, and the first frame's time in seconds, 0 where there are no times."""
    path = Path(path)
    begin, separator, rows = read_rows(path)
    head = list(rows[0])
    while head and not head[-1]:
        head.pop()
    twice = sorted({n for n in head if n and head.count(n) > 1})
    if twice:
        raise FormatError(f"{path}: the column {twice[0]!r} appears more than once; rename one of them")
    body = [(begin + i, row) for i, row in enumerate(rows[1:], start=2) if any(row)]
    columns: dict[str, list[Any]] = {name: [] for name in head if name}
    for number, row in body:
        if len(row) < len(head) or any(row[len(head) :]):
            raise FormatError(
                f"{path}: line {number} has {len(row)} cells, the first row {len(head)}; correct the line"
            )
        for name, cell in zip(head, row, strict=False):
            if name:
                columns[name].append(value_of(cell, separator))
    for name, cells in columns.items():
        bad = next((i for i, v in enumerate(cells) if isinstance(v, str)), None)
        if bad is not None and is_coordinate(name):
            raise FormatError(
                f"{path}: line {body[bad][0]}, column {name!r}: {cells[bad]!r} is no number; empty means missing"
            )
    return points_of(path, columns, fps, unit, up)


def read_rows(path: Path) -> tuple[int, str, list[list[str]]]:
    """The cells of a table, stripped: how many lines are before it, what separates cells, and its rows.

    Args:
        path: a table separated by commas, semicolons or tabs; lines before it may begin with #.

    Raises:
        FormatError: no table.
    """
    lines = read_text(path, "CSV").split("\n")
    begin = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if begin is None:
        raise FormatError(f"{path}: is empty; give a table with names in its first row")
    # The first row has names and no decimal commas; where it is a title (Vicon's), the third has.
    naming = next((line for line in lines[begin : begin + 3] if any(c in line for c in ",;\t")), "")
    separator = max(",;\t", key=naming.count)
    try:
        rows = list(csv.reader(lines[begin:], delimiter=separator))
    except csv.Error as error:
        raise FormatError(f"{path}: is no table ({error}); export it again") from error
    return begin, separator, [[cell.strip() for cell in row] for row in rows]


def value_of(cell: str, separator: str) -> float | str:
    """A cell's number, NaN where it means missing, else the cell; beside semicolons a comma is the decimal point."""
    if cell.lower() in _MISSING:
        return float("nan")
    try:
        return float(cell.replace(",", ".") if separator == ";" else cell)
    except ValueError:
        return cell
