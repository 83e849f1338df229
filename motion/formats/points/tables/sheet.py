"""The cells of a table of text, whatever separates them."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.motion.formats.points.common import read_text

_MISSING = ("", "nan", "na", "null", "none", "-")
_SEPARATORS = ",;\t"


@dataclass(frozen=True)
class Sheet:
    """A table of text.

    Attributes:
        path: the file, for messages.
        begin: how many lines are before the first row.
        separator: what separates cells.
        rows: cells, stripped; a line without any is an empty row.
    """

    path: Path
    begin: int
    separator: str
    rows: list[list[str]]

    def line(self, row: int) -> int:
        """The number of a row's line in the file, from 1."""
        return self.begin + row + 1

    def numbers(self, rows: Sequence[int], columns: Sequence[int]) -> FloatArray:
        """Cells as numbers (N, K), NaN where they are empty or not there.

        Raises:
            FormatError: one is no number; the message names line and cell.
        """
        out = np.full((len(rows), len(columns)), np.nan)
        for i, row in enumerate(rows):
            cells = self.rows[row]
            for j, column in enumerate(columns):
                if column < len(cells):
                    value = value_of(cells[column], self.separator)
                    if isinstance(value, str):
                        raise FormatError(f"{self.path}: line {self.line(row)}, cell {column + 1}: {value!r} is no "
                                          "number; empty means missing")  # fmt: skip
                    out[i, j] = value
        return out

    def rows_of_numbers(self, first: int) -> list[int]:
        """The rows from `first` on that begin with a number, up to a row of another kind; empty ones are skipped."""
        out = []
        for i in range(first, len(self.rows)):
            row = self.rows[i]
            if not any(row):
                continue
            if isinstance(value_of(row[0], self.separator), str):
                break
            out.append(i)
        return out


def read_sheet(path: Path) -> Sheet:
    """The cells of a table.

    Args:
        path: a table separated by commas, semicolons or tabs; lines before it may begin with #, and the first may
            state the separator (`sep=;`, as Excel writes it).

    Raises:
        FormatError: no table.
    """
    lines = read_text(path, "CSV").split("\n")
    begin = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if begin is None:
        raise FormatError(f"{path}: is empty; give a table with names in its first row")
    stated = lines[begin].strip("\"' \n").lower()
    if stated.startswith("sep=") and stated[4:] in tuple(",;"):
        separator, begin = stated[4:], begin + 1
    else:
        # The first row has names and no decimal commas; where it is a title (Vicon's), the third has.
        naming = next((line for line in lines[begin : begin + 3] if any(c in line for c in _SEPARATORS)), "")
        separator = max(_SEPARATORS, key=naming.count)
    try:
        rows = list(csv.reader(lines[begin:], delimiter=separator))
    except csv.Error as error:
        raise FormatError(f"{path}: is no table ({error}); export it again") from error
    return Sheet(path, begin, separator, [[cell.strip() for cell in row] for row in rows])


def value_of(cell: str, separator: str) -> float | str:
    """A cell's number, NaN where it means missing, else the cell; beside semicolons and tabs a comma is the decimal
    point."""
    if cell.lower() in _MISSING:
        return float("nan")
    try:
        return float(cell.replace(",", ".") if separator in ";\t" and "." not in cell else cell)
    except ValueError:
        return cell
