"""Renders that child processes make while a network is trained on them."""

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

# Exists in a store while such a process has work left, so that the next training continues it. Stores that `muybridge
# synth` made are not changed.
PLAN = "unfinished.json"
_ERRORS = "unfinished.log"


class RenderWorker:
    """Renders a store's missing shards while the object is open (a context manager).

    Args:
        folder: the store. If it has shards that do not stem from an interrupted worker, nothing is made.
        shards: total number of shards; 0: none are made.
        seed: of the renders; an interrupted worker's seed is kept.

    Raises:
        SessionError: the plan of an interrupted worker cannot be read.
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
        """Return when the store has this many shards, or when nothing is being made.

        Raises:
            SessionError: the rendering process ended early.
        """
        shards, start = min(shards, self.shards), time.monotonic()
        if self._process is None or len(shard_numbers(self.folder)) >= shards:
            return
        with Console().status("") as status:
            while (existing := len(shard_numbers(self.folder))) < shards:
                status.update(f"{self.folder}: {existing} of the first {shards} shards of renders, "
                              f"{time.monotonic() - start:.0f} s")  # fmt: skip
                if self._process.poll() is not None and len(shard_numbers(self.folder)) < shards:
                    log = self.folder / _ERRORS
                    last = (log.read_text(errors="replace").strip().splitlines() or ["no message"])[-1]
                    raise SessionError(f"{self.folder}: rendering stopped: {last} (full output in {log})")
                time.sleep(0.5)


def _read_plan(path: pathlib.Path) -> tuple[int, int]:
    try:
        plan = json.loads(path.read_text())
        return int(plan["shards"]), int(plan["seed"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SessionError(
            f"{path}: does not tell which renders are missing; remove it to train on the existing ones, or continue "
            "with `muybridge synth`"
        ) from error


def _start(folder: pathlib.Path, shards: int, seed: int) -> "subprocess.Popen[bytes]":
    existing = len(shard_numbers(folder))
    print(f"{folder}: {existing} of {shards} shards of renders; the others are made during training", flush=True)
    with (folder / _ERRORS).open("wb") as log:
        return subprocess.Popen(_command(folder, shards, seed), stdin=subprocess.PIPE, stdout=log, stderr=log)


def _command(folder: pathlib.Path, shards: int, seed: int) -> list[str]:
    return [sys.executable, "-m", "muybridge.train.synthesis.rendering.worker", str(folder), str(shards), str(seed)]


def main(folder: pathlib.Path, shards: int, seed: int) -> None:
    """Make the missing shards of a store, at low priority compared with the training that uses them. Ends when the
    other end of its standard input is closed, in whatever way its parent ended."""

    def wait_for_end() -> None:
        # Not sys.stdin's own read: it holds a lock, without which Python aborts when all shards are made first.
        while os.read(sys.stdin.fileno(), 4096):
            pass
        if hasattr(signal, "pthread_kill"):  # also wakes a thread that waits for processes
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        else:
            _thread.interrupt_main()

    # Background jobs of a shell, and their children, ignore the interrupt unless Python's handler is restored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=wait_for_end, daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(5)
    with contextlib.suppress(KeyboardInterrupt):  # half-written files are removed
        make_renders(folder, range(shards), seed, processes=affordable_processes(MEMORY))
        (folder / PLAN).unlink(missing_ok=True)


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
