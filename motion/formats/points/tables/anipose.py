"""Anipose's CSV of 3D points: columns of coordinates, errors and numbers of cameras for each, without times or unit."""

from dataclasses import replace

from muybridge.motion.formats.points.tables.plain import read_plain
from muybridge.motion.formats.points.tables.sheet import Sheet
from muybridge.motion.formats.points.world import Trajectories


def matches(sheet: Sheet) -> bool:
    """Whether the columns are those that only this program has."""
    return "fnum" in sheet.rows[0] and any(cell.endswith("_ncams") for cell in sheet.rows[0])


def read(sheet: Sheet, fps: float | None) -> Trajectories:
    """The points; their unit is that of the calibration board, mostly millimetres."""
    return replace(read_plain(sheet, fps), usual_unit="mm")
