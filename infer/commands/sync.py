"""`muybridge sync`: offsets and drifts of the cameras' clocks.

`sync.toml` in the session stores the result; `muybridge run` reads it and interpolates the 2D landmarks.
"""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.sync import METHODS, Method, format_summary, sync_session, write_sync
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions
from muybridge.infer.session.sync_file import SYNC_FILE

COMMON_OPTIONS = {"sync": ("out", "overwrite", "methods", "max_offset", "calibration", "cameras", "workers")}


def sync(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    methods: Annotated[tuple[Method, ...], tyro.conf.arg(metavar="{audio,epipolar,motion} ...")] = METHODS,
    max_offset: float = 2.0,
    work: Path | None = None,
    session: SessionOptions = SessionOptions(),  # noqa: B008 - frozen
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Synchronise the cameras of a session: offsets and drifts of their clocks by sound and by motion.

    Example:
        muybridge sync recordings/walk

    Args:
        path: session folder with `videos/` and a calibration.
        out: file to write (default: `sync.toml` in the session, where `muybridge run` reads it).
        overwrite: replace a file there that muybridge did not write.
        methods: `audio` uses the sound, `motion` the speed of the landmarks, `epipolar` their geometry; where several
            succeed for a camera, the most certain one is used.
        max_offset: seconds, largest offset; by sound, larger ones are tried afterwards.
        work: results folder whose 2D landmarks are used (default: `muybridge/` inside the session).
        session: how the session folder is read.
        detect: 2D landmarks.
    """
    place = out or path / SYNC_FILE
    if out is not None or path.is_dir():
        check_replaceable([place], overwrite)
    with Progress() as progress:
        opened, result = sync_session(path, work, methods, max_offset, session, detect, progress)
    write_sync(place, opened.cameras.names, result)
    print("\n".join(format_summary(opened, result)))
    return 0
