"""`muybridge calibrate convert`: a calibration in another program's format."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration import ExportFormat, export_calibration, read_calibration
from muybridge.geometry.calibration.formats.export import export_texts
from muybridge.infer.results.ownership import check_replaceable, refuse_root


def convert(
    calibration: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CALIBRATION")],
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")],
    /,
    to: ExportFormat = "muybridge",
    overwrite: bool = False,
) -> int:
    """Convert a calibration between formats: Anipose, OpenCV, Vicon, COLMAP and others.

    Example:
        muybridge calibrate convert calibration.toml cameras.yml --to opencv

    Args:
        calibration: file (or folder of a COLMAP model); its format is recognised by its content.
        out: file to write; a folder for easymocap and colmap.
        to: format to write. A lens that it cannot store is refused.
        overwrite: replace files there that muybridge did not write; other programs' formats do not say who did.
    """
    refuse_root(out)
    read = read_calibration(calibration)
    for note in read.notes:
        print(f"note: {note}")
    check_replaceable(export_texts(read.cameras, out, to), overwrite)
    files = export_calibration(read.cameras, out, to)
    print(f"{read.format}, {len(read.cameras)} cameras: written as {to} to {', '.join(map(str, files))}")
    return 0
