"""TRC, the tab-separated marker file of Motion Analysis that OpenSim reads.

Y is up in it, as OpenSim wants: x_trc = y_world, y_trc = z_world, z_trc = x_world. The header has the eight
keys that OpenSim insists on, and every cell ends with a tab, because OpenSim counts the cells of a row and
drops a last one that is empty. A missing point is three empty cells.
"""

import math
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.common import check_unit, check_up, frames_of_rows, in_frames, read_text
from muybridge.motion.formats.points.world import PointsOfFile, Trajectories, points_of_file

WORLD_AXIS_OF_TRC = (1, 2, 0)
_KEYS = (
    "DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units",
    "OrigDataRate", "OrigDataStartFrame", "OrigNumFrames",
)  # fmt: skip


def write_trc(path: Path, points: Points3D) -> None:
    """Write one row per frame, in metres.

    Args:
        path: the file to write; replaced only once it is complete.
        points: (T, J, 3) metres, Z up; a point with any coordinate missing becomes three empty cells.

    Raises:
        OutputError: the file cannot be written.
    """
    xyz = np.asarray(points.points_world, dtype=np.float64)[..., WORLD_AXIS_OF_TRC]
    frames, markers = xyz.shape[:2]
    rate = f"{points.fps:.10g}"
    values = (rate, rate, str(frames), str(markers), "m", rate, "1", str(frames))
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{Path(path).name}",
        "\t".join(_KEYS),
        "\t".join(values),
        "Frame#\tTime\t" + "".join(f"{name}\t\t\t" for name in points.landmarks.names),
        "\t\t" + "".join(f"X{i}\tY{i}\tZ{i}\t" for i in range(1, markers + 1)),
        "",
    ]
    known = np.all(np.isfinite(xyz), axis=-1)
    for t in range(frames):
        cells = (
            f"{p[0]:.6f}\t{p[1]:.6f}\t{p[2]:.6f}\t" if k else "\t\t\t" for p, k in zip(xyz[t], known[t], strict=True)
        )
        lines.append(f"{t + 1}\t{t / points.fps:.6f}\t" + "".join(cells))
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def read_trc(path: Path, unit: str | None = None, up: str = "y", fps: float | None = None) -> Points3D:
    """Read points into metres, Z up.

    Args:
        path: the file.
        unit: m, cm or mm, overriding the file; None for what the file states.
        up: y or z; the format does not state it.
        fps: frames per second, overriding the file; None for what the file states.

    Returns:
        points_world (T, J, 3), NaN where a cell is empty or a frame has no row; covariance NaN, since the format has
        none.

    Raises:
        FormatError: the file is not a TRC or ends too early, or a line of it is malformed; the message names the line.
    """
    return read_trc_from(path, unit, up, fps).points


def read_trc_from(path: Path, unit: str | None = None, up: str | None = None, fps: float | None = None) -> PointsOfFile:
    """The points as `read_trc` has them, the first frame's time, and what was left out."""
    path, up = Path(path), None if up is None else check_up(up)
    with parsing(path, FormatError, "a TRC"):
        return points_of_file(path, trc_trajectories(path, unit, fps), "trc", unit, up, fps)


def trc_trajectories(path: Path, unit: str | None = None, fps: float | None = None) -> Trajectories:
    """What the file holds; see `read_trc`."""
    lines = read_text(path, "TRC").split("\n")
    if not lines or not lines[0].lstrip().startswith("PathFileType") or len(lines) < 5:
        raise FormatError(f"{path}: line 1 must begin with PathFileType, 5 lines of header in all; is it a TRC?")
    head = _head(lines[1], lines[2])
    rate = fps or _header_number(path, head, "DataRate")
    stated = check_unit(path, unit or head.get("Units", ""), "line 3: Units")
    names, at = _names(path, lines[3], lines[4])
    rows, more, notices = _rows(path, lines, 2 + 3 * (at[-1] + 1))
    announced = head.get("NumMarkers", "")
    if announced.isdecimal() and int(announced) != len(names):
        message = f"line 3 states {announced} markers, line 4 names {len(names)}"
        unnamed = at[-1] + 1 - len(names) + more
        fewer = int(announced) < len(names) and any(np.isfinite(row[2 + 3 * int(announced) :]).any() for row in rows)
        if not (fewer or (unnamed and int(announced) > len(names))):
            raise FormatError(f"{path}: {message}; correct NumMarkers")
        notices.append(f"{message}: those that are named were read")
    if not rows:
        raise FormatError(f"{path}: has no row of points after its header; is it cut off?")
    table = np.array(rows, dtype=np.float64)
    table = in_frames(table, frames_of_rows(path, table[:, 0], table[:, 1], fps))
    announced = head.get("NumFrames", "")
    if announced.isdecimal() and int(announced) > len(table) + 1:
        raise FormatError(f"{path}: line 3 states {announced} frames, {len(rows)} rows follow: the file is cut off; "
                          "export it again, or correct NumFrames")  # fmt: skip
    if announced.isdecimal() and int(announced) == len(table) + 1:
        notices.append(f"line 3 states {announced} frames, {len(rows)} rows follow: those that are there were read")
    xyz = table[:, 2:].reshape(len(table), -1, 3)[:, at]
    if at[-1] + 1 > len(names):
        notices.append(_left_out(at[-1] + 1 - len(names), "between"))
    return Trajectories(tuple(names), xyz, rate, stated, "y", float(np.nan_to_num(table[0, 1])), tuple(notices))


def _left_out(count: int, where: str) -> str:
    many = "trajectory without a name was" if count == 1 else "trajectories without names were"
    return f"{count} {many} left out, {where} the markers of line 4"


def _head(keys: str, values: str) -> dict[str, str]:
    """The second line's keys with the third's values, also where empty cells or spaces are between them."""
    known = [key.strip() for key in keys.split("\t") if key.strip()] if "\t" in keys else keys.split()
    for cells in ([cell.strip() for cell in values.split("\t") if cell.strip()], values.split()):
        if len(cells) == len(known):
            return dict(zip(known, cells, strict=True))
    return {key.strip(): cell.strip() for key, cell in zip(keys.split("\t"), values.split("\t"), strict=False)}


def _header_number(path: Path, head: dict[str, str], key: str) -> float:
    try:
        value = float(head[key].replace(",", "."))
    except (KeyError, ValueError):
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise FormatError(f"{path}: line 3: {key} is {head.get(key, 'missing')!r}; give a number above zero")
    return value


def _names(path: Path, line: str, axes: str) -> tuple[list[str], list[int]]:
    """The markers' names, and which triple of cells each has: between them may be trajectories without a name."""
    if "\t" not in line.strip():
        names = line.split()[2:]
        if names and len(axes.split()) != 3 * len(names):
            raise FormatError(f"{path}: line 4 is separated by spaces and seems to name {len(names)} markers, line 5 "
                              f"{len(axes.split()) / 3:g}; separate the names by tabs, three to a marker")  # fmt: skip
        at = list(range(len(names)))
    else:
        there = [(i - 2, cell.strip()) for i, cell in enumerate(line.split("\t")) if i >= 2 and cell.strip()]
        names = [name for _, name in there]
        regular = all(i % 3 == 0 for i, _ in there)
        at = [i // 3 for i, _ in there] if regular else list(range(len(names)))
    if not names:
        raise FormatError(f"{path}: line 4 names no markers; it must be Frame#, Time, a name per 3 cells")
    return names, at


def _rows(path: Path, lines: list[str], width: int) -> tuple[list[FloatArray], int, list[str]]:
    """Frame number, time and coordinates (`width`,) of each row, how many trajectories without names are behind them,
    and sentences about what was left out."""
    rows, more, spaces = [], 0, 0
    body = lines[5:]
    # Beside points, a comma separates thousands.
    decimal = "," if any("," in line for line in body) and not any("." in line for line in body) else "."
    for number, line in enumerate(body, start=6):
        if not line.strip():
            continue
        cells = line.split("\t")
        if len(cells) == 1 or any(" " in cell.strip() for cell in cells):
            cells, spaces = line.split(), spaces + 1
            if len(cells) < width or (len(cells) - width) % 3:
                raise FormatError(
                    f"{path}: line {number} has spaces between its numbers, which show no empty cells: {len(cells)} "
                    f"numbers, and {width} are needed; separate them by tabs"
                )
        elif number == len(lines) and len(cells) < width:
            raise FormatError(f"{path}: line {number} ends before its last marker: the file is cut off; export it anew")
        beyond = [i for i, cell in enumerate(cells[width:], start=1) if cell.strip()]
        if beyond and beyond[-1] % 3:
            raise FormatError(f"{path}: line {number} has more cells than the markers of line 4 need")
        more = max(more, max(beyond, default=0) // 3)
        rows.append(_row(path, number, cells[:width], width, decimal))
    notices = []
    if more:
        notices.append(_left_out(more, "behind"))
    if spaces:
        notices.append(f"spaces, not tabs, are between the numbers of {spaces} of {len(rows)} rows")
    return rows, more, notices


def _row(path: Path, number: int, cells: list[str], width: int, decimal: str) -> FloatArray:
    """Cells as numbers (`width`,); NaN where a cell is empty, or where the first two are no numbers."""
    out = np.full(width, np.nan)
    for i, cell in enumerate(cells):
        if not cell.strip():
            continue
        try:
            out[i] = float(cell.replace(",", ".") if decimal == "," else cell)
        except ValueError:
            if i >= 2:
                raise FormatError(
                    f"{path}: line {number}, cell {i + 1}: {cell.strip()!r} is no number; empty means missing"
                ) from None
    return out
