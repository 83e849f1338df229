"""Recordings of points that nobody has named yet (or named wrongly): C3D, TRC and CSV.

Other readers insist on labels that are there once; here a label is only a hint, and whatever a file calls its points
is kept beside them.
"""

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError
from muybridge.motion.formats.c3d_read import read_raw_c3d
from muybridge.motion.formats.trc import read_trc

Float = NDArray[np.float64]
METRES_OF_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
# Parameters of POINT that list what is stored as points and is none.
_DERIVED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS")
_NO_MARKER = re.compile(r"(angles?|forces?|moments?|powers?|centreofmass|centerofmass|grf|cop)$", re.IGNORECASE)
_NAME = re.compile(r"^(.*?)[\s_.:\-]*\(?([xyz])\)?(?:\s*[\[(]?(m|cm|mm)[\])]?)?$", re.IGNORECASE)


@dataclass(frozen=True)
class MarkerCloud:
    """Points as a file has them.

    Attributes:
        points: (T, K, 3) in the file's axes, metres by the unit that the file states (as they are where it states
            none); NaN where missing.
        names: (K,) what the file calls them, prefixes of subjects included.
        fps: frames a second; NaN where the file does not say.
        unit: the unit that the file states, "" where it states none.
        left_out: names of what is stored as points and is none (angles, forces).
        empty: names of trajectories without a single point.
    """

    points: Float
    names: tuple[str, ...]
    fps: float
    unit: str
    left_out: tuple[str, ...] = ()
    empty: tuple[str, ...] = ()


def read_marker_cloud(path: Path) -> MarkerCloud:
    """Points of a C3D, TRC or CSV file; trajectories without a single point are left out.

    Raises:
        FormatError: the file is missing, truncated, of no known kind, or holds no points.
    """
    path = Path(path)
    readers = {".c3d": _read_c3d, ".trc": _read_trc, ".csv": _read_csv, ".txt": _read_csv}
    if path.suffix.lower() not in readers:
        raise FormatError(f"{path}: not a kind of point file; valid are {', '.join(readers)}")
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing C3D, TRC or CSV file")
    cloud = readers[path.suffix.lower()](path)
    there = np.atleast_1d(np.isfinite(cloud.points[..., 0]).any(0))
    if not there.any():
        raise FormatError(f"{path}: holds no points: its {len(there)} trajectories are empty; export the markers")
    names = np.array(cloud.names, object)
    return MarkerCloud(cloud.points[:, there], tuple(names[there]), cloud.fps, cloud.unit, cloud.left_out,
                       tuple(names[~there]))  # fmt: skip


def _read_c3d(path: Path) -> MarkerCloud:
    raw = read_raw_c3d(path)
    frames, count = raw.points.shape[:2]
    if not count or not frames:
        analog = raw.analog.shape[1]
        also = f", only {analog} analog channels" if analog else ""
        raise FormatError(f"{path}: holds no points{also}; export the markers into it")
    names = [name.strip() for name in raw.texts("POINT", "LABELS")]
    names = [*names, *(f"*{k}" for k in range(len(names), count))][:count]
    unit = (raw.texts("POINT", "UNITS") or [""])[0].strip().lower()
    if unit and unit not in METRES_OF_UNIT:
        raise FormatError(f"{path}: POINT:UNITS is {unit!r}; valid are {', '.join(METRES_OF_UNIT)}")
    listed = {name.strip() for key in _DERIVED for name in raw.texts("POINT", key)}
    none = np.array([n in listed or bool(_NO_MARKER.search(n.split(":")[-1])) for n in names])
    if none.all():
        raise FormatError(f"{path}: holds no markers, only {', '.join(names[:4])} and the like; export the markers")
    xyz = np.array(raw.points, np.float64)
    xyz[(raw.residuals < 0) | ~np.isfinite(xyz).all(-1) | (xyz == 0).all(-1)] = np.nan
    named = np.array(names, object)
    fps = raw.fps if raw.fps > 0 else float("nan")
    return MarkerCloud(xyz[:, ~none] * METRES_OF_UNIT.get(unit, 1.0), tuple(named[~none]), fps, unit,
                       tuple(named[none]))  # fmt: skip


def _read_trc(path: Path) -> MarkerCloud:
    points = read_trc(path)
    return MarkerCloud(points.points_world, points.landmarks.names, points.fps, "m")


def _read_csv(path: Path) -> MarkerCloud:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as text ({error}); give a comma-separated file") from error
    try:
        dialect: Any = csv.Sniffer().sniff(text[:4000], ",;\t")
    except csv.Error:
        dialect = csv.excel
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), dialect)]
    rows = [row for row in rows if any(row)]
    if not rows:
        raise FormatError(f"{path}: is empty; give a header and a row a frame")
    if rows[0][0].lower().startswith("trajectories"):
        return _vicon(path, rows)
    head = rows[0]
    triples, unit = _triples(head)
    if not triples:
        raise FormatError(
            f"{path}: line 1 names no points: each needs three columns that end in x, y and z, such as U1_x, U1_y, U1_z"
        )
    table = _numbers(path, rows[1:], len(head), 2)
    time = [i for i, name in enumerate(head) if name.lower().split("(")[0].split("[")[0].strip() in ("time", "t")]
    step = float(np.nanmedian(np.diff(table[:, time[0]]))) if time and len(table) > 1 else float("nan")
    xyz = np.stack([table[:, list(at)] for _, at in triples], 1) * METRES_OF_UNIT.get(unit, 1.0)
    xyz[~np.isfinite(xyz).all(-1)] = np.nan
    return MarkerCloud(xyz, tuple(n for n, _ in triples), 1 / step if step > 0 else float("nan"), unit)


def _triples(head: list[str]) -> tuple[list[tuple[str, tuple[int, int, int]]], str]:
    """Names with the columns of x, y and z, and the unit if the header has it."""
    found: dict[str, dict[str, int]] = {}
    unit = ""
    for i, name in enumerate(head):
        match = _NAME.match(name)
        if match:
            found.setdefault(match[1], {})[match[2].lower()] = i
            unit = (match[3] or unit).lower()
    return [(n, (c["x"], c["y"], c["z"])) for n, c in found.items() if len(c) == 3], unit


def _vicon(path: Path, rows: list[list[str]]) -> MarkerCloud:
    """Vicon Nexus' ASCII export: Trajectories, rate, names, axes, units, a row a frame."""
    try:
        fps = float(rows[1][0])
        names = [n for n in rows[2][2:] if n]
        units = {u for u in rows[4] if u}
    except (IndexError, ValueError) as error:
        raise FormatError(f"{path}: begins like Vicon's export, but its header is cut off; export it again") from error
    unit = units.pop() if len(units) == 1 else ""
    end = next((i for i, row in enumerate(rows[5:], 5) if not row[0].isdigit()), len(rows))
    table = _numbers(path, rows[5:end], 2 + 3 * len(names), 6)[:, 2:]
    xyz = table.reshape(len(table), len(names), 3) * METRES_OF_UNIT.get(unit, 1.0)
    xyz[~np.isfinite(xyz).all(-1)] = np.nan
    return MarkerCloud(xyz, tuple(names), fps, unit)


def _numbers(path: Path, rows: list[list[str]], width: int, first: int) -> Float:
    out = np.full((len(rows), width), np.nan)
    for i, row in enumerate(rows):
        for j, cell in enumerate(row[:width]):
            if cell and cell.lower() not in ("nan", "na"):
                try:
                    out[i, j] = float(cell)
                except ValueError:
                    raise FormatError(f"{path}: line {i + first}, cell {j + 1}: {cell!r} is no number; empty means "
                                      "missing") from None  # fmt: skip
    if not len(out):
        raise FormatError(f"{path}: has a header and no frames; export it again")
    return out
