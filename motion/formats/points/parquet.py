"""Points as Parquet, through pyarrow: the columns of `muybridge.motion.formats.points.columns` in double precision.

The frame rate, the unit and the landmark set are in the schema's metadata.
"""

from pathlib import Path
from typing import Any

import numpy as np

from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.motion.formats.points.columns import columns_of, points_of


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
    return read_parquet_from(path, fps, unit, up)[0]


def read_parquet_from(
    path: Path, fps: float | None = None, unit: str | None = None, up: str | None = None
) -> tuple[Points3D, float]:
    """The points as `read_parquet` has them, and the first frame's time in seconds, 0 where there are no times."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    try:
        table = pq.read_table(path)
        columns: dict[str, Any] = {n: table.column(i).to_pylist() for i, n in enumerate(table.column_names)}
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({str(error).splitlines()[0]}); give a Parquet file") from error
    except (pa.ArrowException, ValueError, MemoryError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"{path}: is not readable as Parquet ({reason}); export it again") from error
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
    return points_of(path, columns, fps, unit or facts.get("unit") or None, up)
