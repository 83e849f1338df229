"""A table with names in its first row: see `muybridge.motion.formats.points.columns` for the columns."""

from typing import Any

from muybridge.errors import FormatError
from muybridge.motion.formats.points.columns import is_coordinate, trajectories_of
from muybridge.motion.formats.points.tables.sheet import Sheet, value_of
from muybridge.motion.formats.points.world import Trajectories

# Columns of the tables that `muybridge.motion.robots.write` writes; their root would pass for a point.
_ROBOT = ("root_qw", "root_qx", "root_qy", "root_qz")


def read_plain(sheet: Sheet, fps: float | None) -> Trajectories:
    """The points.

    Args:
        sheet: the table.
        fps: frames per second; None takes them from a column of times.

    Raises:
        FormatError: malformed; the message names the line.
    """
    path, head = sheet.path, list(sheet.rows[0])
    while head and not head[-1]:
        head.pop()
    if set(_ROBOT) <= set(head):
        raise FormatError(f"{path}: holds the joint angles of a robot, which are no points; open it with the robot's "
                          "simulator")  # fmt: skip
    body = [i for i, row in enumerate(sheet.rows) if i and any(row)]
    columns: list[list[Any]] = [[] for _ in head]
    for i in body:
        row = sheet.rows[i]
        if len(row) < len(head) or any(row[len(head) :]):
            raise FormatError(
                f"{path}: line {sheet.line(i)} has {len(row)} cells, the first row {len(head)}; correct the line"
            )
        for column, cell in zip(columns, row, strict=False):
            column.append(value_of(cell, sheet.separator))
    for name, cells in zip(head, columns, strict=True):
        bad = next((i for i, v in enumerate(cells) if isinstance(v, str)), None)
        if bad is not None and is_coordinate(name):
            raise FormatError(f"{path}: line {sheet.line(body[bad])}, column {name!r}: {cells[bad]!r} is no number; "
                              "empty means missing")  # fmt: skip
    named = [(name, cells) for name, cells in zip(head, columns, strict=True) if name]
    return trajectories_of(path, named, fps)
