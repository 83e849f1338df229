"""OpenSim's `.mot`: a text table of coordinates over time (see `opensim` for which they are), angles in degrees."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.opensim import Coordinates, coordinates_of
from muybridge.motion.formats.skeletal.rigid import with_rigid_bones


def write_mot(path: Path, motion: Motion) -> None:
    """Write joint angles.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up.

    Raises:
        FormatError: a joint slides, or there are several roots.
        OutputError: the file cannot be written.
    """
    found = coordinates_of(with_rigid_bones(path, motion))
    values = np.where([_is_length(n) for n in found.names], found.values, np.degrees(found.values))
    lines = [
        "Coordinates", "version=1", f"nRows={len(values)}", f"nColumns={values.shape[1] + 1}", "inDegrees=yes", "",
        "Written by muybridge. Units are S.I. units (second, metres), angles are in degrees.", "endheader",
        "\t".join(["time", *found.names]),
    ]  # fmt: skip
    table = np.column_stack([found.times, values]) + 0.0
    lines += ["\t".join(f"{v:.8f}" for v in row) for row in table]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


@dataclass(frozen=True)
class StorageTable:
    """A storage file whose numbers are still text.

    Attributes:
        path: of the file.
        facts: of its header, in small letters.
        names: of the columns but the first, which is the time.
        lines: of the file.
        first: of the lines, the one after the names.
    """

    path: Path
    facts: dict[str, str]
    names: tuple[str, ...]
    lines: list[str]
    first: int


def read_mot(path: Path) -> Coordinates:
    """Read a table of coordinates.

    Raises:
        FormatError: malformed; the message names the line.
    """
    with parsing(path, FormatError, "an OpenSim storage file"):
        return coordinates_in(open_table(Path(path)))


def open_table(path: Path) -> StorageTable:
    """The header and the columns' names of a storage file.

    Raises:
        FormatError: malformed.
        OSError: it cannot be read.
    """
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise FormatError(f"{path}: has no line `endheader`; is it a .mot or .sto file, and whole?")
    head = dict(line.partition("=")[::2] for line in lines[:end] if "=" in line)
    facts = {k.strip().lower(): v.strip().lower() for k, v in head.items()}
    at = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
    names = lines[at].split() if at is not None else []
    if at is None or len(names) < 2 or names[0].lower() != "time":
        raise FormatError(f"{path}: line {(at or end) + 1} must name the columns, `time` first; export it again")
    if len(set(names)) != len(names):
        raise FormatError(f"{path}: line {at + 1} names a column twice; rename one of them")
    return StorageTable(path, facts, tuple(names[1:]), lines, at + 1)


def coordinates_in(table: StorageTable) -> Coordinates:
    """The coordinates of a table; FormatError where a row is malformed or the times do not rise."""
    rows = rows_of(table)
    values = rows[:, 1:]
    if table.facts.get("indegrees", "yes") == "yes":
        values = np.where([_is_length(n) for n in table.names], values, np.radians(values))
    return Coordinates(table.names, rows[:, 0], values)


def rows_of(table: StorageTable, width: int = 1) -> FloatArray:
    """(T, 1 + N width) numbers: the time, and `width` for each column, which only vectors may lack (NaN).

    Raises:
        FormatError: a row is malformed, rows are missing, or the times do not rise.
    """
    path = table.path
    rows = [_row(path, number, line.split(), len(table.names), width)
            for number, line in enumerate(table.lines[table.first :], table.first + 1) if line.strip()]  # fmt: skip
    stated = table.facts.get("nrows", str(len(rows)))
    if not rows or stated != str(len(rows)):
        raise FormatError(f"{path}: announces {stated[:20]} rows and has {len(rows)}; is it cut off?")
    out = np.array(rows)
    if (np.diff(out[:, 0]) <= 0).any():
        raise FormatError(f"{path}: its times do not rise; sort the rows")
    return out


def _row(path: Path, number: int, cells: list[str], count: int, width: int) -> FloatArray:
    parts = cells[:1] + [part for cell in cells[1:] for part in cell.split(",")]
    try:
        row = np.array([float(part) for part in parts])
    except ValueError:
        row = np.full(1, np.nan)
    known = np.abs(row) < 1e12
    if len(cells) != 1 + count or len(row) != 1 + count * width or not (known[0] if width > 1 else known.all()):
        wanted = f"{1 + count} finite numbers" if width == 1 else f"a time and {count} vectors of {width} numbers"
        raise FormatError(f"{path}: line {number} must have {wanted}; correct the line")
    return np.where(known, row, np.nan)


def _is_length(name: str) -> bool:
    return name.endswith(("_tx", "_ty", "_tz"))
