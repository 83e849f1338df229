"""Export of cameras to other programs' formats; properties that a format cannot store are refused, never dropped."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

from muybridge.errors import CalibrationError, OutputError
from muybridge.files import replacing
from muybridge.geometry.calibration.formats.table import WRITERS
from muybridge.geometry.cameras.group import CameraGroup

ExportFormat = Literal[
    "muybridge", "anipose", "freemocap", "pose2sim", "caliscope", "opencv", "easymocap", "qualisys", "vicon",
    "optitrack", "colmap",
]  # fmt: skip
EXPORT_FORMATS: tuple[ExportFormat, ...] = get_args(ExportFormat)
"""Names of the formats that `export_calibration` writes."""


def export_calibration(cameras: CameraGroup, path: Path, how: ExportFormat) -> list[Path]:
    """Write cameras in a format; `read_calibration` reads every one of them back.

    Args:
        cameras: C cameras.
        path: the file; for `easymocap` and `colmap`, which consist of several files, their folder.
        how: one of `EXPORT_FORMATS`.

    Returns:
        The files that were written.

    Raises:
        CalibrationError: a camera whose lens the format cannot store; the message names it.
        OutputError: a file cannot be written.
    """
    path = Path(path)
    files = export_texts(cameras, path, how)
    if path not in files:
        try:
            path.mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(f"{path}: is not a folder and cannot be created ({error.strerror})") from None
    if not next(iter(files)).parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; choose one that exists")
    for file, text in files.items():
        with replacing(file) as partial:
            partial.write_text(text, encoding="utf-8", newline="\n")
    return list(files)


def export_texts(cameras: CameraGroup, path: Path, how: ExportFormat) -> dict[Path, str]:
    """The files that `export_calibration` writes, and their contents.

    Raises:
        CalibrationError: a camera whose lens the format cannot store; the message names it.
    """
    try:
        content = WRITERS[how](cameras)
    except ValueError as error:
        raise CalibrationError(
            f"{path}: {error}; write it as muybridge (which keeps everything), or calibrate with a simpler lens"
        ) from None
    if isinstance(content, str):
        return {path: content}
    return {path / name: text for name, text in content.items()}
