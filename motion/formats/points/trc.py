"""TRC, the tab-separated marker file of Motion Analysis that OpenSim reads.

Y is up in it, as OpenSim wants: x_trc = y_world, y_trc = z_world, z_trc = x_world. The header has the eight
keys that OpenSim insists on, and every cell ends with a tab, because OpenSim counts the cells of a row and
drops a last one that is empty. A missing point is three empty cells.
"""

import math
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.common import (
    METRES_OF_UNIT,
    UP_PERMUTATION,
    check_unit,
    check_up,
    frames_of_rows,
    in_frames,
    points_of_file,
    read_text,
)

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
    return read_trc_from(path, unit, up, fps)[0]


def read_trc_from(
    path: Path, unit: str | None = None, up: str = "y", fps: float | None = None
) -> tuple[Points3D, float]:
    """The points as `read_trc` has them, and the first frame's time in seconds, 0 where it has none."""
    path = Path(path)
    lines = read_text(path, "TRC").split("\n")
    if not lines or not lines[0].startswith("PathFileType") or len(lines) < 5:
        raise FormatError(f"{path}: line 1 must begin with PathFileType, 5 lines of header in all; is it a TRC?")
    head = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    head = {key.strip(): value.strip() for key, value in head.items()}
    rate = fps or _header_number(path, head, "DataRate")
    metres = METRES_OF_UNIT[check_unit(path, unit or head.get("Units", ""), "line 3: Units")]
    names = [name.strip() for name in lines[3].split("\t")[2:] if name.strip()]
    if not names:
        raise FormatError(f"{path}: line 4 names no markers; it must be Frame#, Time, a name per 3 cells")
    if head.get("NumMarkers") not in (None, str(len(names))):
        raise FormatError(
            f"{path}: line 3 states {head['NumMarkers']} markers, line 4 names {len(names)}; correct NumMarkers"
        )
    rows = [_row(path, i, line, len(names)) for i, line in enumerate(lines[5:], start=6) if line.strip()]
    if rows and lines[-1].strip() and lines[-1].count("\t") + 1 < 2 + 3 * len(names):
        raise FormatError(f"{path}: line {len(lines)} ends before its last marker: the file is cut off; export it anew")
    table = np.array(rows, dtype=np.float64).reshape(len(rows), 2 + 3 * len(names))
    table = in_frames(table, frames_of_rows(path, table[:, 0], table[:, 1], fps))
    announced = head.get("NumFrames", "")
    if rows and announced.isdecimal() and int(announced) > len(table):
        raise FormatError(f"{path}: line 3 states {announced} frames, {len(rows)} rows follow: the file is cut off; "
                          "export it again, or correct NumFrames")  # fmt: skip
    xyz = table[:, 2:].reshape(len(table), len(names), 3)
    xyz[~np.all(np.abs(xyz) < 1e12, axis=-1)] = np.nan
    points = points_of_file(path, names, xyz[..., UP_PERMUTATION[check_up(up)]] * metres, rate, "trc")
    if not rows:
        raise FormatError(f"{path}: has no row of points after its header; is it cut off?")
    return points, float(np.nan_to_num(table[0, 1]))


def _header_number(path: Path, head: dict[str, str], key: str) -> float:
    try:
        value = float(head[key])
    except (KeyError, ValueError):
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise FormatError(f"{path}: line 3: {key} is {head.get(key, 'missing')!r}; give a number above zero")
    return value


def _row(path: Path, number: int, line: str, markers: int) -> FloatArray:
    """Frame number, time and coordinates; NaN where a cell is empty, or where the first two are no numbers."""
    cells = line.split("\t")
    if any(cell.strip() for cell in cells[2 + 3 * markers :]):
        raise FormatError(f"{path}: line {number} has more cells than the {markers} markers of line 4 need")
    out = np.full(2 + 3 * markers, np.nan)
    for i, cell in enumerate(cells[: len(out)]):
        if not cell.strip():
            continue
        try:
            out[i] = float(cell)
        except ValueError:
            if i >= 2:
                raise FormatError(
                    f"{path}: line {number}, cell {i + 1}: {cell.strip()!r} is no number; empty means missing"
                ) from None
    return out
