"""DeepLabCut's CSV of 3D points: rows `scorer`, `bodyparts` and `coords` above one row a frame, no time, no unit."""

import numpy as np

from muybridge.errors import FormatError
from muybridge.motion.formats.points.columns import placed
from muybridge.motion.formats.points.tables.sheet import Sheet, value_of
from muybridge.motion.formats.points.world import Trajectories


def matches(sheet: Sheet) -> bool:
    """Whether the rows above the numbers have the program's titles."""
    titles = [row[0].lower() for row in sheet.rows[:4] if row]
    return titles[:1] == ["scorer"] and "bodyparts" in titles


def read(sheet: Sheet, fps: float | None) -> Trajectories:
    """The body parts; of several individuals, `individual:bodypart`."""
    path = sheet.path
    rows = {row[0].lower(): (i, row) for i, row in enumerate(sheet.rows[:4]) if row}
    if "coords" not in rows:
        raise FormatError(f"{path}: begins like a table of DeepLabCut and has no row `coords`; export it again")
    at, coords = rows["coords"]
    if "z" not in coords:
        raise FormatError(f"{path}: is a table of DeepLabCut of one camera ({', '.join(dict.fromkeys(coords[1:4]))}); "
                          "triangulate in DeepLabCut and give the table of 3D points")  # fmt: skip
    parts = rows["bodyparts"][1]
    people = rows["individuals"][1] if "individuals" in rows else [""] * len(parts)
    several = len({p for p in people[1:] if p}) > 1
    found: dict[str, dict[str, int]] = {}
    for c in range(1, min(len(coords), len(parts), len(people))):
        name = f"{people[c]}:{parts[c]}" if several else parts[c]
        found.setdefault(name, {})[coords[c].lower()] = c
    found = {name: columns for name, columns in found.items() if {"x", "y", "z"} <= set(columns)}
    frames = [i for i in range(at + 1, len(sheet.rows)) if any(sheet.rows[i])]
    if not frames or not found:
        raise FormatError(f"{path}: has a header and no frames; export it again")
    table = sheet.numbers(frames, [found[name][axis] for name in found for axis in "xyz"])
    numbers = [value_of(sheet.rows[i][0], sheet.separator) for i in frames]
    if all(isinstance(n, float) for n in numbers):  # else names of images
        table, _ = placed(path, table, np.array(numbers), None, fps)
    return Trajectories(tuple(found), table.reshape(len(table), -1, 3), float("nan"), usual_unit="mm")
