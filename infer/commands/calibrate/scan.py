"""`muybridge calibrate scan`: fixed cameras from photographs, or a video, walked around the room."""

import shutil
import tempfile
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro

from muybridge.arrays import ByteArray
from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.structure_from_motion import (
    FIXED_FOLDER,
    SCAN_FOLDER,
    ScanCalibration,
    ScanOptions,
    calibrate_scan,
)
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.discover import IMAGE_SUFFIXES
from muybridge.infer.session.pairing import natural_key
from muybridge.infer.session.probe import is_video, probe_video
from muybridge.infer.session.video import read_chunks

_STILL_FRAMES = 9  # of a fixed camera's video, whose median has nobody walking through

COMMON_OPTIONS = {
    "scan": (
        "cameras", "out", "overwrite", "distance", "between", "marker_size", "marker_id", "marker_on_floor", "lenses",
    )
}  # fmt: skip


def scan(
    photos: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PHOTOS_OR_VIDEO")],
    /,
    cameras: Path,
    out: Path,
    between: tuple[str, ...] = (),
    lenses: Path | None = None,
    max_photos: int = 80,
    options: ScanOptions = ScanOptions(),  # noqa: B008 - frozen
    model: Path | None = None,
    overwrite: bool = False,
) -> int:
    """Cameras from a scan: photographs or a video that somebody took walking around the room.

    Args:
        photos: folder of photographs, or a video, all of one camera (a phone).
        cameras: folder with one video or picture a fixed camera, named after it (a session's `videos/`).
        out: calibration file to write (TOML).
        between: the two cameras whose distance --distance is.
        lenses: calibration file whose lenses the fixed cameras of the same names have; they are held.
        max_photos: as many photographs, sharp and evenly spread, are taken of a video at most.
        options: how.
        model: folder to keep COLMAP's model in.
        overwrite: replace files there that muybridge did not write.
    """
    check_replaceable([out] if model is None else [out, model], overwrite)
    known = None if lenses is None else load_calibration(lenses)
    with tempfile.TemporaryDirectory(prefix="muybridge-scan-") as temporary, Progress() as progress:
        images = Path(temporary) / "images"
        count = _scan_photos(photos, images / SCAN_FOLDER, max_photos)
        names = _stills(cameras, images / FIXED_FOLDER)
        progress.say(f"{count} photographs, {len(names)} fixed cameras: features, matching and reconstruction")
        work = Path(temporary) / "work"
        work.mkdir()
        found = calibrate_scan(images, work, known, between, options)
        if model is not None:
            shutil.copytree(work / "model", model, dirs_exist_ok=True)
    save_calibration(found.cameras, out)
    for line in told(found, count):
        print(line)
    print(f"written to {out}")
    return 0


def told(found: ScanCalibration, count: int) -> list[str]:
    """What was found, a line a camera."""
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


def _scan_photos(source: Path, folder: Path, most: int) -> int:
    """Put the scan's photographs into a folder; returns how many."""
    folder.mkdir(parents=True)
    if source.is_dir():
        pictures = (p for p in source.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES)
        files = sorted(pictures, key=lambda p: natural_key(p.name))
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


def _stills(source: Path, folder: Path) -> list[str]:
    """Put one still a fixed camera into a folder, named after the camera; returns the names."""
    folder.mkdir(parents=True)
    if not source.is_dir():
        raise CalibrationError(f"{source} is no folder; --cameras wants one with a video or picture a camera")
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
        raise CalibrationError(f"{source} holds no video or picture of a fixed camera")
    return names


def _write(path: Path, rgb: ByteArray) -> None:
    cv2.imwrite(str(path), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
