"""What a report is made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D

if TYPE_CHECKING:
    from muybridge.infer.viewer.data import Scene


@dataclass(frozen=True)
class PersonPage:
    """One person's report.

    Attributes:
        file: its name, relative to the others.
        coverage: share of frames x landmarks with a 3D point.
        leave_one_out_px: median leave-one-camera-out error.
    """

    file: str
    coverage: float
    leave_one_out_px: float


@dataclass(frozen=True)
class Thumbnail:
    """One frame of an overlay.

    Attributes:
        camera: the camera's name.
        frame: its frame number; a click shows it in the 3D view.
        jpeg: the image, as returned by `overlay.write_overlay`.
    """

    camera: str
    frame: int
    jpeg: bytes


@dataclass(frozen=True, kw_only=True)
class ReportData:
    """Everything a report shows. Only the first three are required.

    Attributes:
        title: the session's name.
        cameras: C cameras, as used (after crops and scalings); None where points come from a file.
        points: T frames of J landmarks, as triangulated: missing landmarks and disagreement are reported from these.
        delivered: the points as they were written (smoothed, gaps filled), shown in 3D; None: `points`.
        number: of this person in the take, from 1.
        others: (T, J, 3) the other people's points as written, by number, shown in 3D.
        pages: everyone's reports by number, this one among them; empty for one person alone.
        keypoints_px: (C, T, J, 2) the person's 2D points, NaN where missing; from them a shifted, lagging or
            left-right-flipping camera is recognised.
        leave_one_out_px: (C, T, J) distance of a 2D point to what the other cameras say; NaN where unknown.
        joint_positions_world: (T, Jm, 3) the fitted motion's joints, metres.
        joint_names: (Jm,) their names.
        joint_parents: (Jm,) index of the parent joint, -1 for the root.
        body_residual_m: (T, J) distance of the points to those of the fitted body, metres; the measure of agreement
            without cameras.
        calibration: the calibration judged by this take; None where it was not.
        person: one sentence: who was tracked, and why.
        warnings: notices of the run, as sentences.
        timings_s: seconds by stage, in order.
        quality: figures to list as they are (also in `run.json`).
        options: the resolved options, nested by stage.
        versions: of muybridge and the libraries it ran with.
        thumbnails: frames of the overlays.
        files: names of the other results, relative to the report.
        character: the character that this person's motion was put onto, with the motion; None where there is none.
    """

    title: str
    cameras: CameraGroup | None
    points: Points3D
    delivered: Points3D | None = None
    number: int = 1
    others: tuple[FloatArray, ...] = ()
    pages: tuple[PersonPage, ...] = ()
    keypoints_px: FloatArray | None = None
    leave_one_out_px: FloatArray | None = None
    body_residual_m: FloatArray | None = None
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
    character: Scene | None = None


def check_shapes(data: ReportData) -> None:
    """Check that the arrays fit each other.

    Raises:
        ValueError: they do not.
    """
    count, frames = 0 if data.cameras is None else len(data.cameras), len(data.points.points_world)
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
        ("body_residual_m", data.body_residual_m, (frames, landmarks)),
        ("joint_positions_world", data.joint_positions_world, (frames, len(data.joint_names), 3)),
    ]
    if frames == 0:
        raise ValueError("a report needs at least one frame")
    for name, array, shape in shapes:
        if array is not None and array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    if len(data.joint_parents) != len(data.joint_names):
        raise ValueError("joint_parents and joint_names differ in length")
