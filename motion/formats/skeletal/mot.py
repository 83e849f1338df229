"""OpenSim's `.mot`: a text table of coordinates over time (see `opensim` for which they are), angles in degrees."""

from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.opensim import Coordinates, coordinates_of
from muybridge.motion.formats.skeletal.rigid import with_rigid_bones


def write_mot(path: Path, motion: Motion) -> None:
    """Write joint angles.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up.

    Raises:
        FormatError: a joint slides, or there are several roots.
        OutputError: the file cannot be written.
    """
    found = coordinates_of(with_rigid_bones(path, motion))
    values = np.where([_is_length(n) for n in found.names], found.values, np.degrees(found.values))
    lines = [
        "Coordinates", "version=1", f"nRows={len(values)}", f"nColumns={values.shape[1] + 1}", "inDegrees=yes", "",
        "Written by muybridge. Units are S.I. units (second, metres), angles are in degrees.", "endheader",
        "\t".join(["time", *found.names]),
    ]  # fmt: skip
    table = np.column_stack([found.times, values]) + 0.0
    lines += ["\t".join(f"{v:.8f}" for v in row) for row in table]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def read_mot(path: Path) -> Coordinates:
    """Read a table of coordinates.

    Raises:
        FormatError: malformed; the message names the line.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror}); give an existing .mot file") from error
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    end = next((i for i, line in enumerate(lines) if line.strip().lower() == "endheader"), None)
    if end is None:
        raise FormatError(f"{path}: has no line `endheader`; is it a .mot or .sto file, and whole?")
    head = dict(line.partition("=")[::2] for line in lines[:end] if "=" in line)
    facts = {k.strip().lower(): v.strip().lower() for k, v in head.items()}
    at = next((i for i in range(end + 1, len(lines)) if lines[i].strip()), None)
    names = lines[at].split() if at is not None else []
    if at is None or len(names) < 2 or names[0].lower() != "time":
        raise FormatError(f"{path}: line {(at or end) + 1} must name the columns, `time` first; export it again")
    if len(set(names)) != len(names):
        raise FormatError(f"{path}: line {at + 1} names a column twice; rename one of them")
    rows = []
    for number, line in enumerate(lines[at + 1 :], start=at + 2):
        if line.strip():
            rows.append(_row(path, number, line.split(), len(names)))
    stated = facts.get("nrows", str(len(rows)))
    if not rows or stated != str(len(rows)):
        raise FormatError(f"{path}: announces {stated} rows and has {len(rows)}; is it cut off?")
    table = np.array(rows)
    if (np.diff(table[:, 0]) <= 0).any():
        raise FormatError(f"{path}: its times do not rise; sort the rows")
    values = table[:, 1:]
    if facts.get("indegrees", "yes") == "yes":
        values = np.where([_is_length(n) for n in names[1:]], values, np.radians(values))
    return Coordinates(tuple(names[1:]), table[:, 0], values)


def _row(path: Path, number: int, cells: list[str], count: int) -> FloatArray:
    try:
        row = np.array([float(c) for c in cells])
    except ValueError:
        row = np.full(1, np.nan)
    if len(row) != count or not (np.abs(row) < 1e12).all():
        raise FormatError(f"{path}: line {number} must have {count} finite numbers; correct the line")
    return row


def _is_length(name: str) -> bool:
    return name.endswith(("_tx", "_ty", "_tz"))
