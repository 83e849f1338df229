"""Finished stages on disk, so that a run that was stopped goes on from the last of them.

A stage's result is one `.npz`, written under a temporary name and renamed, that carries the key it was
computed for: a digest of everything that went in (options, input files, networks, the code itself). A result
is used again only under the same key.
"""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.files import replacing


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
        named: dict[str, Any] = {f"array_{n}": a for n, a in arrays.items()}
        with replacing(self.folder / f"{stage}.npz") as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, stage=np.array(head), **named)
        return StageResult(dict(arrays), dict(facts), seconds, False, key)
