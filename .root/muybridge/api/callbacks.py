"""Progress and cancellation of a capture, for a program in place of a terminal."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from muybridge.infer.runtime.progress import Progress, Task

ProgressCallback = Callable[[str, int, int, float | None], object]
"""`progress(stage, done, total, seconds_left)`; returning False, or raising, cancels."""

_LOG = logging.getLogger("muybridge")
# A library prints nothing unless its caller asks for it.
_LOG.addHandler(logging.NullHandler())


class CaptureCancelled(Exception):
    """A progress callback returned False. No `MuybridgeError`: nothing is wrong, and the next run resumes."""


class CallbackProgress(Progress):
    """Reports to a callback, one call at a time whatever thread the work is in; messages go to the log `muybridge`."""

    def __init__(self, callback: ProgressCallback | None) -> None:
        super().__init__(quiet=True)
        self._callback = callback
        self._calls = threading.RLock()
        self._failure: BaseException | None = None

    def say(self, text: str) -> None:
        """Log a line about what goes on."""
        _LOG.info(text)

    def notice(self, text: str) -> None:
        """Log a line about something that the caller should know; `Result.notices` has it too."""
        _LOG.warning(text)

    def stage(self, name: str) -> None:
        """A stage that reports no units begins."""
        self.report(name, 0, 1, None)

    @contextmanager
    def task(self, label: str, total: int) -> Iterator[Task]:
        """A stage of `total` units."""
        task = _CountedTask(self, label, total)
        self.report(label, 0, total, None)
        yield task
        _LOG.info("%s: %.1f s", label, task.elapsed)

    def report(self, stage: str, done: int, total: int, seconds_left: float | None) -> None:
        """Call the callback.

        Raises:
            CaptureCancelled: it returned False, now or in an earlier call.
            BaseException: what it raised, now or in an earlier call: whoever catches an error of a stage does not
                thereby go on with a cancelled run.
        """
        if self._callback is None:
            return
        with self._calls:
            if self._failure is not None:
                raise self._failure
            try:
                if self._callback(stage, done, total, seconds_left) is False:
                    raise CaptureCancelled(f"the progress callback returned False at {stage}, {done} of {total}")
            except BaseException as failure:
                self._failure = failure
                raise


class _CountedTask:
    """Counts the units of one stage."""

    def __init__(self, progress: CallbackProgress, label: str, total: int) -> None:
        self._progress, self._label, self._total = progress, label, total
        self._done, self._start, self._lock = 0, time.perf_counter(), threading.Lock()

    @property
    def elapsed(self) -> float:
        """Seconds since the stage began."""
        return time.perf_counter() - self._start

    def advance(self, count: int = 1) -> None:
        """Note that `count` more units are done."""
        with self._lock:  # held during the call, so that a later count is never reported before an earlier one
            self._done += count
            done = min(self._done, self._total)
            left = self.elapsed / self._done * (self._total - done) if self._done else None
            self._progress.report(self._label, done, self._total, left)
