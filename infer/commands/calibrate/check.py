"""`muybridge calibrate check`: judges a session's calibration by the person in its videos."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.calibration.check import CheckOutput, check_session, format_summary
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

COMMON_OPTIONS = {"check": ("out", "overwrite", "work", "calibration", "cameras", "workers")}


def check(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    work: Path | None = None,
    options: DiagnosisOptions = DiagnosisOptions(),  # noqa: B008 - frozen
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Check a calibration and name cameras that are turned, moved, out of sync, or have a wrong lens or file.

    Example:
        muybridge calibrate check recordings/walk

    Args:
        path: session folder with `videos/` and a calibration, in which a person moves.
        out: page to write (default: `calibration.html` in the session's results folder).
        overwrite: replace --out where muybridge did not write it.
        work: results folder whose 2D landmarks are used (default: `muybridge/` inside the session).
        options: what counts as a fault.
        session: how the session folder is read.
        detect: 2D landmarks.
    """
    check_replaceable([] if out is None else [out], overwrite)
    with Progress() as progress:
        quality, page = check_session(path, CheckOutput(out, work), options, session, detect, progress)
    print("\n".join([*format_summary(quality), f"details: {page}"]))
    return 0
