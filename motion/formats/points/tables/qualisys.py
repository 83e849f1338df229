"""Qualisys Track Manager's TSV of 3D data: lines of keys and values, then one row a frame, in millimetres.

Missing is 0, 0, 0, or empty.
"""

import re

from muybridge.errors import FormatError
from muybridge.motion.formats.points.columns import placed
from muybridge.motion.formats.points.tables.sheet import Sheet, value_of
from muybridge.motion.formats.points.world import Trajectories

_KEY = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION|EVENT")


def matches(sheet: Sheet) -> bool:
    """Whether the first rows are keys that only this program has."""
    return bool(sheet.rows[0]) and sheet.rows[0][0] == "NO_OF_FRAMES"


def read(sheet: Sheet, fps: float | None) -> Trajectories:
    """The trajectories."""
    path = sheet.path
    end = next((i for i, row in enumerate(sheet.rows) if any(row) and not _KEY.fullmatch(row[0])), len(sheet.rows))
    head = {row[0]: row[1:] for row in sheet.rows[:end] if row}
    included = (head.get("DATA_INCLUDED") or ["3D"])[0]
    if included.upper() != "3D":
        raise FormatError(f"{path}: is an export of Qualisys with {included} data; export 3D data as TSV, or a C3D")
    names = [name for name in head.get("MARKER_NAMES", []) if name]
    if not names:
        raise FormatError(f"{path}: is an export of Qualisys that names no markers; label them and export it again")
    titles = []
    if end < len(sheet.rows) and isinstance(value_of(sheet.rows[end][0], sheet.separator), str):
        titles, end = [cell.lower() for cell in sheet.rows[end]], end + 1
    rows = sheet.rows_of_numbers(end)
    if not rows:
        raise FormatError(f"{path}: has a header and no frames; export it again")
    widest = max(max((i + 1 for i, cell in enumerate(sheet.rows[r]) if cell), default=0) for r in rows)
    # Frame and time are there if they were chosen, and so are the columns' titles.
    extra = (
        [t for t in titles[:2] if t in ("frame", "time")] if titles else ["frame", "time"] * (widest > 3 * len(names))
    )
    table = sheet.numbers(rows, range(len(extra) + 3 * len(names)))
    numbers = table[:, extra.index("frame")] if "frame" in extra else None
    times = table[:, extra.index("time")] if "time" in extra else None
    table, times = placed(path, table, numbers, times, fps)
    xyz = table[:, len(extra) :].reshape(len(table), len(names), 3)
    xyz[(xyz == 0).all(axis=-1)] = float("nan")
    rate = value_of((head.get("FREQUENCY") or [""])[0], sheet.separator)
    start = 0.0 if times is None or not times[0] > 0 else float(times[0])
    stated = (head.get("NO_OF_FRAMES") or [""])[0]
    notices = ()
    if stated.isdecimal() and int(stated) != len(table):
        notices = (f"NO_OF_FRAMES is {stated}, and {len(table)} frames are there: those were read",)
    return Trajectories(tuple(names), xyz, rate if isinstance(rate, float) else float("nan"), "mm", "z", start, notices)
