"""`report.html`: one file that shows a take and says what went wrong and where. It opens without a network.

The page holds the motion (16-bit integers in base64), its figures, the styles and the scripts of
`assets/`. A content security policy inside it forbids every request.
"""

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.files import replacing
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import side_of
from muybridge.infer.report.calibration_page import calibration_findings, calibration_in_report
from muybridge.infer.report.figures import (
    BoneFigures,
    CameraFigures,
    bone_figures,
    camera_figures,
    headline,
    timeline,
)
from muybridge.infer.report.findings import Finding, findings
from muybridge.infer.report.packing import (
    fill_page,
    packed_positions,
    packed_shares,
    read_asset,
    rounded,
    script_json,
)
from muybridge.infer.report.sections import (
    PersonPage,
    bones_section,
    cameras_section,
    findings_section,
    heading_section,
    landmarks_section,
    people_section,
    run_section,
    thumbnails_section,
)

# Beyond this many frames the 3D view shows every second, third, ... frame.
_MOST_FRAMES = 40_000


@dataclass(frozen=True)
class Thumbnail:
    """One picture of an overlay.

    Attributes:
        camera: the camera's name.
        frame: its frame number; a click shows it in the 3D view.
        jpeg: the picture, as `overlay.write_overlay` hands it back.
    """

    camera: str
    frame: int
    jpeg: bytes


@dataclass(frozen=True, kw_only=True)
class ReportData:
    """Everything a report shows. Only the first three are needed.

    Attributes:
        title: the session's name.
        cameras: C cameras, as used (after crops and scalings).
        points: T frames of J landmarks, as triangulated: what is missing and what disagrees is theirs.
        delivered: the points as they were written (smoothed, gaps filled), shown in 3D; None: `points`.
        number: which of the people in the take this is, from 1.
        others: (T, J, 3) of everybody else as written to files of their own, by number, shown in 3D.
        pages: everybody's reports in the order of their numbers, this one among them; none of one alone.
        keypoints_px: (C, T, J, 2) the person's 2D points, NaN where missing; they tell a shifted, lagging or
            left-right-swapping camera.
        leave_one_out_px: (C, T, J) distance of a 2D point to what the other cameras say; NaN where unknown.
        joint_positions_world: (T, Jm, 3) the fitted motion's joints, metres.
        joint_names: (Jm,) their names.
        joint_parents: (Jm,) index of the parent joint, -1 for the root.
        calibration: the calibration judged by this take; None where it was not.
        person: one sentence: who was picked as the person, and why.
        warnings: what the run warned of, as sentences.
        timings_s: seconds by stage, in order.
        quality: figures to list as they are (also in `run.json`).
        options: the resolved options, nested by stage.
        versions: what the run was made with.
        thumbnails: pictures from the overlays.
        files: names of the other results, relative to the report.
    """

    title: str
    cameras: CameraGroup
    points: Points3D
    delivered: Points3D | None = None
    number: int = 1
    others: tuple[FloatArray, ...] = ()
    pages: tuple[PersonPage, ...] = ()
    keypoints_px: FloatArray | None = None
    leave_one_out_px: FloatArray | None = None
    joint_positions_world: FloatArray | None = None
    joint_names: tuple[str, ...] = ()
    joint_parents: tuple[int, ...] = ()
    calibration: CalibrationQuality | None = None
    person: str = ""
    warnings: tuple[str, ...] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)
    quality: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    thumbnails: tuple[Thumbnail, ...] = ()
    files: tuple[str, ...] = ()


def write_report(path: Path, data: ReportData) -> Path:
    """Write the page; it appears under `path` only when it is complete.

    Raises:
        OutputError: the file cannot be written.
        ValueError: arrays of `data` do not fit each other.
    """
    page = render_report(data)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
    return path


def render_report(data: ReportData) -> str:
    """The page as text."""
    _check(data)
    points = data.points
    cameras, bones, said = _looked_at(data)
    summary = headline(data.cameras, points, data.delivered or points, data.leave_one_out_px)
    pictures = [(t.camera, t.frame, base64.b64encode(t.jpeg).decode("ascii")) for t in data.thumbnails]
    parts = {
        "title": html.escape(data.title),
        "css": read_asset("report.css"),
        "heading": heading_section(data.title, points, summary, bones, len(cameras), data.timings_s, data.files)
        + people_section(data.number, data.pages),
        "findings": findings_section(said, data.person),
        "cameras": cameras_section(cameras),
        "calibration": calibration_in_report(data.calibration),
        "landmarks": landmarks_section(points, cameras),
        "bones": bones_section(bones),
        "thumbnails": thumbnails_section(pictures),
        "run": run_section(data.timings_s, data.quality, data.options, data.versions),
        "data": script_json(_scene(data)),
        "js": read_asset("report_view.js") + "\n" + read_asset("report.js"),
    }
    return fill_page("report.html", parts)


def problems(data: ReportData) -> tuple[str, ...]:
    """What spoils the result, a sentence each: what the page shows as problems."""
    return tuple(finding.text for finding in _looked_at(data)[2] if finding.severity == "bad")


def _looked_at(
    data: ReportData,
) -> tuple[tuple[CameraFigures, ...], tuple[BoneFigures, ...], tuple[Finding, ...]]:
    """Figures of cameras and bones, and what is to be said, the worst first."""
    cameras = camera_figures(data.cameras, data.points, data.keypoints_px, data.leave_one_out_px)
    bones = bone_figures(data.points)
    report = None if data.calibration is None else data.calibration.diagnosis
    judged = report is not None and bool(np.isfinite(report.noise_px))
    said = (*calibration_findings(data.calibration), *findings(data.points, cameras, bones, data.warnings, judged))
    order = {"bad": 0, "look": 1, "note": 2}
    return cameras, bones, tuple(sorted(said, key=lambda finding: order[finding.severity]))


def _check(data: ReportData) -> None:
    count, frames = len(data.cameras), len(data.points.points_world)
    landmarks = len(data.points.landmarks)
    shapes: list[tuple[str, Any, tuple[int, ...]]] = [
        ("points.points_world", data.points.points_world, (frames, landmarks, 3)),
        ("points.residual_px", data.points.residual_px, (count, frames, landmarks)),
        ("points.inlier", data.points.inlier, (count, frames, landmarks)),
        (
            "delivered.points_world",
            None if data.delivered is None else data.delivered.points_world,
            (frames, landmarks, 3),
        ),
        *((f"others[{n}]", other, (frames, landmarks, 3)) for n, other in enumerate(data.others)),
        ("keypoints_px", data.keypoints_px, (count, frames, landmarks, 2)),
        ("leave_one_out_px", data.leave_one_out_px, (count, frames, landmarks)),
        ("joint_positions_world", data.joint_positions_world, (frames, len(data.joint_names), 3)),
    ]
    if frames == 0:
        raise ValueError("a report needs at least one frame")
    for name, array, shape in shapes:
        if array is not None and array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if len(data.joint_parents) != len(data.joint_names):
        raise ValueError("joint_parents and joint_names differ in length")


def _scene(data: ReportData) -> dict[str, Any]:
    """What the scripts draw: cameras, landmarks, joints and the timeline."""
    points, shown = data.points, data.delivered or data.points
    names = points.landmarks.names
    stride = -(-len(points.points_world) // _MOST_FRAMES)
    line = timeline(points)
    scene: dict[str, Any] = {
        "frames": len(points.points_world),
        "stride": stride,
        "fps": round(points.fps, 4),
        "cameras": [_camera(camera) for camera in data.cameras],
        "landmarks": {
            "names": list(names),
            "sides": [side_of(name) for name in names],
            "edges": [list(edge) for edge in points.landmarks.edge_indices],
            "positions": packed_positions(shown.points_world[::stride]),
        },
        "joints": None,
        "number": data.number,
        "others": [packed_positions(other[::stride]) for other in data.others],
        "timeline": {
            "first": line.first_frame.tolist(),
            "missing": packed_shares(line.missing * 100.0),
            "cameras": packed_shares(np.nan_to_num(line.cameras) / len(data.cameras) * 100.0),
            "residual": [[rounded(v) for v in column] for column in line.residual_px.T],
        },
    }
    if data.joint_positions_world is not None and data.joint_names:
        scene["joints"] = {
            "names": list(data.joint_names),
            "sides": [side_of(name) for name in data.joint_names],
            "edges": [[p, j] for j, p in enumerate(data.joint_parents) if p >= 0],
            "positions": packed_positions(data.joint_positions_world[::stride]),
        }
    return scene


def _camera(camera: Camera) -> dict[str, Any]:
    """Centre, the four image corners as points one metre deep, axes and field of view, in world axes."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])
    normalised = camera.unproject(corners)
    rays = np.concatenate([normalised, np.ones((4, 1))], axis=1) @ camera.rotation
    return {
        "name": camera.name,
        "center": [rounded(v, 4) for v in camera.center_world],
        "corners": [[rounded(v, 4) for v in ray] for ray in rays],
        "rotation": [[rounded(v, 5) for v in row] for row in camera.rotation],
        "focal": rounded(camera.camera_matrix[1, 1] / camera.height, 5),
        "principal": [
            rounded((camera.camera_matrix[0, 2] + 0.5) / camera.width, 5),
            rounded((camera.camera_matrix[1, 2] + 0.5) / camera.height, 5),
        ],
        "aspect": rounded(camera.width / camera.height, 5),
    }


def pick_thumbnail_frames(points: Points3D, count: int = 4) -> Sequence[int]:
    """Frames worth a picture: spread over the take, and the one that the cameras agree on least.

    Args:
        points: the take.
        count: how many frames in all.

    Returns:
        Sorted frame numbers, at most `count`.
    """
    frames = len(points.points_world)
    spread = np.linspace(0, frames - 1, count + 1)[1:-1] if count > 1 else np.array([frames // 2])
    chosen = {int(t) for t in spread}
    residual = np.where(np.isfinite(points.residual_px), points.residual_px, 0.0).mean(axis=(0, 2))
    chosen.add(int(residual.argmax()))
    return sorted(chosen)[:count]
