"""Cameras of a session calibrated from the people in its videos."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.calibration.people.calibrate import (
    PeopleCalibration,
    PeopleCalibrationOptions,
    calibrate_people,
    refine_people,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.triangulation.left_right import repair_flips
from muybridge.geometry.triangulation.validation import leave_one_out_error
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.reconstruction.refine_cameras import person_of
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session


@dataclass(frozen=True)
class SessionCalibration:
    """Cameras calibrated from people.

    Attributes:
        before: the session's cameras.
        result: the calibrated cameras.
        refined: whether the calibration started from the poses of `before`.
        errors_px: median leave-one-camera-out error before and after; the first is NaN unless `refined`.
    """

    before: CameraGroup
    result: PeopleCalibration
    refined: bool
    errors_px: tuple[float, float]


def calibrate_from_people(
    path: Path,
    results: Path | None,
    refine: bool,
    options: PeopleCalibrationOptions,
    session: SessionOptions,
    detect: DetectOptions,
    progress: Progress,
) -> SessionCalibration:
    """Calibrate the cameras of a session from the people in its videos.

    Args:
        path: the session's folder.
        results: results folder whose 2D landmarks are used where they are there; None for the session's own.
        refine: start from the poses of the session's calibration; otherwise only its lenses are used.
        options: of the calibration.
        session: how the session folder is read.
        detect: how 2D landmarks are detected.
        progress: receives progress messages.

    Raises:
        MuybridgeError: the session cannot be used, or its people do not suffice.
    """
    opened = open_session(path, session)
    for notice in opened.notices:
        progress.notice(notice)
    opened, keypoints = session_keypoints(opened, results, detect, progress)
    return calibrate_from_keypoints(opened.cameras, keypoints, opened.fps, refine, options)


def calibrate_from_keypoints(
    cameras: CameraGroup, keypoints: Keypoints2D, fps: float, refine: bool, options: PeopleCalibrationOptions
) -> SessionCalibration:
    """Calibrate cameras from everyone's 2D landmarks; arguments as in `calibrate_from_people`."""
    selection = person_of(cameras, keypoints, fps) if refine else select_person(cameras, keypoints, fps=fps)
    px, variance, _ = take_person(keypoints, selection)
    px, variance, _ = repair_flips(cameras, px, variance, keypoints.landmarks)
    calibrate = refine_people if refine else calibrate_people
    result = calibrate(cameras, px, variance, keypoints.landmarks.names, options)
    before = float(np.nanmedian(leave_one_out_error(cameras, px, variance))) if refine else np.nan
    after = float(np.nanmedian(leave_one_out_error(result.cameras, px, variance)))
    return SessionCalibration(cameras, result, refine, (before, after))


def format_summary(found: SessionCalibration) -> list[str]:
    """The result in sentences, one line per camera."""
    result = found.result
    lines = list(result.notes)
    for c, camera in enumerate(result.cameras):
        change = ""
        if found.refined:
            cosine = (np.trace(camera.rotation @ found.before[c].rotation.T) - 1) / 2
            distance = np.linalg.norm(camera.center_world - found.before[c].center_world)
            angle = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            change = f"turned by {angle:.2f} deg, moved by {distance * 1e3:.0f} mm, "
        lines.append(
            f"{camera.name}: {change}reprojection {np.nanmedian(result.residual_px[c]):.1f} px, "
            f"known to {result.rotation_sd_deg[c].max():.2f} deg and {result.center_sd[c].max() * 1e3:.0f} mm"
        )
    before = f"{found.errors_px[0]:.1f} px before, " if found.refined else ""
    lines.append(f"leave-one-camera-out error (median): {before}{found.errors_px[1]:.1f} px after, on the frames used")
    return lines
