"""`sync.toml`: the clocks of a session's cameras, written by `muybridge sync` or by hand, and the frames that their
videos have in common."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from reprlib import repr as shorten

import numpy as np

from muybridge.arrays import IntArray
from muybridge.errors import SessionError, parsing
from muybridge.geometry.sync.clocks import Clock

SYNC_FILE = "sync.toml"
SYNC_VERSION = 1
# Largest values that a recording can have: its cameras start within days, and drift by less than another frame rate.
_LARGEST = {"offset": 1e6, "drift_ppm": 1e5, "offset_sd": 1e6}


def clocks_in(folder: Path, names: Sequence[str]) -> tuple[Clock, ...] | None:
    """The clocks that a session's `sync.toml` gives the named cameras; None where it has none."""
    path = folder / SYNC_FILE
    return read_sync(path, names) if path.is_file() else None


def read_sync(path: Path, names: Sequence[str]) -> tuple[Clock, ...]:
    """The clocks of the named cameras from a `sync.toml`; a camera that it does not name has the reference's clock.

    Raises:
        SessionError: it is no such file, or a value is not a number.
    """
    with parsing(path, SessionError, "a sync.toml"):
        return _read(path, names)


def _read(path: Path, names: Sequence[str]) -> tuple[Clock, ...]:
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    tables = data.get("cameras")
    if data.get("muybridge_sync") != SYNC_VERSION or not isinstance(tables, dict):
        raise SessionError(
            f"{path}: needs `muybridge_sync = {SYNC_VERSION}` and [cameras.NAME] tables; "
            "write it again with `muybridge sync`, or delete it"
        )
    unknown = [n for n in tables if n not in names]
    if len(unknown) == len(tables):
        listed = ", ".join(shorten(n) for n in unknown[:10]) or "no camera"
        raise SessionError(f"{path}: names {listed}, none of the cameras {', '.join(names)}")
    return tuple(_clock(path, name, tables.get(name, {})) for name in names)


def _clock(path: Path, name: str, table: object) -> Clock:
    if not isinstance(table, dict):
        raise SessionError(f"{path}: camera {name} is not a table; write [cameras.{name}]")
    values = {k: table.get(k, 0.0) for k in _LARGEST}
    for key, value in values.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise SessionError(f"{path}: camera {name}: {key} is {shorten(value)}; it must be a finite number")
        if not abs(value) <= _LARGEST[key]:
            raise SessionError(
                f"{path}: camera {name}: {key} is {shorten(value)}; it must be a finite number of at most "
                f"{_LARGEST[key]:g}"
            )
    return Clock(float(values["offset"]), values["drift_ppm"] * 1e-6, float(values["offset_sd"]), 0.0, 1.0)


def first_frames_in_common(
    clocks: Sequence[Clock], names: Sequence[str], counts: Sequence[int], fps: float
) -> tuple[IntArray, tuple[Clock, ...]]:
    """The first common frames of videos that did not begin together.

    Args:
        clocks: (C,) of the cameras.
        names: (C,) of their videos.
        counts: (C,) frames of their videos, at the take's rate.
        fps: of the take.

    Returns:
        (C,) the frame of each video nearest to the first time that all of them cover, and the clocks counted from these
        frames, relative to the first video: the remaining fractions of a frame, and drifts.

    Raises:
        SessionError: a video ends before another begins.
    """

    def reference_time(c: int, own: float) -> float:
        """The reference's time at a camera's own, seconds."""
        return float((own - clocks[c].offset) / (1 + clocks[c].drift))

    begins = [reference_time(c, 0.0) for c in range(len(clocks))]
    ends = [reference_time(c, (count - 1) / fps) for c, count in enumerate(counts)]
    last, soonest = int(np.argmax(begins)), int(np.argmin(ends))
    if ends[soonest] < begins[last]:
        raise SessionError(
            f"by {SYNC_FILE} {names[soonest]} ends {begins[last] - ends[soonest]:.3g} s before {names[last]} begins: "
            "correct the offsets, or leave one of them out with --cameras"
        )
    first = np.array([max(0, round((begins[last] * (1 + k.drift) + k.offset) * fps)) for k in clocks])
    zero = reference_time(0, first[0] / fps)
    left = (float(zero * (1 + k.drift) + k.offset - n / fps) for k, n in zip(clocks, first, strict=True))
    # Videos that are whole frames apart are synchronised exactly, whatever the last digits.
    return first, tuple(replace(k, offset=round(offset, 9)) for k, offset in zip(clocks, left, strict=True))
