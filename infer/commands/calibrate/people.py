"""`muybridge calibrate people`: cameras of a session from the people in its videos."""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.calibration import save_calibration
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
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.reconstruction.refine_cameras import person_of
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session

COMMON_OPTIONS = {"people": ("out", "overwrite", "refine", "height", "work", "calibration", "cameras", "workers")}


def people(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path,
    refine: bool = True,
    options: PeopleCalibrationOptions = PeopleCalibrationOptions(),  # noqa: B008 - frozen
    work: Path | None = None,
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
    overwrite: bool = False,
) -> int:
    """Cameras from the people who move before them: refine a calibration, or find the poses from nothing.

    Args:
        path: folder with `videos/` and a calibration; with --no-refine only its lenses are used.
        out: calibration file to write (TOML); give it to `muybridge run` with --calibration.
        refine: start from the calibration's poses and keep its world; otherwise poses, size and floor come
            from the person.
        options: how.
        work: results folder whose finished 2D landmarks are used (default: `muybridge/` inside the session).
        session: how the session folder is read.
        detect: 2D landmarks.
        overwrite: replace files there that muybridge did not write.
    """
    check_replaceable([out], overwrite)
    with Progress() as progress:
        opened = open_session(path, session)
        for notice in opened.notices:
            progress.notice(notice)
        opened, keypoints = session_keypoints(opened, work, detect, progress)
        result, errors = from_keypoints(opened.cameras, keypoints, opened.fps, refine, options)
    save_calibration(result.cameras, out)
    for line in told(opened.cameras, result, refine, errors):
        print(line)
    return 0


def from_keypoints(
    cameras: CameraGroup, keypoints: Keypoints2D, fps: float, refine: bool, options: PeopleCalibrationOptions
) -> tuple[PeopleCalibration, tuple[float, float]]:
    """Calibrate from a session's landmarks.

    Returns:
        The result, and the median leave-one-camera-out error before and after, px (the first is NaN where
        there was no calibration to begin with).
    """
    selection = person_of(cameras, keypoints, fps) if refine else select_person(cameras, keypoints, fps=fps)
    px, variance, score = take_person(keypoints, selection)
    px, variance, _ = repair_flips(cameras, px, variance, keypoints.landmarks)
    names = keypoints.landmarks.names
    run = refine_people if refine else calibrate_people
    result = run(cameras, px, variance, names, options)
    before = float(np.nanmedian(leave_one_out_error(cameras, px, variance))) if refine else np.nan
    after = float(np.nanmedian(leave_one_out_error(result.cameras, px, variance)))
    return result, (before, after)


def told(before: CameraGroup, result: PeopleCalibration, refine: bool, errors: tuple[float, float]) -> list[str]:
    """What was found, a line a camera."""
    lines = list(result.notes)
    for c, camera in enumerate(result.cameras):
        change = ""
        if refine:
            cosine = (np.trace(camera.rotation @ before[c].rotation.T) - 1) / 2
            moved = np.linalg.norm(camera.center_world - before[c].center_world)
            turned = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
            change = f"turned by {turned:.2f} deg, moved by {moved * 1e3:.0f} mm, "
        lines.append(
            f"{camera.name}: {change}reprojection {np.nanmedian(result.residual_px[c]):.1f} px, "
            f"known to {result.rotation_sd_deg[c].max():.2f} deg and {result.center_sd[c].max() * 1e3:.0f} mm"
        )
    was = f"{errors[0]:.1f} px before, " if refine else ""
    lines.append(f"leave-one-camera-out error (median): {was}{errors[1]:.1f} px after, on the frames used")
    return lines
