"""Progress messages of a run: bars with the remaining time on a terminal, plain lines elsewhere."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Protocol, TextIO

from muybridge.infer.runtime.logs import error_console, is_quiet


class Task(Protocol):
    """Work in progress, of a known number of units."""

    def advance(self, count: int = 1) -> None:
        """Count `count` more units as done; may be called from any thread."""


class Progress:
    """Prints progress messages to `stream` (default stderr); used as a context manager."""

    def __init__(self, stream: TextIO | None = None, quiet: bool | None = None):
        """`quiet` prints notices only; by default as the command line asks for."""
        self._stream = stream or sys.stderr
        self._quiet = is_quiet() if quiet is None else quiet
        self._bars: _Bars | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> "Progress":
        if not self._quiet and self._stream.isatty():
            self._bars = _Bars(self._stream)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.close()
            self._bars = None

    def say(self, text: str) -> None:
        """Print a line about the progress."""
        if not self._quiet:
            self._print(text)

    def notice(self, text: str) -> None:
        """Print a notice, also in quiet runs."""
        self._print(f"note: {text}")

    def stage(self, name: str) -> None:
        """Called when a stage without units begins; nothing is printed here, because its end is."""

    def _print(self, text: str) -> None:
        with self._lock:
            if self._bars is not None:
                self._bars.print(text)
            else:
                print(text, file=self._stream, flush=True)

    @contextmanager
    def task(self, label: str, total: int) -> Iterator[Task]:
        """Work of `total` units; prints its duration when it is done."""
        start = time.perf_counter()
        bar: Task = self._bars.add(label, total) if self._bars is not None else _Silent()
        try:
            yield bar
        finally:
            if isinstance(bar, _Bar):
                bar.remove()
        self.say(f"{label}: {time.perf_counter() - start:.1f} s")


class _Silent:
    def advance(self, count: int = 1) -> None:
        pass


class _Bars:
    """Rich's progress bars, imported only where there is a terminal."""

    def __init__(self, stream: TextIO):
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        self.rich = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=error_console() if stream is sys.stderr else Console(file=stream),
            transient=True,
        )
        self.rich.start()

    def add(self, label: str, total: int) -> "_Bar":
        return _Bar(self, self.rich.add_task(label, total=total))

    def print(self, text: str) -> None:
        self.rich.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self) -> None:
        self.rich.stop()


class _Bar:
    def __init__(self, bars: _Bars, task: int):
        from rich.progress import TaskID

        self._bars, self._task = bars, TaskID(task)

    def advance(self, count: int = 1) -> None:
        self._bars.rich.advance(self._task, count)

    def remove(self) -> None:
        self._bars.rich.remove_task(self._task)
