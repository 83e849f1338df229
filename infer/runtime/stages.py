"""Finished stages on disk, so that a run that was stopped continues after the last of them.

A stage's result is one `.npz`, written atomically, that carries the key it was computed for: a digest of everything
that went in (options, input files, networks, the code itself). A result is used again only under the same key.
"""

import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.files import replacing
from muybridge.infer.runtime.digests import digest
from muybridge.infer.runtime.progress import Progress
from muybridge.npz import LIMIT, load_npz

_log = logging.getLogger(__name__)

Arrays = Mapping[str, NDArray[Any]]
Facts = Mapping[str, Any]


@dataclass(frozen=True)
class StageResult:
    """The result of a stage.

    Attributes:
        arrays: by name.
        facts: by name; anything that JSON can hold.
        seconds: how long it took to compute, also where it was read from disk.
        resumed: whether it was read from disk.
        key: what it was computed for.
    """

    arrays: Arrays
    facts: Facts
    seconds: float
    resumed: bool
    key: str


class StageStore:
    """Results of stages in one folder."""

    def __init__(self, folder: Path):
        """`folder` must exist."""
        self.folder = folder

    def path(self, stage: str) -> Path:
        """The file of a stage."""
        return self.folder / f"{stage}.npz"

    def holds(self, stage: str, key: str) -> bool:
        """Whether a stage's result for this key is stored; its arrays are not read."""
        try:
            stored = load_npz(self.path(stage), ["stage"], limit=LIMIT)
            return bool(json.loads(str(stored["stage"]))["key"] == key)
        except Exception:  # damage of any kind means that the stage is not stored
            return False

    def load(self, stage: str, key: str) -> StageResult | None:
        """The stored result of a stage, or None where there is none for this key."""
        path = self.path(stage)
        if not path.is_file():
            return None
        try:
            head = json.loads(str(load_npz(path, ["stage"], limit=LIMIT)["stage"]))
            if head["key"] != key:
                _log.debug("stage %s: stored for other inputs or another version; computed again", stage)
                return None
            stored = load_npz(path, limit=LIMIT)
            # By the names that were written: an entry that damage renamed is missed here and not by its user.
            arrays = {name: stored[f"array_{name}"] for name in head["arrays"]}
            return StageResult(arrays, dict(head["facts"]), float(head["seconds"]), True, key)
        except Exception as error:  # damage of any kind costs time only
            _log.info("stage %s: its file is damaged (%r); computed again", stage, error)
            return None

    def save(self, stage: str, key: str, arrays: Arrays, facts: Facts, seconds: float) -> StageResult:
        """Store a stage's result under its key.

        Raises:
            OutputError: the file cannot be written.
        """
        head = json.dumps({"key": key, "facts": dict(facts), "seconds": seconds, "arrays": list(arrays)})
        named: dict[str, Any] = {f"array_{n}": a for n, a in arrays.items()}
        with replacing(self.path(stage)) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, stage=np.array(head), **named)
        return StageResult(dict(arrays), dict(facts), seconds, False, key)


class Stages:
    """Computes the stages of a run, or reads them from the store.

    Attributes:
        done: the stages by name, in order.
    """

    def __init__(self, store: StageStore, progress: Progress, inputs: Sequence[Any]):
        """`inputs`: what all stages depend on."""
        self._store, self._progress, self._inputs = store, progress, inputs
        self.done: dict[str, StageResult] = {}

    def __call__(self, name: str, given: Any, compute: Callable[[], tuple[Arrays, Facts]]) -> StageResult:
        """The stage `name`, which also depends on `given`.

        Args:
            name: of the stage and of its file.
            given: what it depends on besides the inputs of all stages.
            compute: called where the store has no result: arrays and facts.
        """
        key = digest(name, self._inputs, given)
        result = self._store.load(name, key)
        if result is not None:
            self._progress.say(f"{name}: resumed from {self._store.path(name)}")
        else:
            self._progress.stage(name)
            start = time.perf_counter()
            arrays, facts = compute()
            result = self._store.save(name, key, arrays, facts, time.perf_counter() - start)
            self._progress.say(f"{name}: {result.seconds:.1f} s")
        self.done[name] = result
        return result
