"""`muybridge calibrate convert`: a calibration in another program's format."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration import ExportFormat, export_calibration, read_calibration
from muybridge.geometry.calibration.formats.export import export_texts
from muybridge.infer.commands.calibrate.outputs import check_replaceable


def convert(
    calibration: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CALIBRATION")],
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT")],
    /,
    to: ExportFormat = "muybridge",
    overwrite: bool = False,
) -> int:
    """A calibration of any known format, written in another: Anipose, OpenCV, Vicon, COLMAP and so on.

    Args:
        calibration: the file (or a COLMAP model's folder); its format is recognised by its content.
        out: the file to write; a folder for easymocap and colmap.
        to: format to write. A lens that it cannot carry is refused.
        overwrite: replace files there that muybridge did not write; of other programs' formats that cannot be told.
    """
    read = read_calibration(calibration)
    for note in read.notes:
        print(f"note: {note}")
    check_replaceable(export_texts(read.cameras, out, to), overwrite)
    files = export_calibration(read.cameras, out, to)
    print(f"{read.format}, {len(read.cameras)} cameras: written as {to} to {', '.join(map(str, files))}")
    return 0
