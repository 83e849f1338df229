"""Kinds of file that are an `.npz` of plain arrays, the first of which is a description in JSON."""

import io
import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.npz import load_npz

_T = TypeVar("_T")


@dataclass(frozen=True)
class DescribedFile:
    """A kind of file.

    Attributes:
        mark: name of the array that holds the description; in a file's first bytes it says that muybridge wrote it.
        what: the kind with its article, for messages.
        remedy: key of what to do about a file that is none of these, which needs no details.
        version: that is written and read.
        most_bytes: that all arrays of a file together may take.
        packed: whether the arrays are compressed.
    """

    mark: str
    what: str
    remedy: str
    version: int = 1
    most_bytes: int = 2**30
    packed: bool = False

    def write(self, path: Path, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a description and arrays; equal ones give equal files.

        Raises:
            OutputError: the file cannot be written.
        """
        text = np.frombuffer(json.dumps({"version": self.version, **about}).encode(), np.uint8)
        with replacing(Path(path)) as temporary, zipfile.ZipFile(temporary, "w") as archive:
            for name, array in {self.mark: text, **arrays}.items():
                data = io.BytesIO()
                np.lib.format.write_array(data, np.ascontiguousarray(array), allow_pickle=False)
                entry = zipfile.ZipInfo(f"{name}.npy")  # of one date
                packed = self.packed and name != self.mark
                entry.compress_type = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
                archive.writestr(entry, data.getbuffer())

    def read(self, path: Path, make: Callable[[dict[str, Any], dict[str, NDArray[Any]]], _T]) -> _T:
        """What `make` makes of a file's description and arrays; what it cannot use, it says with a ValueError.

        Raises:
            FormatError: it is no such file, of another version, or damaged.
        """
        path, kind, remedy = Path(path), self.what.partition(" ")[2], self.remedy
        if path.is_file() and not zipfile.is_zipfile(path):
            raise FormatError(f"{path}: is no {kind}", remedy=remedy)
        arrays = load_npz(path, what=self.what, limit=self.most_bytes)
        if self.mark not in arrays:
            raise FormatError(f"{path}: is no {kind}", remedy=remedy)
        try:
            about = json.loads(arrays[self.mark].astype(np.uint8).tobytes())
            version = about["version"]
        except (ValueError, KeyError, TypeError) as problem:
            raise FormatError(f"{path}: the description of the {kind} cannot be read") from problem
        if version != self.version:
            raise FormatError(f"{path}: is {self.what} of version {version!s:.20}; this muybridge reads version "
                              f"{self.version}", remedy=remedy)  # fmt: skip
        try:
            return make(about, arrays)
        except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError) as problem:
            raise FormatError(f"{path}: is damaged as {self.what} ({problem!s:.200})") from problem
