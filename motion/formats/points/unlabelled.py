"""Recordings of points without labels, or with wrong ones: C3D, TRC and CSV.

Other readers insist on labels that are there once; here a label is only a hint, and whatever a file calls its points
is kept beside them.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError, parsing
from muybridge.geometry.landmarks.real_markers import LISTS, find_markers
from muybridge.motion.formats.points.c3d_read import RawC3D, read_raw_c3d
from muybridge.motion.formats.points.columns import FRAMES, TIMES, placed, rate_of
from muybridge.motion.formats.points.common import METRES_OF_UNIT, UNIT_WORDS, UP_PERMUTATION, check_unit
from muybridge.motion.formats.points.tables.layouts import read_layout
from muybridge.motion.formats.points.tables.sheet import read_sheet
from muybridge.motion.formats.points.trc import trc_trajectories
from muybridge.motion.formats.points.world import Trajectories, check_reach, stated_unit, take_out_zeros

_NAME = re.compile(rf"^(.*?)[\s_.:\-]*\(?([xyz])\)?(?:\s*[\[(]?({'|'.join(UNIT_WORDS)})[\])]?)?$", re.IGNORECASE)


@dataclass(frozen=True)
class MarkerCloud:
    """Points as a file has them.

    Attributes:
        points: (T, K, 3) in the file's axes, metres by the unit that the file states (as they are where it states
            none); NaN where missing.
        names: (K,) what the file calls them, prefixes of subjects included.
        fps: frames per second; NaN where the file does not state it.
        unit: the unit that the file states, "" where it states none.
        left_out: names of what is stored as points and is no marker (angles, joint centres, segment axes).
        why: one sentence on what is left out, empty where that is nothing.
        empty: names of trajectories without a single point.
        metres: how long a unit of the file is by what it states.
        notices: what was assumed or left out in reading, one sentence each.
        c3d: the file, where it is a C3D.
    """

    points: FloatArray
    names: tuple[str, ...]
    fps: float
    unit: str
    left_out: tuple[str, ...] = ()
    empty: tuple[str, ...] = ()
    metres: float = 1.0
    notices: tuple[str, ...] = ()
    c3d: RawC3D | None = None
    why: str = ""


def read_marker_cloud(path: Path, fps: float | None = None) -> MarkerCloud:
    """Points of a C3D, TRC or CSV file; trajectories without a single point are left out.

    Args:
        path: the file.
        fps: frames per second, overriding the file; None for what the file states.

    Raises:
        FormatError: the file is missing, truncated, of no known kind, or holds no points.
    """
    path = Path(path)
    readers = {".c3d": _read_c3d, ".trc": _read_trc, ".csv": _read_csv, ".tsv": _read_csv, ".txt": _read_csv}
    if path.suffix.lower() not in readers:
        raise FormatError(f"{path}: not a kind of point file; valid are {', '.join(readers)}")
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing C3D, TRC or CSV file")
    with parsing(path, FormatError, "a file of points"):
        cloud = _markers_of(path, readers[path.suffix.lower()](path, fps))
    points, rate = cloud.points, cloud.fps if np.isfinite(cloud.fps) else 0.0
    said = take_out_zeros(cloud.names, points, rate)
    points[~np.isfinite(points).all(axis=-1) | (points == 0).all(axis=-1)] = np.nan
    check_reach(path, cloud.names, points, None)
    cloud = replace(cloud, notices=(*cloud.notices, *said))
    there = np.atleast_1d(np.isfinite(cloud.points[..., 0]).any(0))
    if not there.any():
        raise FormatError(f"{path}: holds no points: its {len(there)} trajectories are empty; export the markers")
    names = np.array(cloud.names, object)
    return replace(cloud, points=cloud.points[:, there], names=tuple(names[there]), empty=tuple(names[~there]))


def _markers_of(path: Path, cloud: MarkerCloud) -> MarkerCloud:
    """The points that may be markers."""
    listed = [] if cloud.c3d is None else [name for key in LISTS for name in cloud.c3d.texts("POINT", key)]
    kinds = find_markers(cloud.names, listed)
    if len(cloud.names) and not kinds.marker.any():
        raise FormatError(
            f"{path}: holds no markers, only {', '.join(cloud.names[:4])} and the like; export the markers"
        )
    names = np.array(cloud.names, object)
    return replace(cloud, points=cloud.points[:, kinds.marker], names=tuple(names[kinds.marker]),
                   left_out=tuple(names[~kinds.marker]), why=kinds.note)  # fmt: skip


def _read_c3d(path: Path, fps: float | None) -> MarkerCloud:
    raw = read_raw_c3d(path)
    frames, count = raw.points.shape[:2]
    if not count or not frames:
        analog = raw.analog.shape[1]
        also = f", only {analog} analog channels" if analog else ""
        raise FormatError(f"{path}: holds no points{also}; export the markers into it")
    names = [name.strip() for name in raw.texts("POINT", "LABELS")]
    names = [*names, *(f"*{k}" for k in range(len(names), count))][:count]
    unit = (raw.texts("POINT", "UNITS") or [""])[0].strip()
    unit = check_unit(path, unit, "POINT:UNITS") if unit else ""
    xyz = np.array(raw.points, np.float64)
    xyz[raw.residuals < 0] = np.nan
    fps = fps or (raw.fps if raw.fps > 0 else float("nan"))
    metres = METRES_OF_UNIT.get(unit, 1.0)
    return MarkerCloud(xyz * metres, tuple(names), fps, unit, metres=metres, notices=raw.notices, c3d=raw)


def _read_trc(path: Path, fps: float | None) -> MarkerCloud:
    with parsing(path, FormatError, "a TRC"):
        found = trc_trajectories(path, fps=fps)
    return _cloud_of(replace(found, xyz=found.xyz[..., UP_PERMUTATION[found.up]]))


def _cloud_of(found: Trajectories) -> MarkerCloud:
    """Trajectories in metres, where the file states a unit; their axes are kept."""
    unit, assumed = stated_unit(found)
    metres = METRES_OF_UNIT.get(unit, 1.0)
    notices = (*found.notices, *assumed)
    return MarkerCloud(found.xyz * metres, found.names, found.fps, unit, metres=metres, notices=notices)


def _read_csv(path: Path, fps: float | None) -> MarkerCloud:
    sheet = read_sheet(path)
    found = read_layout(sheet, fps)
    if found is not None:
        return _cloud_of(found if fps is None else replace(found, fps=fps))
    head = sheet.rows[0]
    triples, unit = _triples(head)
    if not triples:
        raise FormatError(
            f"{path}: line 1 names no points: each needs three columns that end in x, y and z, such as U1_x, U1_y, U1_z"
        )
    rows = [i for i, row in enumerate(sheet.rows) if i and any(row)]
    if not rows:
        raise FormatError(f"{path}: has a header and no frames; export it again")
    plain = [name.lower() for name in head]
    frame, time = (next((plain.index(k) for k in keys if k in plain), None) for keys in (FRAMES, TIMES))
    used = [*(i for i in (frame, time) if i is not None), *(i for _, at in triples for i in at)]
    table = sheet.numbers(rows, used)
    numbers = None if frame is None else table[:, 0]
    times = None if time is None else table[:, used.index(time)]
    table, times = placed(path, table, numbers, times, fps)
    rate = fps or (rate_of(path, times) if times is not None and len(times) > 1 else float("nan"))
    xyz = table[:, len(used) - 3 * len(triples) :].reshape(len(table), -1, 3) * METRES_OF_UNIT.get(unit, 1.0)
    return MarkerCloud(xyz, tuple(n for n, _ in triples), rate, unit)


def _triples(head: list[str]) -> tuple[list[tuple[str, tuple[int, int, int]]], str]:
    """Names with the columns of x, y and z, and the unit if the header has it."""
    found: dict[str, dict[str, int]] = {}
    unit = ""
    for i, name in enumerate(head):
        match = _NAME.match(name)
        if match:
            found.setdefault(match[1], {})[match[2].lower()] = i
            unit = UNIT_WORDS[match[3].lower()] if match[3] else unit
    return [(n, (c["x"], c["y"], c["z"])) for n, c in found.items() if len(c) == 3], unit
