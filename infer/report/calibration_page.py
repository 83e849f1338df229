"""`calibration.html`: how good a calibration is, and which camera is wrong, on a page that needs no network."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from muybridge.files import replacing
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, check_solved
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.report.calibration_figures import CalibrationView
from muybridge.infer.report.calibration_findings import calibration_findings
from muybridge.infer.report.diagnosis_wording import diagnosis_text, fault_text, note_text
from muybridge.infer.report.findings import Finding
from muybridge.infer.report.templates import page_style, render


@dataclass(frozen=True)
class CalibrationPage:
    """What a page shows.

    Attributes:
        title: e.g. the session's name.
        quality: the figures.
        notes: sentences that should be read besides.
        timings_s: seconds by stage.
        options: resolved options, nested.
        versions: what it was made with.
    """

    title: str
    quality: CalibrationQuality
    notes: tuple[str, ...] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)
    options: Mapping[str, object] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)


def render_calibration(page: CalibrationPage) -> str:
    """The page as text."""
    quality = page.quality
    found = calibration_findings(quality)
    rating, label, sentence = _verdict(quality, found)
    improvement = ""
    if quality.diagnosis is not None and quality.diagnosis.faults:
        improvement = f"{quality.diagnosis.noise_px:.1f} → {quality.diagnosis.corrected_px:.1f} px"
    focal = quality.focal_sd[np.isfinite(quality.focal_sd)]
    return render(
        "calibration.html",
        title=page.title,
        facts=f"{len(quality.cameras)} cameras · judged by {quality.source}",
        rating=rating,
        verdict=label,
        sentence=sentence,
        residual_px=_median(quality.residual_px),
        leave_one_out_px=_median(quality.leave_one_out_px),
        improvement=improvement,
        seen_by_three=quality.plan.seen_by_three,
        focal_sd=focal.max() if quality.fitted and focal.size else float("nan"),
        findings=[*found, *(Finding("note", text) for text in page.notes)],
        calibration=CalibrationView(quality),
        timings_s=page.timings_s,
        options=page.options,
        versions=page.versions,
        css=page_style(),
    )


def write_solved_page(
    calibration: Path, title: str, result: CalibrationResult, source: str, cameras: CameraGroup
) -> str:
    """Write the page of an adjustment beside the calibration file that it gave; returns the line that says so.

    Args:
        calibration: the calibration file; the page has its name with `.html`.
        title: of the page.
        result: the adjustment.
        source: phrase for what it was adjusted to ("a board in 80 images").
        cameras: the cameras as they were written.
    """
    quality = check_solved(result, source, cameras)
    page = write_calibration_page(calibration.with_suffix(".html"), CalibrationPage(title, quality))
    grave = [f.text for f in calibration_findings(quality) if f.severity == "bad"]
    return "\n".join([*grave, f"{page} shows residuals, coverage and how well each number is known"])


def write_calibration_page(path: Path, page: CalibrationPage) -> Path:
    """Write the page; it appears under `path` only when it is complete.

    Raises:
        OutputError: the file cannot be written.
    """
    text = render_calibration(page)
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")
    return path


def _verdict(quality: CalibrationQuality, found: Sequence[Finding]) -> tuple[str, str, str]:
    report = quality.diagnosis
    if report is not None and report.faults:
        names = sorted({n for f in report.faults for n in f.cameras})
        return "poor", f"Look at {' and '.join(names)}", fault_text(report.faults[0])
    if any(f.severity == "bad" for f in found):
        return "poor", "Not to be trusted", next(f.text for f in found if f.severity == "bad")
    if any(f.severity == "look" for f in found):
        return "fair", "Usable, with care", next(f.text for f in found if f.severity == "look")
    if report is not None and report.note:
        return "fair", "Cannot be determined", note_text(report)
    return "good", "Good calibration", (
        diagnosis_text(report) if report is not None else "Every focal length and position is known well."
    )  # fmt: skip


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
