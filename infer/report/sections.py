"""The report's sections as HTML: headline figures, findings, tables, pictures and how the run was made."""

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.infer.report.figures import BoneFigures, CameraFigures, Headline, nanmedian
from muybridge.infer.report.findings import Finding, verdict
from muybridge.infer.runtime.wording import readable

_FILES = {
    ".trc": "3D points (OpenSim, Pose2Sim)",
    ".c3d": "3D points (biomechanics software)",
    ".bvh": "moving skeleton (Blender, Maya, Unreal)",
    ".glb": "moving skeleton with a mesh (viewers, game engines)",
    ".mp4": "video with what was found drawn in",
    ".json": "figures, options and versions",
}


@dataclass(frozen=True)
class PersonPage:
    """One person's report.

    Attributes:
        file: its name, relative to the others.
        coverage: share of frames x landmarks with a 3D point.
        leave_one_out_px: median distance of a 2D point to what the other cameras say.
    """

    file: str
    coverage: float
    leave_one_out_px: float


def number_text(value: float, digits: int = 1, unit: str = "") -> str:
    """A number with its unit, a dash where there is none."""
    if not np.isfinite(value):
        return '<span class="none">–</span>'
    return f"{value:.{digits}f}{unit}"


def percent_text(value: float, digits: int = 0) -> str:
    return number_text(100.0 * value, digits, " %")


def heading_section(
    title: str,
    points: Points3D,
    figures: Headline,
    bones: Sequence[BoneFigures],
    camera_count: int,
    timings_s: Mapping[str, float],
    files: Sequence[str],
) -> str:
    """Title, verdict, the headline figures and links to the other results."""
    rating, sentence = verdict(figures, bones)
    frames = len(points.points_world)
    label = {"good": "Good take", "fair": "Usable, with care", "poor": "Needs attention"}[rating]
    filled = figures.coverage - figures.measured_coverage
    covered = "of all landmarks and frames have a 3D position"
    if filled >= 0.0005:
        covered += f", {100 * filled:.1f} % of them by filling gaps"
    agreement = "from one camera to what the others say, at the person"
    tiles = [
        tile("Coverage", percent_text(figures.coverage, 1), covered),
        tile("Agreement", number_text(figures.agreement_mm, 0, " mm"), agreement),
        tile("Leave one out", number_text(figures.leave_one_out_px, 1, " px"), "the same, in the image"),
        tile("Reprojection", number_text(figures.residual_px, 1, " px"), "of the 3D points, to their own 2D points"),
    ]
    total = sum(timings_s.values())
    if total > 0:
        per_image = f"{1000 * total / (frames * camera_count):.0f} ms an image, all stages together"
        tiles.append(tile("Computing time", f"{total:.0f} s" if total >= 10 else f"{total:.1f} s", per_image))
    facts = " · ".join(
        fact.replace(" ", "&nbsp;")
        for fact in (
            f"{camera_count} cameras",
            f"{frames} frames",
            f"{points.fps:g} frames/s",
            f"{frames / points.fps:.2f} s",
        )
    )
    return (
        f'<header><p class="kicker">muybridge report</p><h1>{html.escape(title)}</h1>'
        f'<p class="facts">{facts}</p>'
        f'<p class="verdict {rating}"><strong>{label}</strong> {html.escape(sentence)}</p>'
        f'<dl class="tiles">{"".join(tiles)}</dl>{_file_list(files)}</header>'
    )


def _file_list(files: Sequence[str]) -> str:
    if not files:
        return ""
    links = "".join(
        f'<li><a href="{html.escape(name, quote=True)}">{html.escape(name)}</a> '
        f"<span>{_FILES.get(name[name.rfind('.') :], '')}</span></li>"
        for name in files
    )
    return f'<details class="files"><summary>Files of this run</summary><ul>{links}</ul></details>'


def people_section(number: int, pages: Sequence[PersonPage]) -> str:
    """Links to the reports of everybody in the take; nothing where there is one person."""
    if not pages:
        return ""
    items = []
    for n, page in enumerate(pages, start=1):
        name = f"Person {n}" if n == number else f'<a href="{html.escape(page.file, quote=True)}">Person {n}</a>'
        figures = f"{percent_text(page.coverage)} covered, {number_text(page.leave_one_out_px, 1, ' px')} left out"
        here = ' aria-current="page"' if n == number else ""
        items.append(f"<li{here}>{name} <span>{figures}</span></li>")
    return f'<nav class="people" aria-label="Everybody in this take"><ul>{"".join(items)}</ul></nav>'


def tile(name: str, value: str, meaning: str) -> str:
    return f'<div class="tile"><dt>{name}</dt><dd class="value">{value}</dd><dd class="meaning">{meaning}</dd></div>'


def table_of(columns: Sequence[tuple[str, str]], rows: Sequence[str], kind: str = "figures") -> str:
    """A table that scrolls sideways where it is too wide; columns are (name, meaning)."""
    cells = "".join(
        f'<th scope="col"{f" title={json.dumps(html.escape(meaning))}" if meaning else ""}>{html.escape(name)}</th>'
        for name, meaning in columns
    )
    return (
        f'<div class="scroll"><table class="{kind}"><thead><tr>{cells}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def findings_section(said: Sequence[Finding], person: str, nothing: str = "Nothing stands out in this take.") -> str:
    """The sentences, each with its severity in words and a button that shows the frame."""
    names = {"bad": "Problem", "look": "Look", "note": "Note"}
    items = []
    for finding in said:
        button = ""
        if finding.frame >= 0:
            button = (
                f' <button type="button" class="jump" data-frame="{finding.frame}">show frame {finding.frame}</button>'
            )
        items.append(
            f'<li class="{finding.severity}"><span class="mark">{names[finding.severity]}</span>'
            f"<p>{html.escape(finding.text)}{button}</p></li>"
        )
    if not items:
        items = [f'<li class="fine"><span class="mark">Fine</span><p>{html.escape(nothing)}</p></li>']
    who = f'<p class="person"><strong>Who was captured.</strong> {html.escape(person)}</p>' if person else ""
    return f'<ul class="findings">{"".join(items)}</ul>{who}'


def cameras_section(cameras: Sequence[CameraFigures]) -> str:
    """One row a camera."""
    head = (
        ("Camera", ""),
        ("seen", "share of frames and landmarks with a 2D point"),
        ("left out", "share of those that the other cameras overruled"),
        ("residual", "median distance of the 2D point to the projected 3D point"),
        ("95 %", "95th percentile of the residual"),
        ("leave one out", "median distance to what the other cameras alone say"),
        ("at the person", "the same in millimetres"),
        ("unanswered", "share for which the others gave no point"),
        ("shift", "constant offset of the 2D points: a sign of calibration"),
        ("out of step", "frames ahead of (+) or behind (-) the other cameras"),
    )
    loo = np.array([c.leave_one_out_px * c.mm_per_px for c in cameras])
    rows = []
    for camera, error in zip(cameras, loo, strict=True):
        cells = (
            f"<td>{percent_text(camera.seen)}</td>",
            f"<td>{percent_text(camera.rejected)}</td>",
            heat_cell(camera.residual_px * camera.mm_per_px, camera.residual_px, " px"),
            f"<td>{number_text(camera.residual_p95_px, 1, ' px')}</td>",
            heat_cell(error, camera.leave_one_out_px, " px"),
            f"<td>{number_text(error, 0, ' mm')}</td>",
            f"<td>{percent_text(camera.unanswered, 1)}</td>",
            f"<td>{number_text(float(np.linalg.norm(camera.bias_px)), 1, ' px')}</td>",
            f"<td>{_signed(camera.lag_frames)}</td>",
        )
        rows.append(f'<tr><th scope="row">{html.escape(camera.name)}</th>{"".join(cells)}</tr>')
    return table_of(head, rows)


def _signed(value: float) -> str:
    return f"{value:+.1f}" if np.isfinite(value) else '<span class="none">–</span>'


def heat_cell(mm: float, value: float, unit: str = "") -> str:
    """A cell whose tint grows with the error at the person: none at 0 mm, full at 60 mm."""
    if not np.isfinite(value):
        return '<td class="heat none">–</td>'
    tint = 100.0 * min(max(mm, 0.0) / 60.0, 1.0) if np.isfinite(mm) else 0.0
    return f'<td class="heat" style="--h:{tint:.0f}%">{value:.1f}{unit}</td>'


def landmarks_section(points: Points3D, cameras: Sequence[CameraFigures]) -> str:
    """Median residual of every landmark in every camera, and its coverage."""
    landmarks = points.landmarks
    median = nanmedian(points.residual_px, axis=1)
    overall = nanmedian(points.residual_px, axis=(0, 1))
    scale = np.array([c.mm_per_px for c in cameras])
    overall_mm = nanmedian(points.residual_px * scale[:, None, None], axis=(0, 1))
    found = np.isfinite(points.points_world).all(axis=-1).mean(axis=0)
    head = [("Landmark", ""), *((c.name, "median residual, px") for c in cameras)]
    head += [("all", "median over all cameras, px"), ("coverage", "share of frames with a 3D position")]
    rows = []
    for j, name in enumerate(landmarks.names):
        cells = "".join(heat_cell(median[c, j] * scale[c], median[c, j]) for c in range(len(cameras)))
        rows.append(
            f'<tr><th scope="row">{readable(name)}</th>{cells}{heat_cell(overall_mm[j], overall[j])}'
            f"<td>{percent_text(float(found[j]))}</td></tr>"
        )
    return table_of(head, rows, "figures dense")


def bones_section(bones: Sequence[BoneFigures]) -> str:
    """Length and spread of every bone; left and right in one row."""
    rows = []
    for i, bone in enumerate(bones):
        if bone.twin >= 0 and bone.twin < i:
            continue
        pair = [bone, bones[bone.twin]] if bone.twin >= 0 else [bone]
        name = bone.name.replace("left ", "") if len(pair) == 2 else bone.name
        cells = "".join(
            f"<td>{number_text(1000 * b.median_m, 0)}</td>"
            f'<td class="heat" style="--h:{_bone_tint(b):.0f}%">±{number_text(1000 * b.spread_m, 0)}</td>'
            for b in pair
        )
        if len(pair) == 1:
            cells += '<td class="none">–</td><td class="none">–</td><td class="none">–</td>'
        else:
            cells += f"<td>{number_text(1000 * (pair[0].median_m - pair[1].median_m), 0)}</td>"
        rows.append(f'<tr><th scope="row">{html.escape(name)}</th>{cells}</tr>')
    spread = "half the range of the middle 68 % of the frames, mm"
    head = (
        ("Bone (mm)", ""), ("left", "median length; for a bone without a twin the only one"), ("±", spread),
        ("right", "median length"), ("±", spread), ("differ", "left minus right"),
    )  # fmt: skip
    return table_of(head, rows)


def _bone_tint(bone: BoneFigures) -> float:
    return 100.0 * min(bone.spread / 0.2, 1.0)


def thumbnails_section(pictures: Sequence[tuple[str, int, str]]) -> str:
    """Pictures from the overlays, (camera, frame, base64 JPEG), one row a frame."""
    if not pictures:
        return ""
    rows = []
    for frame in sorted({frame for _, frame, _ in pictures}):
        figures = "".join(
            f'<figure><img alt="{html.escape(camera, quote=True)} with the figure drawn in" '
            f'src="data:image/jpeg;base64,{data}"><figcaption>{html.escape(camera)}</figcaption></figure>'
            for camera, at, data in pictures
            if at == frame
        )
        rows.append(
            f"<h3>Frame {frame} "
            f'<button type="button" class="jump" data-frame="{frame}">show in 3D</button></h3>'
            f'<div class="gallery">{figures}</div>'
        )
    return (
        '<section id="pictures"><h2>Does the figure sit on the person?</h2>'
        '<p class="lead">Bright: the 3D landmarks seen from this camera. Rings: the 2D points they came '
        "from, crosses: 2D points left out. Rings on the person but the figure beside it: the calibration is "
        f"off. Rings beside the person: the network was wrong.</p>{''.join(rows)}</section>"
    )


def run_section(
    timings_s: Mapping[str, float],
    quality: Mapping[str, Any],
    options: Mapping[str, Any],
    versions: Mapping[str, str],
) -> str:
    """Timings as bars; figures, options and versions to unfold."""
    longest = max(timings_s.values(), default=0.0) or 1.0
    bars = "".join(
        f"<tr><th scope='row'>{html.escape(readable(stage))}</th><td class='bar'>"
        f"<span style='width:{100 * seconds / longest:.1f}%'></span></td><td>{seconds:.1f} s</td></tr>"
        for stage, seconds in timings_s.items()
    )
    blocks = [f'<table class="bars"><tbody>{bars}</tbody></table>'] if bars else []
    for name, value in (("Quality figures", quality), ("Options", options), ("Versions", versions)):
        if value:
            text = html.escape(json.dumps(value, indent=2, default=str, ensure_ascii=False))
            blocks.append(f"<details><summary>{name}</summary><pre>{text}</pre></details>")
    return "".join(blocks)
