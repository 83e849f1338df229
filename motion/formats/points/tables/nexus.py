"""Vicon Nexus' ASCII export: blocks, one of them `Trajectories` with rate, names, axes, units and one row a frame."""

from muybridge.errors import FormatError
from muybridge.motion.formats.points.columns import placed
from muybridge.motion.formats.points.common import check_unit
from muybridge.motion.formats.points.tables.sheet import Sheet, value_of
from muybridge.motion.formats.points.world import Trajectories

_POINTS = "trajectories"
_BLOCKS = (_POINTS, "devices", "joints", "segments", "model outputs", "events", "eye trackers")


def matches(sheet: Sheet) -> bool:
    """Whether the first row is the title of a block."""
    return _title(sheet.rows[0]) in _BLOCKS


def _title(row: list[str]) -> str:
    return row[0].lower().rstrip(":") if row and not any(row[1:]) else ""


def read(sheet: Sheet, fps: float | None) -> Trajectories:
    """The block of trajectories."""
    path = sheet.path
    at = next((i for i, row in enumerate(sheet.rows) if _title(row) == _POINTS), None)
    if at is None:
        raise FormatError(f"{path}: is an export of Vicon Nexus without trajectories (it begins with "
                          f"{sheet.rows[0][0]}); tick Trajectories, or export a C3D")  # fmt: skip
    head = [sheet.rows[i] for i in range(at, len(sheet.rows)) if any(sheet.rows[i])][:5]
    first = next((i for i in range(at + 1, len(sheet.rows)) if sheet.rows[i] == head[-1]), at) + 1
    rate = value_of(head[1][0], sheet.separator) if len(head) == 5 else ""
    if isinstance(rate, str):
        raise FormatError(f"{path}: begins like Vicon's export, but its header is cut off; export it again")
    _, _, names, axes, units = head
    # A name stands over the first of its columns; velocities (X') may follow its coordinates.
    found = {c: names[c] for c in range(2, len(names)) if names[c] and [a.upper() for a in axes[c : c + 3]] == [*"XYZ"]}
    if not found:
        raise FormatError(f"{path}: begins like Vicon's export and names no trajectories; export it again")
    words = {unit for c in found for unit in units[c : c + 3] if unit}
    if len(words) > 1:
        raise FormatError(f"{path}: its trajectories have several units ({', '.join(sorted(words))}); give them one")
    rows = sheet.rows_of_numbers(first)
    # A block ends with an empty line.
    rows = [row for k, row in enumerate(rows) if row == first + k]
    if not rows:
        raise FormatError(f"{path}: has a header and no frames; export it again")
    table = sheet.numbers(rows, [0, *(c + k for c in found for k in range(3))])
    per_second = fps or rate
    start = (table[:, 0].min() - 1) / per_second if per_second > 0 else 0.0  # the common check refuses such a rate
    table, _ = placed(path, table, table[:, 0], None, fps)
    unit = check_unit(path, words.pop(), "the unit") if words else ""
    xyz = table[:, 1:].reshape(len(table), len(found), 3)
    return Trajectories(tuple(found.values()), xyz, rate, unit, "z", float(start))
