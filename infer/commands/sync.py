"""`muybridge sync`: offsets and drifts of the cameras' clocks, found, compared, written and applied.

`sync.toml` in the session says what was found; `muybridge run` reads it and interpolates the 2D landmarks.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.errors import MuybridgeError, SessionError
from muybridge.geometry.sync.motion import Clock
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.pipelines.sync import Method, find_clocks, write_sync
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session
from muybridge.infer.session.sync_file import SYNC_FILE

COMMON_OPTIONS = {"sync": ("out", "methods", "max_offset", "calibration", "cameras", "workers")}
_METHODS: tuple[Method, ...] = ("audio", "epipolar", "motion")


def sync(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    methods: tuple[Method, ...] = _METHODS,
    max_offset: float = 2.0,
    work: Path | None = None,
    session: SessionOptions = SessionOptions(),  # noqa: B008 - frozen
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Offsets and drifts of a session's cameras, by sound, by movement and by epipolar geometry.

    Args:
        path: folder with `videos/` and a calibration.
        out: file to write (default: `sync.toml` in the session, where `muybridge run` reads it).
        methods: which are tried; where several know a camera, the surest is used.
        max_offset: largest offset that is looked for, seconds; by sound, first, and then any.
        work: results folder whose finished 2D landmarks are used (default: `muybridge/` inside the session).
        session: how the session folder is read.
        detect: 2D landmarks.
    """
    if not methods:
        raise MuybridgeError(f"name at least one of {', '.join(_METHODS)} after --methods")
    if not max_offset > 0:
        raise MuybridgeError(f"--max-offset is {max_offset:g}: name the largest offset in seconds, more than 0")
    with Progress() as progress:
        opened = open_session(path, session, in_step=False)
        keypoints = None
        if set(methods) - {"audio"}:
            opened, keypoints = session_keypoints(opened, work, detect, progress)
        result = find_clocks(opened, keypoints, methods, max_offset)
    names = opened.cameras.names
    for name, clock, method in zip(names, result.clocks, result.methods, strict=True):
        print(f"{name}: {_told(clock, method)}")
    for name, clock, method in zip(names, result.clocks, result.methods, strict=True):
        if method == "audio" and clock.offset_sd > 1 / opened.fps:
            print(f"{name}: its sound repeats itself, so that other offsets fit as well: check a fast movement")
    for line in result.disagreements:
        print(f"methods disagree: {line}")
    if all(m in ("reference", "none") for m in result.methods):
        raise SessionError(
            f"{path}: no way ({', '.join(methods)}) to find how the cameras' clocks stand; nothing was written. "
            "Sound needs to be in all videos, pictures need a person who moves in two views or more and offsets of at "
            f"most {max_offset:g} s (--max-offset)"
        )
    write_sync(out or path / SYNC_FILE, names, result)
    return 0


def _told(clock: Clock, method: str) -> str:
    if method in ("reference", "none"):
        return "reference" if method == "reference" else "nothing found, taken to be in step"
    drift = f", drift {clock.drift * 1e6:.1f} +- {clock.drift_sd * 1e6:.1f} ppm" if np.isfinite(clock.drift_sd) else ""
    return f"offset {clock.offset * 1e3:.2f} +- {clock.offset_sd * 1e3:.2f} ms{drift} (by {method})"
