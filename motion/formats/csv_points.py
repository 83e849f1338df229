"""Points as CSV: see `muybridge.motion.formats.table` for the columns."""

import csv
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks import Points3D
from muybridge.motion.formats.table import columns_of, is_coordinate, points_of

_MISSING = ("", "nan", "na", "null", "none", "-")


def write_csv(path: Path, points: Points3D) -> None:
    """Write one row a frame in metres, Z up; what is missing is an empty cell.

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
        fps: frames a second; None takes them from a column of times.
        unit: m, cm or mm; None for what the column names say, metres where they say nothing.
        up: y or z; the format does not say.

    Raises:
        FormatError: malformed; the message names the line.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror}); give an existing CSV file") from error
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: is not text, so not CSV; give a table with names in its first row") from error
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    begin = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if begin is None:
        raise FormatError(f"{path}: is empty; give a table with names in its first row")
    separator = max(",;\t", key=lines[begin].count)
    try:
        rows = list(csv.reader(lines[begin:], delimiter=separator))
    except csv.Error as error:
        raise FormatError(f"{path}: is no table ({error}); export it again") from error
    head = [cell.strip() for cell in rows[0]]
    while head and not head[-1]:
        head.pop()
    twice = sorted({n for n in head if n and head.count(n) > 1})
    if twice:
        raise FormatError(f"{path}: the column {twice[0]!r} stands more than once; rename one of them")
    body = [(begin + i, row) for i, row in enumerate(rows[1:], start=2) if any(cell.strip() for cell in row)]
    columns: dict[str, list[Any]] = {name: [] for name in head if name}
    for number, row in body:
        if len(row) < len(head) or any(cell.strip() for cell in row[len(head) :]):
            raise FormatError(f"{path}: line {number} has {len(row)} cells, the first row {len(head)}; mend the line")
        for name, cell in zip(head, row, strict=False):
            if name:
                columns[name].append(_value(cell.strip(), separator))
    for name, cells in columns.items():
        bad = next((i for i, v in enumerate(cells) if isinstance(v, str)), None)
        if bad is not None and is_coordinate(name):
            raise FormatError(
                f"{path}: line {body[bad][0]}, column {name!r}: {cells[bad]!r} is no number; empty means missing"
            )
    return points_of(path, columns, fps, unit, up)


def _value(cell: str, separator: str) -> float | str:
    if cell.lower() in _MISSING:
        return float("nan")
    try:
        return float(cell.replace(",", ".") if separator == ";" else cell)
    except ValueError:
        return cell
