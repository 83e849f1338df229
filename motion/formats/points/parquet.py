"""Points as Parquet, through pyarrow: the columns of `muybridge.motion.formats.points.columns` in double precision.

The frame rate, the unit and the landmark set are in the schema's metadata.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.columns import columns_of, trajectories_of
from muybridge.motion.formats.points.common import check_unit, check_up
from muybridge.motion.formats.points.world import PointsOfFile, points_of_file


def write_parquet(path: Path, points: Points3D) -> None:
    """Write one row per frame in metres, Z up; what is missing is null.

    Raises:
        OutputError: the file cannot be written.
        ModuleNotFoundError: pyarrow, the extra `parquet`, is not installed.
    """
    import pyarrow as pa  # here, since it is an extra
    import pyarrow.parquet as pq

    columns = columns_of(points)
    arrays = [pa.array(v, mask=np.isnan(v)) for v in columns.values()]
    facts = {"fps": repr(float(points.fps)), "unit": "m", "up": "z", "landmarks": points.landmarks.name}
    table = pa.table(arrays, names=list(columns)).replace_schema_metadata(facts)
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def read_parquet(path: Path, fps: float | None = None, unit: str | None = None, up: str | None = None) -> Points3D:
    """Read points into metres, Z up.

    Args:
        path: the file.
        fps: frames per second; None for what the metadata or a column of times give.
        unit: m, cm or mm; None for what metadata or column names state, metres where they state none.
        up: y or z; None for what the metadata state, else z.

    Raises:
        FormatError: the file is malformed or holds no points.
        ModuleNotFoundError: pyarrow, the extra `parquet`, is not installed.
    """
    return read_parquet_from(path, fps, unit, up).points


def read_parquet_from(
    path: Path, fps: float | None = None, unit: str | None = None, up: str | None = None
) -> PointsOfFile:
    """The points as `read_parquet` has them, the first frame's time, and what was left out."""
    import pyarrow  # noqa: F401  # here and outside of the context, since it is an extra

    path, up = Path(path), None if up is None else check_up(up)
    with parsing(path, FormatError, "a Parquet file"):
        return _points(path, fps, unit, up)


def _points(path: Path, fps: float | None, unit: str | None, up: str | None) -> PointsOfFile:
    import pyarrow.parquet as pq

    with path.open("rb") as file:  # pq.read_table refuses columns of one name
        table = pq.ParquetFile(file).read()
    columns = [(str(name), table.column(i).to_pylist()) for i, name in enumerate(table.column_names)]
    metadata = (table.schema.metadata or {}).items()
    facts = {k.decode("utf-8", "replace"): v.decode("utf-8", "replace") for k, v in metadata}
    stated = facts.get("fps", "")
    if fps is None and stated:
        try:
            fps = float(stated)
        except ValueError:
            fps = float("nan")
        if not 0 < fps < 1e9:
            raise FormatError(f"{path}: its metadata state {stated!r} frames per second; it must be above zero")
    up = up or facts.get("up", "z")
    if up not in ("y", "z"):
        raise FormatError(f"{path}: its metadata state that {up!r} is up; valid are y, z")
    found = trajectories_of(path, columns, fps)
    found = replace(found, unit=check_unit(path, facts.get("unit") or found.unit or "m", "the unit"))
    return points_of_file(path, found, "table", unit, up, fps)
