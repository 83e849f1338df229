"""Renders that are made while a network is trained on them, by processes of their own."""

import _thread
import contextlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

from rich.console import Console

from muybridge.errors import SessionError
from muybridge.files import replacing
from muybridge.train.engine.process_pool import affordable_processes
from muybridge.train.synthesis.rendering.store import MEMORY, make_renders, shard_numbers

# Lies in a store as long as such a process has work left, so that a killed training's successor takes it up. Stores
# that `muybridge synth` made are left as they are.
PLAN = "unfinished.json"
_ERRORS = "unfinished.log"


class RenderWorker:
    """A store's missing shards in the making, as long as the object is open (a context manager).

    Args:
        folder: the store. Where it has shards, and not from such a process that was interrupted, nothing is made.
        shards: how many there shall be; none are made for 0.
        seed: of the renders; one that was interrupted keeps its own.

    Raises:
        SessionError: the plan of one that was interrupted cannot be read.
    """

    def __init__(self, folder: pathlib.Path, shards: int, seed: int) -> None:
        self.folder, self.shards = folder, shards
        self._process: subprocess.Popen[bytes] | None = None
        if shards and not shard_numbers(folder) and not (folder / PLAN).exists():
            with replacing(folder / PLAN) as temporary:
                temporary.write_text(json.dumps({"shards": shards, "seed": seed}))
        if shards and (folder / PLAN).exists():
            self.shards, seed = _read_plan(folder / PLAN)
            self._process = _start(folder, self.shards, seed)

    @property
    def making(self) -> bool:
        """Whether anything is being made."""
        return self._process is not None

    def __enter__(self) -> "RenderWorker":
        return self

    def __exit__(self, *_: object) -> None:
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._process.wait()
            if self._process.returncode == 0:
                (self.folder / _ERRORS).unlink(missing_ok=True)

    def wait_for(self, shards: int) -> None:
        """Returns when the store has so many shards, or when nothing is being made.

        Raises:
            SessionError: the process that makes them ended early.
        """
        shards, began = min(shards, self.shards), time.monotonic()
        if self._process is None or len(shard_numbers(self.folder)) >= shards:
            return
        with Console().status("") as status:
            while (there := len(shard_numbers(self.folder))) < shards:
                status.update(f"{self.folder}: {there} of the first {shards} shards of renders, "
                              f"{time.monotonic() - began:.0f} s")  # fmt: skip
                if self._process.poll() is not None and len(shard_numbers(self.folder)) < shards:
                    log = self.folder / _ERRORS
                    last = (log.read_text(errors="replace").strip().splitlines() or ["it says nothing"])[-1]
                    raise SessionError(f"{self.folder}: no more renders are made: {last} (all of it in {log})")
                time.sleep(0.5)


def _read_plan(path: pathlib.Path) -> tuple[int, int]:
    try:
        plan = json.loads(path.read_text())
        return int(plan["shards"]), int(plan["seed"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(
            f"{path}: does not say which renders are still to be made; remove it to train on what there is, or go on "
            "with `muybridge synth`"
        ) from error


def _start(folder: pathlib.Path, shards: int, seed: int) -> "subprocess.Popen[bytes]":
    there = len(shard_numbers(folder))
    print(f"{folder}: {there} of {shards} shards of renders; the others are made while training goes on", flush=True)
    with (folder / _ERRORS).open("wb") as log:
        return subprocess.Popen(_command(folder, shards, seed), stdin=subprocess.PIPE, stdout=log, stderr=log)


def _command(folder: pathlib.Path, shards: int, seed: int) -> list[str]:
    return [sys.executable, "-m", "muybridge.train.synthesis.rendering.worker", str(folder), str(shards), str(seed)]


def main(folder: pathlib.Path, shards: int, seed: int) -> None:
    """Makes a store's missing shards, at low priority: whatever trains on them comes first. Ends when nobody holds the
    other end of its input any more, however its parent ended."""

    def wait_for_end() -> None:
        sys.stdin.buffer.read()
        if hasattr(signal, "pthread_kill"):  # which wakes a thread that waits for processes, too
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        else:
            _thread.interrupt_main()

    # A shell's background jobs, and all that they start, ignore the interrupt, and Python's own then does nothing.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=wait_for_end, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(5)
    with contextlib.suppress(KeyboardInterrupt):  # what is half written is removed
        make_renders(folder, range(shards), seed, processes=affordable_processes(MEMORY))
        (folder / PLAN).unlink(missing_ok=True)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
