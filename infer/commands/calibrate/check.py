"""`muybridge calibrate check`: judges a session's calibration by the person in its videos, and names the culprit."""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.errors import MuybridgeError
from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import DEFAULT_RESULTS, session_keypoints
from muybridge.infer.reconstruction.judge import check_keypoints
from muybridge.infer.report.calibration_figures import blamed
from muybridge.infer.report.calibration_page import CalibrationPage, write_calibration_page
from muybridge.infer.report.diagnosis_wording import diagnosis_text
from muybridge.infer.results.folder import open_output
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session

PAGE = "calibration.html"
COMMON_OPTIONS = {"check": ("out", "overwrite", "work", "calibration", "cameras", "workers")}


def check(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    options: DiagnosisOptions = DiagnosisOptions(),  # noqa: B008 - frozen
    work: Path | None = None,
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
    overwrite: bool = False,
) -> int:
    """Is the calibration good, and if not, which camera is it: turned, out of step, wrong lens or file?

    Args:
        path: folder with `videos/` and a calibration, in which a person moves.
        out: page to write (default: `calibration.html` in the session's results folder).
        options: what counts as a fault.
        work: results folder whose finished 2D landmarks are used (default: `muybridge/` inside the session).
        session: how the session folder is read.
        detect: 2D landmarks.
        overwrite: replace --out where muybridge did not write it.
    """
    start = time.perf_counter()
    check_replaceable([] if out is None else [out], overwrite)
    with Progress() as progress:
        opened = open_session(path, session)
        for notice in opened.notices:
            progress.notice(notice)
        opened, keypoints = session_keypoints(opened, work, detect, progress)
        quality = check_keypoints(opened.cameras, keypoints, options, opened.fps)
    seconds = {"in all": time.perf_counter() - start}
    page = CalibrationPage(opened.name, quality, opened.notices, seconds)
    if out is None:
        results = open_output(work or path / DEFAULT_RESULTS, (), [opened.calibration])
        place = results.write(PAGE, lambda path: write_calibration_page(path, page))
    else:
        place = write_calibration_page(out, page)
    for line in told(quality):
        print(line)
    print(f"{place} shows it")
    return 0


def told(quality: CalibrationQuality) -> list[str]:
    """What was found, in lines: a sentence, then a line a camera."""
    report = quality.diagnosis
    if report is None:
        raise MuybridgeError("no culprit was looked for")
    rows = [diagnosis_text(report)]
    width = max(len(n) for n in quality.cameras.names)
    for c in report.order if report.faults else range(len(quality.cameras)):
        name = quality.cameras.names[c]
        away = quality.leave_one_out_px[c]  # NaN where never more than two cameras see the person
        left_out = f"left out {away:5.1f} px   " if np.isfinite(away) else ""
        rows.append(
            f"  {name:<{width}}  reprojection {quality.residual_px[c]:5.1f} px   {left_out}"
            f"{blamed(report, name) or 'nothing wrong'}"
        )
    return rows
