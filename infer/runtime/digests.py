"""Digests of values, files and code: what the key of a stored stage is made of."""

import dataclasses
import functools
import hashlib
import importlib.util
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

# A file up to this many blocks is read whole by `sampled_digest`; of a larger one, this many blocks.
_BLOCK, _BLOCKS = 2**18, 64
# Files of a package that decide what it computes; networks are too large to read and have digests of their own.
_SOURCES = ("*.py", "*.npz", "*.toml")


def digest(*parts: Any) -> str:
    """SHA-256 of values: dataclasses, arrays, paths, mappings, sequences and plain values."""
    text = json.dumps([_plain(p) for p in parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sampled_digest(path: Path) -> str:
    """SHA-256 of a file's size and content: all of it up to 16 MiB, beyond that 64 blocks from its first to its last
    byte. Its name and times do not count, so that a copy on another computer has the same digest."""
    size = path.stat().st_size
    total = hashlib.sha256(str(size).encode())
    with path.open("rb") as file:
        if size <= _BLOCK * _BLOCKS:
            total.update(file.read())
        else:
            for k in range(_BLOCKS):
                file.seek(k * (size - _BLOCK) // (_BLOCKS - 1))
                total.update(file.read(_BLOCK))
    return total.hexdigest()


@functools.cache
def code_digest(*packages: str) -> str:
    """SHA-256 of the sources of whole packages, with the arrays and tables that belong to them.

    Nothing is imported. Sources are read once per process: what runs is what was there when it started.

    Raises:
        ValueError: no such package.
    """
    total = hashlib.sha256()
    for name in packages:
        spec = importlib.util.find_spec(name)
        if spec is None or not spec.submodule_search_locations:
            raise ValueError(f"no package {name}")
        for folder in map(Path, spec.submodule_search_locations):
            for file in sorted(file for pattern in _SOURCES for file in folder.rglob(pattern)):
                total.update(f"{name}/{file.relative_to(folder).as_posix()}\n".encode())
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
