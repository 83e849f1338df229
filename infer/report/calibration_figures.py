"""A calibration as pictures and tables in HTML: residuals over each image, the room from above, who is to blame."""

import html
from collections.abc import Sequence

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.diagnosis.findings import KINDS, CalibrationDiagnosis
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, ImagePicture, Plan
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.report.sections import number_text, percent_text, table_of

_KIND_NAMES = {
    "turned": "turned", "moved": "moved", "focal": "focal length", "shifted": "out of step",
    "swapped": "file exchanged", "unrelated": "shows something else",
}  # fmt: skip
_LONGEST = 1.6  # cells that the longest arrow spans


def blamed(report: CalibrationDiagnosis | None, name: str) -> str:
    """What is wrong with a camera in a word or two; empty for nothing."""
    if report is None:
        return ""
    return ", ".join(_KIND_NAMES[f.kind] for f in report.faults if name in f.cameras)


def cameras_table(quality: CalibrationQuality) -> str:
    """One row a camera, the likeliest culprit first where one was looked for."""
    report = quality.diagnosis
    head = [("Camera", "")]
    if report is not None:
        head += [("what is wrong", ""), ("culprit", "how likely this camera is what is wrong with the rig")]
    head += [
        ("residual", "median distance of a 2D point to its reprojection"),
        ("95 %", "95th percentile of the residual"),
        ("image covered", "share of the image where something was seen"),
        ("focal length", "as calibrated"),
        ("known to", _focal_meaning(quality)),
        ("position known to", "standard deviation from the adjustment, relative to all cameras"),
    ]
    left_out = bool(np.isfinite(quality.leave_one_out_px).any())
    if left_out:
        head.insert(-4, ("leave one out", "median distance to what the other cameras alone say"))
    order = report.order if report is not None and report.faults else range(len(quality.cameras))
    rows = []
    for c in order:
        camera = quality.cameras[c]
        cells = []
        if report is not None:
            said = blamed(report, camera.name)
            cells += [f'<td class="{"fault" if said else "none"}">{html.escape(said) or "nothing"}</td>',
                      f"<td>{percent_text(float(report.probability[c]))}</td>"]  # fmt: skip
        width = max(camera.width, camera.height)
        cells += [
            _heat_px(200 / width, quality.residual_px[c]),
            f"<td>{pixels(quality.p95_px[c])}</td>",
            *([_heat_px(100 / width, quality.leave_one_out_px[c])] if left_out else []),
            f"<td>{percent_text(quality.pictures[c].covered)}</td>",
            f"<td>{camera.params[0]:.0f} px</td>",
            _known(quality.focal_sd[c] * 100, "±{:.1f} %", 8.0 if quality.fitted else np.inf),
            _known(quality.position_sd[c] * 1000, "±{:.0f} mm", 200.0 if quality.fitted else np.inf),
        ]
        rows.append(f'<tr><th scope="row">{html.escape(camera.name)}</th>{"".join(cells)}</tr>')
    return table_of(head, rows)


def pixels(value: float) -> str:
    """A length in pixels, finer where it is small."""
    return number_text(value, 1 if not value < 1 else 2, " px")


def _heat_px(share: float, value: float) -> str:
    """A cell whose tint is full where `share` of the value is one."""
    if not np.isfinite(value):
        return '<td class="heat none">–</td>'
    return f'<td class="heat" style="--h:{100 * min(share * value, 1.0):.0f}%">{pixels(value)}</td>'


def _focal_meaning(quality: CalibrationQuality) -> str:
    if quality.fitted:
        return "standard deviation from the adjustment; where it is large, a low residual is no proof"
    return "how well these observations alone would tell the focal length; the calibration may know it better"


def _known(value: float, form: str, full: float) -> str:
    """A standard deviation, tinted up to where it is hopeless."""
    if not np.isfinite(value):
        return '<td class="none">–</td>'
    tint = min(100.0 * value / full, 100.0)
    return f'<td class="heat" style="--h:{tint:.0f}%">{form.format(value)}</td>'


def evidence_table(report: CalibrationDiagnosis) -> str:
    """How much better the rig would fit with each change to each camera."""
    meaning = "log-likelihood gained over held-out frames if this is put right, less the penalty for its parameters"
    head = [("Camera", ""), *((_KIND_NAMES[k], meaning) for k in KINDS)]
    most = max(float(report.evidence.max()), 1.0)
    rows = []
    for c in report.order:
        cells = "".join(
            f'<td class="heat" style="--h:{100 * max(v, 0.0) / most:.0f}%">{v:.0f}</td>' for v in report.evidence[c]
        )
        rows.append(f'<tr><th scope="row">{html.escape(report.names[c])}</th>{cells}</tr>')
    return table_of(head, rows)


def pictures_figure(quality: CalibrationQuality) -> str:
    """Residuals over every image, one figure a camera, all on one scale."""
    # A few cells of wrong points must not make all others pale, and their arrows vanish.
    full = float(f"{max(_usual(quality, [p.median_px for p in quality.pictures]), 0.1):.1g}")
    longest = max(_usual(quality, [np.linalg.norm(p.mean_px, axis=-1) for p in quality.pictures]), 1e-6)
    figures = "".join(
        f'<figure class="residuals">{_picture(camera, picture, full, longest)}'
        f"<figcaption>{html.escape(camera.name)}{_blame_caption(quality, camera)}</figcaption></figure>"
        for camera, picture in zip(quality.cameras, quality.pictures, strict=True)
    )
    return (
        f'<p class="lead"><span class="key heat">Tint</span> median residual in that part of the image, full at '
        f"{full:g} px. Arrows: where the 2D points lie from the reprojection, in the median; the longest are "
        f"{longest:.1f} px or more. Arrows that all point one way: the camera was turned. To or from the middle: "
        f"its focal length, or it was moved along its axis. Empty parts were never looked at.</p>"
        f'<div class="gallery">{figures}</div>'
    )


def _usual(quality: CalibrationQuality, values: Sequence[FloatArray]) -> float:
    """What nineteen of twenty points lie in cells of no more than."""
    count = np.concatenate([p.count.ravel() for p in quality.pictures])
    every = np.concatenate([v.ravel() for v in values])
    use = (count > 0) & np.isfinite(every)
    if not use.any():
        return 1.0
    order = np.argsort(every[use])
    share = np.cumsum(count[use][order]) / count[use].sum()
    return float(every[use][order][int(np.searchsorted(share, 0.95))])


def _blame_caption(quality: CalibrationQuality, camera: Camera) -> str:
    said = blamed(quality.diagnosis, camera.name)
    return f' <strong class="fault">{html.escape(said)}</strong>' if said else ""


def _picture(camera: Camera, picture: ImagePicture, full: float, longest: float) -> str:
    rows, columns = picture.count.shape
    cell = 24.0
    parts = []
    for r in range(rows):
        for q in range(columns):
            if not picture.count[r, q]:
                continue
            tint = min(100.0 * picture.median_px[r, q] / full, 100.0)
            title = f"{picture.count[r, q]} points, {picture.median_px[r, q]:.1f} px"
            parts.append(
                f'<rect class="cell" style="--h:{tint:.0f}%" x="{q * cell:g}" y="{r * cell:g}" width="{cell:g}" '
                f'height="{cell:g}"><title>{title}</title></rect>'
            )
    for r in range(rows):
        for q in range(columns):
            if picture.count[r, q] >= 3:
                by = picture.mean_px[r, q] / longest
                by = by / max(float(np.hypot(*by)), 1.0) * _LONGEST * cell
                parts.append(_arrow((q + 0.5) * cell, (r + 0.5) * cell, by))
    label = html.escape(f"residuals of {camera.name} over its image", quote=True)
    return (
        f'<svg role="img" aria-label="{label}" viewBox="-1 -1 {columns * cell + 2:g} {rows * cell + 2:g}" '
        f'style="aspect-ratio:{columns}/{rows}"><rect class="frame" width="{columns * cell:g}" '
        f'height="{rows * cell:g}"/>{"".join(parts)}</svg>'
    )


def _arrow(x: float, y: float, by: FloatArray) -> str:
    length = float(np.hypot(*by))
    if not length > 0.5:
        return f'<circle class="tip" cx="{x:.1f}" cy="{y:.1f}" r="1.2"/>'
    ahead, side = by / length, np.array([-by[1], by[0]]) / length
    tip = np.array([x, y]) + by
    size = min(5.0, 0.6 * length)
    wings = [tip - size * ahead + s * 0.5 * size * side for s in (-1, 1)]
    corners = " ".join(f"{p[0]:.1f},{p[1]:.1f}" for p in (tip, *wings))
    return (
        f'<line class="arrow" x1="{x:.1f}" y1="{y:.1f}" x2="{tip[0]:.1f}" y2="{tip[1]:.1f}"/>'
        f'<polygon class="tip" points="{corners}"/>'
    )


def plan_figure(cameras: CameraGroup, plan: Plan, faulty: Sequence[str]) -> str:
    """The room from above: how many images every place is in, the cameras, and where points were."""
    rows, columns = plan.cameras.shape
    scale = 10.0
    most = max(len(cameras), 1)

    def at(xy: FloatArray) -> tuple[float, float]:
        place = (np.asarray(xy) - plan.low) / plan.cell * scale
        return float(place[0]), float(rows * scale - place[1])

    parts = [
        f'<rect class="room" style="--h:{80 * n / most:.0f}%" x="{q * scale:g}" y="{(rows - 1 - r) * scale:g}" '
        f'width="{scale + 0.3:g}" height="{scale + 0.3:g}"><title>in {n} images</title></rect>'
        for r in range(rows) for q in range(columns) if (n := int(plan.cameras[r, q]))
    ]  # fmt: skip
    dots = " ".join(f"M{x:.1f} {y:.1f}h0" for x, y in (at(p) for p in plan.points))
    parts.append(f'<path class="dots" d="{dots}"/>')
    for camera in cameras:
        parts.append(_camera_mark(camera, at(camera.center_world[:2]), camera.name in faulty, columns * scale))
    step = next(s for s in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0) if s / plan.cell * scale > 50 or s == 50.0)
    bar = step / plan.cell * scale
    foot = rows * scale + 16
    parts.append(f'<path class="rule" d="M4 {foot:.0f}h{bar:.1f}"/>')
    parts.append(f'<text x="{bar + 10:.0f}" y="{foot + 5:.0f}">{step:g} m</text>')
    three = "" if not np.isfinite(plan.seen_by_three) else (
        f" {plan.seen_by_three:.0%} of the points were seen by three cameras or more."
    )  # fmt: skip
    return (
        f'<p class="lead"><span class="key bar">Tint</span> how many of the {len(cameras)} images a place at '
        f"{plan.height:.1f} m above the floor is in. Dots: where points were.{three}</p>"
        f'<figure class="plan"><svg role="img" aria-label="the room from above" '
        f'viewBox="0 0 {columns * scale:g} {rows * scale + 30:g}" '
        f'style="max-width:{1.8 * columns * scale:.0f}px">{"".join(parts)}</svg></figure>'
    )


def _camera_mark(camera: Camera, at: tuple[float, float], faulty: bool, width: float) -> str:
    """A wedge that looks where the camera looks, with its name."""
    axis = camera.rotation[2, :2] * [1, -1]
    axis = axis / max(float(np.hypot(*axis)), 1e-9)
    side = np.array([-axis[1], axis[0]])
    x = np.array(at)
    corners = " ".join(f"{p[0]:.1f},{p[1]:.1f}" for p in (x, x + 16 * axis + 8 * side, x + 16 * axis - 8 * side))
    anchor = "end" if at[0] > 0.85 * width else "start" if at[0] < 0.15 * width else "middle"
    label = x + np.array([0.0, 16.0 if axis[1] < 0 else -16.0])
    return (
        f'<g class="camera{" fault" if faulty else ""}"><polygon points="{corners}"/><circle cx="{at[0]:.1f}" '
        f'cy="{at[1]:.1f}" r="4"/><text x="{label[0]:.1f}" y="{label[1] + 4:.1f}" text-anchor="{anchor}">'
        f"{html.escape(camera.name)}</text></g>"
    )
