"""`calibration.html`: how good a calibration is, and which camera is wrong, on a page that needs no network."""

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from muybridge.files import replacing
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, check_solved
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.report.calibration_figures import (
    cameras_table,
    evidence_table,
    pictures_figure,
    pixels,
    plan_figure,
)
from muybridge.infer.report.diagnosis_wording import diagnosis_text, fault_text, note_text
from muybridge.infer.report.findings import Finding
from muybridge.infer.report.packing import fill_page, read_asset
from muybridge.infer.report.sections import findings_section, percent_text, run_section, tile

# A focal length known less well than this makes depth and size a guess.
_FOCAL_LOOK, _FOCAL_BAD = 0.01, 0.03
_POSITION_LOOK = 0.03
_COVERED_LOOK = 0.35
_LOW_PX = 2.0


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


def calibration_findings(quality: CalibrationQuality | None) -> tuple[Finding, ...]:
    """What is wrong with a calibration, the gravest first: culprits, then what is not known well enough."""
    found: list[Finding] = []
    if quality is None:
        return ()
    report = quality.diagnosis
    if report is not None:
        found += [Finding("bad", fault_text(fault)) for fault in report.faults]
        if report.note:
            found.append(Finding("note", note_text(report)))
    found += [Finding("bad" if m.grave else "look", m.sentence) for m in quality.misfits]
    if quality.fitted:
        found += _known_findings(quality)
    order = {"bad": 0, "look": 1, "note": 2}
    return tuple(sorted(found, key=lambda f: order[f.severity]))


def _known_findings(quality: CalibrationQuality) -> list[Finding]:
    """Numbers that a low residual hides: focal lengths and positions that the observations do not tell."""
    found = []
    for c, camera in enumerate(quality.cameras):
        focal, position = quality.focal_sd[c], quality.position_sd[c]
        residual = f"{quality.residual_px[c]:.2f} px"
        proof = f", though its residual is {residual}: a low residual is no proof here"
        if not quality.residual_px[c] < _LOW_PX:
            proof = f", and its residual is {residual}"
        if focal > _FOCAL_LOOK:
            found.append(
                Finding(
                    "bad" if focal > _FOCAL_BAD else "look",
                    f"The focal length of {camera.name} is only known to ±{100 * focal:.1f} %{proof}. Show the board "
                    "at other distances and tilted, or take the lens from a calibration of its own.",
                )
            )
        if position > _POSITION_LOOK:
            found.append(
                Finding(
                    "look",
                    f"The position of {camera.name} is only known to ±{1000 * position:.0f} mm: it shares too few "
                    "views with the others, or all from one place.",
                )
            )
    little = [
        f"{camera.name} ({100 * picture.covered:.0f} %)"
        for camera, picture in zip(quality.cameras, quality.pictures, strict=True)
        if picture.covered < _COVERED_LOOK
    ]
    if little:
        found.append(
            Finding(
                "look",
                f"Little of the image was looked at in {', '.join(little)}: towards the edges the lens's distortion is "
                "a guess. Show the board all over each image.",
            )
        )
    return found


def calibration_section(quality: CalibrationQuality) -> str:
    """Tables and pictures of a calibration, for a page's section."""
    report = quality.diagnosis
    faulty = [] if report is None else [n for f in report.faults for n in f.cameras]
    parts = [
        cameras_table(quality),
        f"<h3>Where the residuals are</h3>{pictures_figure(quality)}",
        f"<h3>What the cameras cover</h3>{plan_figure(quality.cameras, quality.plan, faulty)}",
    ]
    if report is not None and np.isfinite(report.noise_px):
        parts.append(
            '<h3>What would explain it</h3><p class="lead">How much better the whole rig would fit frames that were '
            "held out, if this one thing of this one camera were put right (log-likelihood; "
            f"0: not at all). A rig in order has small numbers everywhere.</p>{evidence_table(report)}"
        )
    return "".join(parts)


def calibration_in_report(quality: CalibrationQuality | None) -> str:
    """The section of a take's report; empty where the calibration was not judged."""
    if quality is None or quality.diagnosis is None:
        return ""
    said = diagnosis_text(quality.diagnosis)
    if quality.diagnosis.faults:
        said = "No: the sentences at the top say which camera is wrong, and how."
    return (
        '<section id="calibration"><h2>Is the calibration good?</h2>'
        f'<p class="lead">{html.escape(said)} Judged by {html.escape(quality.source)}.</p>'
        f"{calibration_section(quality)}</section>"
    )


def render_calibration(page: CalibrationPage) -> str:
    """The page as text."""
    quality = page.quality
    said = calibration_findings(quality)
    notes = tuple(Finding("note", text) for text in page.notes)
    made = run_section(page.timings_s, {}, page.options, page.versions)
    parts = {
        "title": html.escape(page.title),
        "css": read_asset("report.css"),
        "heading": _heading(page, said),
        "findings": findings_section([*said, *notes], "", "Nothing stands out in this calibration."),
        "calibration": calibration_section(quality),
        "run": f'<section id="run"><h2>How it was made</h2>{made}</section>' if made else "",
    }
    return fill_page("calibration.html", parts)


def write_solved_page(
    calibration: Path, title: str, result: CalibrationResult, source: str, cameras: CameraGroup
) -> str:
    """Write the page of an adjustment beside the calibration file that it gave; returns the line that says so.

    Args:
        calibration: the calibration file; the page has its name with `.html`.
        title: of the page.
        result: the adjustment.
        source: phrase for what it was adjusted to ("a board in 80 pictures").
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


def _heading(page: CalibrationPage, said: Sequence[Finding]) -> str:
    quality = page.quality
    rating, label, sentence = _verdict(quality, said)
    tiles = [
        tile("Residual", pixels(_median(quality.residual_px)), "median over the cameras"),
    ]
    if np.isfinite(quality.leave_one_out_px).any():
        meaning = "from one camera to what the others say"
        tiles.append(tile("Leave one out", pixels(_median(quality.leave_one_out_px)), meaning))
    if quality.diagnosis is not None and quality.diagnosis.faults:
        better = f"{quality.diagnosis.noise_px:.1f} → {quality.diagnosis.corrected_px:.1f} px"
        tiles.append(tile("If mended", better, "scale of the errors before and after"))
    tiles.append(tile("Seen by three", percent_text(quality.plan.seen_by_three), "of the points that two cameras saw"))
    focal = quality.focal_sd[np.isfinite(quality.focal_sd)]
    if quality.fitted and focal.size:
        tiles.append(tile("Focal length", f"±{100 * focal.max():.1f} %", "of the camera that knows it least"))
    facts = f"{len(quality.cameras)} cameras · judged by {quality.source}"
    return (
        f'<header><p class="kicker">muybridge calibration</p><h1>{html.escape(page.title)}</h1>'
        f'<p class="facts">{html.escape(facts)}</p>'
        f'<p class="verdict {rating}"><strong>{html.escape(label)}</strong> {html.escape(sentence)}</p>'
        f'<dl class="tiles">{"".join(tiles)}</dl></header>'
    )


def _verdict(quality: CalibrationQuality, said: Sequence[Finding]) -> tuple[str, str, str]:
    report = quality.diagnosis
    if report is not None and report.faults:
        names = sorted({n for f in report.faults for n in f.cameras})
        return "poor", f"Look at {' and '.join(names)}", fault_text(report.faults[0])
    if any(f.severity == "bad" for f in said):
        return "poor", "Not to be trusted", next(f.text for f in said if f.severity == "bad")
    if any(f.severity == "look" for f in said):
        return "fair", "Usable, with care", next(f.text for f in said if f.severity == "look")
    if report is not None and report.note:
        return "fair", "Cannot be determined", note_text(report)
    return "good", "Good calibration", (
        diagnosis_text(report) if report is not None else "Every focal length and position is known well."
    )  # fmt: skip


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
