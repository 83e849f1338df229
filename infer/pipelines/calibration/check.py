"""A session's calibration judged by the person in its videos."""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.reconstruction.judge import check_keypoints
from muybridge.infer.report.calibration_figures import blamed
from muybridge.infer.report.calibration_page import CalibrationPage, write_calibration_page
from muybridge.infer.report.diagnosis_wording import diagnosis_text
from muybridge.infer.results.folder import open_output
from muybridge.infer.results.names import DEFAULT_OUT
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session

PAGE = "calibration.html"


@dataclass(frozen=True)
class CheckOutput:
    """Where the page of a check goes, and from where its 2D landmarks come.

    Attributes:
        page: the page; None for `calibration.html` in the results folder.
        results: results folder whose 2D landmarks are used where they are there; None for the session's own.
    """

    page: Path | None = None
    results: Path | None = None


def check_session(
    path: Path,
    output: CheckOutput,
    options: DiagnosisOptions,
    session: SessionOptions,
    detect: DetectOptions,
    progress: Progress,
) -> tuple[CalibrationQuality, Path]:
    """Judge the calibration of a session, and write a page that shows it.

    Args:
        path: the session's folder.
        output: files and folders.
        options: what counts as a fault.
        session: how the session folder is read.
        detect: how 2D landmarks are detected.
        progress: receives progress messages.

    Returns:
        The quality of the calibration, and the page.

    Raises:
        MuybridgeError: the session cannot be used, nobody is found in it, or the page cannot be written.
    """
    start = time.perf_counter()
    opened = open_session(path, session)
    for notice in opened.notices:
        progress.notice(notice)
    results = open_output(output.results or path / DEFAULT_OUT, (), [opened.calibration])
    opened, keypoints = session_keypoints(opened, output.results, detect, progress)
    quality = check_keypoints(opened.cameras, keypoints, options, opened.fps)
    seconds = {"in all": time.perf_counter() - start}
    page = CalibrationPage(opened.name, quality, opened.notices, seconds)
    if output.page is not None:
        return quality, write_calibration_page(output.page, page)
    return quality, results.write(PAGE, lambda place: write_calibration_page(place, page))


def format_summary(quality: CalibrationQuality) -> list[str]:
    """The result in sentences: the diagnosis, then one line per camera."""
    report = quality.diagnosis
    if report is None:
        raise MuybridgeError("the calibration was judged without a diagnosis")
    rows = [diagnosis_text(report)]
    width = max(len(n) for n in quality.cameras.names)
    for c in report.order if report.faults else range(len(quality.cameras)):
        name = quality.cameras.names[c]
        error = quality.leave_one_out_px[c]  # NaN where never more than two cameras see the person
        left_out = f"left out {error:5.1f} px   " if np.isfinite(error) else ""
        rows.append(
            f"  {name:<{width}}  reprojection {quality.residual_px[c]:5.1f} px   {left_out}"
            f"{blamed(report, name) or 'nothing wrong'}"
        )
    return rows
