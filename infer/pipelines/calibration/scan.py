"""Fixed cameras calibrated from photographs or a video taken while walking around the room."""

import shutil
import tempfile
from pathlib import Path

import cv2
import numpy as np

from muybridge.arrays import ByteArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.structure_from_motion import (
    FIXED_FOLDER,
    SCAN_FOLDER,
    ScanCalibration,
    ScanOptions,
    calibrate_scan,
)
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.discover import IMAGE_SUFFIXES
from muybridge.infer.session.pairing import natural_key
from muybridge.infer.session.probe import is_video, probe_video
from muybridge.infer.session.video import read_chunks

_STILL_FRAMES = 9  # of a fixed camera's video, whose median has nobody walking through


def calibrate_from_scan(
    photos: Path,
    cameras: Path,
    options: ScanOptions,
    progress: Progress,
    between: tuple[str, ...] = (),
    lenses: Path | None = None,
    max_photos: int = 80,
    model: Path | None = None,
) -> tuple[ScanCalibration, int]:
    """Calibrate fixed cameras from a scan of the room.

    Args:
        photos: folder of photographs, or a video, all of one camera.
        cameras: folder with one video or image per fixed camera, named as the camera.
        options: of the calibration.
        progress: receives progress messages.
        between: the two cameras whose distance is known.
        lenses: calibration file whose lenses the fixed cameras of the same names keep.
        max_photos: most photographs that are taken from a video.
        model: folder for COLMAP's model; None to drop it.

    Returns:
        The calibration, and the number of photographs.

    Raises:
        CalibrationError: there is nothing to calibrate from, or it does not suffice.
    """
    known = None if lenses is None else load_calibration(lenses)
    with tempfile.TemporaryDirectory(prefix="muybridge-scan-") as temporary:
        images = Path(temporary) / "images"
        count = _copy_photos(photos, images / SCAN_FOLDER, max_photos)
        names = _copy_stills(cameras, images / FIXED_FOLDER)
        progress.say(f"{count} photographs, {len(names)} fixed cameras: features, matching and reconstruction")
        work = Path(temporary) / "work"
        work.mkdir()
        found = calibrate_scan(images, work, known, between, options)
        if model is not None:
            shutil.copytree(work / "model", model, dirs_exist_ok=True)
    return found, count


def format_summary(found: ScanCalibration, count: int) -> list[str]:
    """The result in sentences, one line per camera."""
    rows = [f"{found.photos} of {count} photographs fit together, {len(found.points_world)} points"]
    if np.isfinite(found.marker_px):
        rows.append(f"marker: {found.marker_px:.2f} px")
    for c, camera in enumerate(found.cameras):
        x, y, z = camera.center_world
        rows.append(
            f"{camera.name}: at ({x:.2f}, {y:.2f}, {z:.2f}) m, focal length {camera.params[0]:.0f} px, reprojection "
            f"{found.residual_px[c]:.2f} px of {found.matched[c]} points"
        )
    return [*rows, *(f"note: {note}" for note in found.notes)]


def _copy_photos(source: Path, folder: Path, most: int) -> int:
    """Put the scan's photographs into a folder; returns how many."""
    folder.mkdir(parents=True)
    if source.is_dir():
        images = (p for p in source.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        files = sorted(images, key=lambda p: natural_key(p.name))
        for k, file in enumerate(files):
            shutil.copy(file, folder / f"{k:05d}{file.suffix.lower()}")
        if not files:
            raise CalibrationError(f"{source} holds no photographs ({', '.join(sorted(IMAGE_SUFFIXES))})")
        return len(files)
    if not source.is_file() or not is_video(source):
        raise CalibrationError(f"{source} is neither a folder of photographs nor a video")
    video = probe_video(source)
    # Of each stretch the sharpest of three frames: a hand that walks shakes.
    stretches = np.array_split(np.arange(video.frames), min(most, video.frames))
    for k, stretch in enumerate(stretches):
        tried = stretch[np.unique(np.linspace(0, len(stretch) - 1, 3).round().astype(int))]
        frames = np.concatenate(list(read_chunks(video, tried.astype(np.int64))))
        sharpness = [cv2.Laplacian(cv2.cvtColor(f, cv2.COLOR_RGB2GRAY), cv2.CV_64F).var() for f in frames]
        _write(folder / f"{k:05d}.png", frames[int(np.argmax(sharpness))])
    return len(stretches)


def _copy_stills(source: Path, folder: Path) -> list[str]:
    """Put one still per fixed camera into a folder, named as the camera; returns the names."""
    folder.mkdir(parents=True)
    if not source.is_dir():
        raise CalibrationError(f"{source} is no folder of one video or image per fixed camera")
    names = []
    for file in sorted(source.iterdir(), key=lambda p: natural_key(p.name)):
        if file.name.startswith(".") or not file.is_file():
            continue
        if file.suffix.lower() in IMAGE_SUFFIXES:
            shutil.copy(file, folder / f"{file.stem}{file.suffix.lower()}")
        elif is_video(file):
            video = probe_video(file)
            at = np.unique(np.linspace(0, video.frames - 1, _STILL_FRAMES).round().astype(np.int64))
            frames = np.concatenate(list(read_chunks(video, at)))
            _write(folder / f"{file.stem}.png", np.median(frames, axis=0).astype(np.uint8))
        else:
            continue
        names.append(file.stem)
    if not names:
        raise CalibrationError(f"{source} holds no video or image of a fixed camera")
    return names


def _write(path: Path, rgb: ByteArray) -> None:
    cv2.imwrite(str(path), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
