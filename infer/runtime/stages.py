"""Finished stages on disk, so that a run that was stopped goes on from the last of them.

A stage's result is one `.npz`, written under a temporary name and renamed, that carries the key it was
computed for: a digest of everything that went in (options, input files, networks, the code itself). A result
is used again only under the same key.
"""

import dataclasses
import functools
import hashlib
import importlib.util
import json
import os
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.errors import OutputError


@dataclass(frozen=True)
class StageResult:
    """What a stage found.

    Attributes:
        arrays: by name.
        facts: anything that JSON can hold.
        seconds: how long it took to compute, also where it was read from disk.
        resumed: whether it was read from disk.
        key: what it was computed for.
    """

    arrays: Mapping[str, NDArray[Any]]
    facts: Mapping[str, Any]
    seconds: float
    resumed: bool
    key: str


def partial_name(path: Path) -> Path:
    """The hidden temporary name beside `path`, of the same type, under which this process writes it."""
    return path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file and rename it to `path` when it is complete.

    Raises:
        OutputError: the folder cannot be written or is full.
    """
    partial = partial_name(path)
    try:
        write(partial)
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise OutputError(f"{path} cannot be written ({reason}); choose another --out or free its disk") from None
    finally:
        partial.unlink(missing_ok=True)


class StageStore:
    """Results of stages in one folder."""

    def __init__(self, folder: Path):
        """`folder` must exist."""
        self.folder = folder

    def holds(self, stage: str, key: str) -> bool:
        """Whether a stage's result for this key is stored; its arrays are not read."""
        try:
            with np.load(self.folder / f"{stage}.npz", allow_pickle=False) as stored:
                return bool(json.loads(str(stored["stage"]))["key"] == key)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return False

    def load(self, stage: str, key: str) -> StageResult | None:
        """The stored result of a stage, or None where there is none for this key."""
        path = self.folder / f"{stage}.npz"
        try:
            with np.load(path, allow_pickle=False) as stored:
                head = json.loads(str(stored["stage"]))
                if head["key"] != key:
                    return None
                arrays = {name[6:]: stored[name] for name in stored.files if name.startswith("array_")}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None
        return StageResult(arrays, head["facts"], head["seconds"], True, key)

    def save(
        self,
        stage: str,
        key: str,
        arrays: Mapping[str, NDArray[Any]],
        facts: Mapping[str, Any],
        seconds: float,
    ) -> StageResult:
        """Store a stage's result under its key."""
        head = json.dumps({"key": key, "facts": dict(facts), "seconds": seconds})

        def write(path: Path) -> None:
            with path.open("wb") as file:
                named: dict[str, Any] = {f"array_{n}": a for n, a in arrays.items()}
                np.savez_compressed(file, stage=np.array(head), **named)

        write_whole(self.folder / f"{stage}.npz", write)
        return StageResult(dict(arrays), dict(facts), seconds, False, key)


def digest(*parts: Any) -> str:
    """SHA-256 of values: dataclasses, arrays, paths, mappings, sequences and plain values."""
    text = json.dumps([_plain(p) for p in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@functools.cache
def code_digest(*modules: str) -> str:
    """SHA-256 of the sources of modules, and of all modules in those that are packages; none is imported.

    Read once in a process: what runs is what was there when it started.
    """
    total = hashlib.sha256()
    for name in modules:
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            raise ValueError(f"no module {name}")
        origin = Path(spec.origin)
        files = sorted(origin.parent.rglob("*.py")) if spec.submodule_search_locations else [origin]
        for file in files:
            total.update(file.name.encode())
            total.update(file.read_bytes())
    return total.hexdigest()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, **fields}
    if isinstance(value, np.ndarray):
        data = np.ascontiguousarray(value)
        return [str(data.dtype), list(data.shape), hashlib.sha256(data.tobytes()).hexdigest()]
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if value is None or isinstance(value, (str, int, float, bool)):
        return value
    return str(value)
