"""Count what a run does: decoded frames, images and crops read by networks, and the time spent in each."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import onnxruntime


@dataclass
class Tally:
    """Of one kind of work.

    Attributes:
        calls: how often it was done.
        rows: frames, images or crops.
        seconds: processor time of the calling threads.
    """

    calls: int = 0
    rows: int = 0
    seconds: float = 0.0


@dataclass
class WorkCounts:
    """Tallies by kind: `decode`, `overlay` (drawn frames) and a network's kind (`people`, `keypoints`, ...)."""

    tallies: dict[str, Tally] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __getitem__(self, kind: str) -> Tally:
        return self.tallies.get(kind, Tally())

    def add(self, kind: str, rows: int, seconds: float) -> None:
        """Count one call."""
        with self._lock:
            tally = self.tallies.setdefault(kind, Tally())
            tally.calls += 1
            tally.rows += rows
            tally.seconds += seconds


@contextmanager
def counted() -> Iterator[WorkCounts]:
    """Count the work that is done within, in all threads of this process."""
    from muybridge.infer.results import overlay
    from muybridge.infer.session import video

    counts = WorkCounts()
    sessions, decode = onnxruntime.InferenceSession, video._decode
    run, draw = sessions.run, overlay.draw_overlay
    sessions.run = _network(run, counts)
    video._decode = _frames(decode, counts)
    overlay.draw_overlay = _timed(draw, counts, "overlay")
    try:
        yield counts
    finally:
        sessions.run, video._decode, overlay.draw_overlay = run, decode, draw


def _network(run: Callable[..., Any], counts: WorkCounts) -> Callable[..., Any]:
    @functools.wraps(run)
    def counting(self: onnxruntime.InferenceSession, outputs: Any, inputs: dict[str, Any], *rest: Any) -> Any:
        start = time.thread_time()
        result = run(self, outputs, inputs, *rest)
        seconds = time.thread_time() - start
        kind = self.get_modelmeta().custom_metadata_map.get("muybridge_kind", "other networks")
        counts.add(kind, len(next(iter(inputs.values()))), seconds)
        return result

    return counting


def _frames(decode: Callable[..., Iterator[Any]], counts: WorkCounts) -> Callable[..., Iterator[Any]]:
    @functools.wraps(decode)
    def counting(*arguments: Any, **options: Any) -> Iterator[Any]:
        frames = decode(*arguments, **options)
        while True:
            start = time.thread_time()
            frame = next(frames, None)
            if frame is None:
                return
            counts.add("decode", 1, time.thread_time() - start)
            yield frame

    return counting


def _timed(function: Callable[..., Any], counts: WorkCounts, kind: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def counting(*arguments: Any, **options: Any) -> Any:
        start = time.thread_time()
        result = function(*arguments, **options)
        counts.add(kind, 1, time.thread_time() - start)
        return result

    return counting
