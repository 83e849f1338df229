"""NumPy's `.npz` read without trust: sizes are checked before anything is allocated, and nothing in the file is run.

`numpy.load` allocates what a header declares, hands out entries that are no arrays as bytes, and ignores the check sum
of an entry that is longer than its array.
"""

import math
import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError, MuybridgeError, parsing

# Bytes that the arrays of a file may take, all together.
LIMIT = 2**32
# Measured data shrink a few times. What is larger than this and shrinks so many times is no measurement.
_ANY_RATIO, _RATIO = 2**26, 100
_CHUNK = 2**22


def load_npz(
    path: Path,
    names: Collection[str] | None = None,
    *,
    error: type[MuybridgeError] = FormatError,
    what: str = "an .npz",
    limit: int | None = None,
) -> dict[str, NDArray[Any]]:
    """The arrays of a file, at the cost of no more memory than they take.

    Args:
        path: the file.
        names: arrays to read; the others are left unread. None for all.
        error: kind of error to raise.
        what: the file's format with its article, for messages.
        limit: bytes that all arrays of the file together may take. None for `LIMIT`, and for 100 times the size of
            the file where that is more than 64 MiB.

    Returns:
        Arrays by name, those of `names` that are there. Entries of the archive that are not `.npy` are ignored.

    Raises:
        MuybridgeError: of kind `error`: the file cannot be read, is damaged, holds objects or declares more data.
    """
    path = Path(path)
    with parsing(path, error, what), zipfile.ZipFile(path) as archive:
        entries = {i.filename[:-4]: i for i in archive.infolist() if i.filename.endswith(".npy")}
        declared = sum(i.file_size for i in archive.infolist())
        most = limit if limit is not None else min(LIMIT, max(_ANY_RATIO, _RATIO * path.stat().st_size))
        if declared > most:
            raise error(
                f"{path}: declares {_megabytes(declared)} of data, and {_megabytes(most)} at most are read from "
                f"{what} of {_megabytes(path.stat().st_size)}", remedy="npz_limit"
            )  # fmt: skip
        out = {}
        for name, entry in entries.items():
            if names is None or name in names:
                with archive.open(entry) as file:
                    out[name] = _array(file, entry)
        return out


def _megabytes(size: int) -> str:
    return f"{size / 1e6:,.1f} MB"


def _array(file: IO[bytes], entry: zipfile.ZipInfo) -> NDArray[Any]:
    """The array of an entry, whose header and size agree.

    Raises:
        ValueError: they do not, or the entry holds objects.
    """
    shape, columns_first, dtype = _header(file, entry.filename)
    count = math.prod(shape)
    here = entry.file_size - file.tell()
    if dtype.hasobject or dtype.names is not None:
        raise ValueError(f"{entry.filename} holds objects or records, which are not read")
    if min(shape, default=0) < 0 or count * dtype.itemsize != here:
        raise ValueError(f"{entry.filename} declares {dtype} {shape}, and {here} bytes follow")
    flat = np.empty(count, dtype)
    if flat.nbytes:
        view = flat.view(np.uint8).data
        for at in range(0, len(view), _CHUNK):
            chunk = file.read(min(_CHUNK, len(view) - at))
            view[at : at + len(chunk)] = chunk
    if file.read(1):  # checks the sum as well
        raise ValueError(f"{entry.filename} is longer than its array")
    return flat.reshape(shape[::-1]).T if columns_first else flat.reshape(shape)


def _header(file: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(file)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version in readers:
        try:
            return readers[version](file)
        except Exception as problem:  # NumPy parses it as Python: what that raises speaks of source code
            raise ValueError(f"the header of {name} cannot be read") from problem
    raise ValueError(f"{name} is of version {version[0]}.{version[1]} of its format; known are 1.0 and 2.0")
