"""`report.html`: one file that shows a take and reports what went wrong and where. It opens without a network.

The page holds the motion (16-bit integers in base64), its figures, the styles and the scripts of `assets/`. A content
security policy inside it forbids every request.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from muybridge.arrays import FloatArray
from muybridge.files import replacing
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import side_of
from muybridge.infer.report.data import ReportData, check_shapes
from muybridge.infer.report.figures import Timeline, timeline
from muybridge.infer.report.packing import packed_positions, packed_shares, rounded
from muybridge.infer.report.templates import page_style, render, script_json, style_or_script
from muybridge.infer.report.view import ReportView, calibration_verdict
from muybridge.infer.viewer.page import component, component_script, component_style

# Beyond this many frames the 3D view shows every second, third, ... frame.
_MOST_FRAMES = 40_000


def write_report(path: Path, data: ReportData) -> Path:
    """Write the page atomically.

    Raises:
        OutputError: the file cannot be written.
        ValueError: arrays of `data` do not fit each other.
    """
    page = render_report(data)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
    return path


def render_report(data: ReportData) -> str:
    """The page as text.

    Raises:
        ValueError: arrays of `data` do not fit each other.
    """
    check_shapes(data)
    character = data.character
    return render(
        "report.html",
        title=data.title,
        view=ReportView(data),
        number=data.number,
        pages=data.pages,
        person=data.person,
        calibration=calibration_verdict(data.calibration),
        files=data.files,
        timings_s=data.timings_s,
        quality=data.quality,
        options=data.options,
        versions=data.versions,
        character=None if character is None else Markup(component([character])),
        character_file=None if character is None else character.packed["name"],
        css=page_style() if character is None else page_style() + Markup(component_style()),
        js=style_or_script("report_view.js", "report.js") + Markup("" if character is None else component_script()),
        data=script_json(_scene(data)),
    )


def problems(data: ReportData) -> tuple[str, ...]:
    """What spoils the result, as sentences: what the page shows as problems."""
    return tuple(finding.text for finding in ReportView(data).findings if finding.severity == "bad")


def _scene(data: ReportData) -> dict[str, Any]:
    """Data for the scripts: cameras, landmarks, joints and the timeline."""
    points, shown = data.points, data.delivered or data.points
    names = points.landmarks.names
    stride = -(-len(points.points_world) // _MOST_FRAMES)
    line = timeline(points)
    scene: dict[str, Any] = {
        "frames": len(points.points_world),
        "stride": stride,
        "fps": round(points.fps, 4),
        "cameras": [_camera(camera) for camera in data.cameras or ()],
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
            "cameras": packed_shares(_agreeing(data, line) * 100.0),
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


def _agreeing(data: ReportData, line: Timeline) -> FloatArray:
    """(B, J) share of the cameras that agree; without cameras, whether there is a point."""
    if data.cameras is None:
        return np.where(line.missing < 1, 1.0, 0.0)
    return np.nan_to_num(line.cameras) / len(data.cameras)


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
    """Frames to show as thumbnails: spread over the take, and the one that the cameras agree on least.

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
