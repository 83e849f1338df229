"""OptiTrack Motive's CSV: a line of keys and values, rows of types, names and quantities, then one row a frame. Y is up
in it."""

from muybridge.errors import FormatError
from muybridge.motion.formats.points.columns import placed
from muybridge.motion.formats.points.common import check_unit
from muybridge.motion.formats.points.tables.sheet import Sheet, value_of
from muybridge.motion.formats.points.world import Trajectories

# What was measured counts before what was computed from it.
_TYPES = ("marker", "bone marker", "rigid body marker", "bone", "rigid body")


def matches(sheet: Sheet) -> bool:
    """Whether the first row has Motive's keys."""
    first = [cell.lower() for cell in sheet.rows[0]]
    return bool(first) and (first[0] == "format version" or "take name" in first)


def read(sheet: Sheet, fps: float | None) -> Trajectories:
    """The positions of one type: markers, if there are any."""
    path, rows = sheet.path, sheet.rows
    meta = {key.lower(): value for key, value in zip(rows[0][::2], rows[0][1::2], strict=False)}
    if meta.get("coordinate space", "global").lower() not in ("global", ""):
        raise FormatError(f"{path}: is an export of Motive in {meta['coordinate space']} coordinates; export it in "
                          "global coordinates, or as C3D")  # fmt: skip
    axes_at = next((i for i, row in enumerate(rows) if row and row[0].lower() == "frame"), None)
    if axes_at is None:
        raise FormatError(f"{path}: begins like Motive's export and has no row of columns (Frame, Time); export it "
                          "again")  # fmt: skip
    labelled = {row[1].lower(): row for row in rows[1:axes_at] if len(row) > 1 and row[1]}
    quantities = next((row for row in reversed(rows[1:axes_at]) if "position" in {c.lower() for c in row}), [])
    types, names, axes = labelled.get("type", []), labelled.get("name", []), rows[axes_at]
    found: dict[str, list[tuple[str, int]]] = {}
    for c in range(2, min(len(types), len(names), len(quantities), len(axes) - 2)):
        if quantities[c].lower() == "position" and [a.upper() for a in axes[c : c + 3]] == [*"XYZ"]:
            found.setdefault(types[c].lower(), []).append((names[c], c))
    chosen = next((kind for kind in _TYPES if kind in found), None)
    if chosen is None:
        raise FormatError(f"{path}: is an export of Motive without positions; tick Markers and export it in global "
                          "coordinates, or as C3D")  # fmt: skip
    frames = sheet.rows_of_numbers(axes_at + 1)
    if not frames:
        raise FormatError(f"{path}: has a header and no frames; export it again")
    columns = [c + k for _, c in found[chosen] for k in range(3)]
    table = sheet.numbers(frames, [0, 1, *columns])
    table, times = placed(path, table, table[:, 0], table[:, 1], fps)
    rate = value_of(meta.get("export frame rate") or meta.get("capture frame rate", ""), sheet.separator)
    start = 0.0 if times is None or not times[0] > 0 else float(times[0])
    left = [f"{len(held)} of type {kind}" for kind, held in found.items() if kind != chosen]
    notices = (f"positions of type {chosen} were read; left out: {', '.join(left)}",) if left else ()
    unit = meta.get("length units", "")
    return Trajectories(
        tuple(name for name, _ in found[chosen]), table[:, 2:].reshape(len(table), -1, 3),
        rate if isinstance(rate, float) else float("nan"), check_unit(path, unit, "Length Units") if unit else "",
        "y", start, notices,
    )  # fmt: skip
