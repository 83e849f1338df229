"""Paths on the floor that walks follow: tables of places, and how far a motion is from them."""

import csv
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shorten

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, MuybridgeError, parsing
from muybridge.wording import counted

_STEP_M = 0.02  # between places of a path
_AHEAD_M = 1.0  # that is searched for the nearest place
_WANTED = "a path has columns x and y in metres, a row for each corner, the first one where the walk starts"
_LONGEST_M = 1e5


@dataclass(frozen=True, eq=False)
class FloorPath:
    """A path on the floor.

    Attributes:
        places: (S, 2) metres, in even steps from its start to its end.
        step: metres between them along the path.
    """

    places: FloatArray
    step: float

    @property
    def length(self) -> float:
        """Metres."""
        return self.step * (len(self.places) - 1)


@dataclass(frozen=True)
class Deviation:
    """How a motion follows a path.

    Attributes:
        mean: metres from the path, of all frames.
        most: metres, the farthest.
        at: metres along the path where it is farthest.
        end: metres from where the motion ends to the path's end.
    """

    mean: float
    most: float
    at: float
    end: float


def floor_path(corners: FloatArray) -> FloorPath:
    """A path through corners (P, 2), in metres.

    Raises:
        MuybridgeError: fewer than two of them differ, one is not finite, or the path is longer than 100 km.
    """
    corners = np.asarray(corners, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise MuybridgeError("a path needs places of two finite numbers, x and y in metres")
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    length = float(along[-1]) if len(along) else 0.0
    if length < _STEP_M:
        raise MuybridgeError("a path needs at least two different places")
    if length > _LONGEST_M:
        raise MuybridgeError(f"the path is {length / 1e3:,.0f} km long; places are in metres, and 100 km is the most")
    count = max(round(length / _STEP_M), 2)
    kept = np.concatenate([[True], np.diff(along) > 0])
    at = np.linspace(0, length, count + 1)
    places = np.stack([np.interp(at, along[kept], corners[kept, k]) for k in (0, 1)], axis=1)
    return FloorPath(places, length / count)


def read_floor_path(path: Path) -> FloorPath:
    """Read a path through the corners of a file (see `read_corners`).

    Raises:
        FormatError: as `read_corners` and `floor_path`; the message names the file.
    """
    corners = read_corners(path)
    try:
        return floor_path(corners)
    except MuybridgeError as error:
        raise FormatError(f"{path}: {error.message}") from None


def read_corners(path: Path) -> FloatArray:
    """(P, 2) metres: a CSV of at least two places with the columns x and y, or of two columns without names.

    Raises:
        FormatError: it has no such columns, a row is not of two finite numbers, or there are fewer than two.
    """
    with parsing(path, FormatError, "a path"):
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            text = file.read()
        separator = next((s for s in (";", "\t", ",") if s in text), None)
        lines = text.splitlines()
        rows = list(csv.reader(lines, delimiter=separator)) if separator else [line.split() for line in lines]
        numbered = [(k, [cell.strip() for cell in row]) for k, row in enumerate(rows, 1)
                    if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#")]  # fmt: skip
        if not numbered:
            raise FormatError(f"{path}: is empty, and a path needs at least two places; {_WANTED}")
        names = [cell.lower() for cell in numbered[0][1]]
        columns = (0, 1)
        if not all(_is_number(cell) for cell in names[:2]):
            if "x" not in names or "y" not in names:
                raise FormatError(f"{path}: has the columns {shorten(', '.join(names))}; {_WANTED}")
            columns, numbered = (names.index("x"), names.index("y")), numbered[1:]
        places = []
        for line, row in numbered:
            cells = [row[c] if c < len(row) else "" for c in columns]
            if not all(_is_number(cell) for cell in cells):
                raise FormatError(f"{path}: line {line} is not of two finite numbers; {_WANTED}")
            places.append([float(cell) for cell in cells])
    if len(places) < 2:
        raise FormatError(f"{path}: has {counted(len(places), 'place')}; a path needs at least two")
    return np.array(places)


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False


def deviation(path: FloorPath, trail: FloatArray) -> Deviation:
    """How far a trail (T, 2) on the floor, in metres, is from a path: from the place on it that is nearest, among those
    near the last frame's, so that a path may cross itself."""
    ahead, at = round(_AHEAD_M / path.step), 0
    away, where = np.zeros(len(trail)), np.zeros(len(trail))
    for t, place in enumerate(trail):
        some = path.places[max(at - ahead // 4, 0) : at + ahead]
        squared = ((some - place) ** 2).sum(axis=1)
        at = max(at - ahead // 4, 0) + int(np.argmin(squared))
        away[t], where[t] = np.sqrt(squared.min()), at * path.step
    worst = int(np.argmax(away))
    end = float(np.linalg.norm(trail[-1] - path.places[-1]))
    return Deviation(float(away.mean()), float(away[worst]), float(where[worst]), end)
