"""`muybridge calibrate points`: cameras from points of known position and their pixels."""

from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.board.intrinsics import Lens
from muybridge.geometry.calibration.bundle_adjustment.result import table
from muybridge.geometry.calibration.formats.common import far_apart_note
from muybridge.infer.pipelines.calibration.known_points import calibrate_points_file
from muybridge.infer.report.calibration_page import write_solved_page
from muybridge.infer.results.ownership import check_replaceable


def points(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POINTS.csv")],
    /,
    out: Path = Path("calibration.toml"),
    overwrite: bool = False,
    size: Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="WIDTH HEIGHT")] = None,
    videos: Path | None = None,
    lenses: Path | None = None,
    lens: Lens = "pinhole",
    sigma_px: float = 1.0,
) -> int:
    """Calibrate cameras from points of known position and their pixels.

    Example:
        muybridge calibrate points markers.csv --videos recordings/walk/videos --out calibration.toml

    Args:
        path: CSV file with the columns camera, x, y, z (metres), u, v (px; 0, 0 is the centre of the top-left pixel),
            one row per point and camera. Its coordinate system becomes the world.
        out: calibration file to write (TOML); a page with the same name shows how good it is.
        overwrite: replace files there that muybridge did not write.
        size: width and height of all images, px.
        videos: folder with a video per camera, to take the sizes from.
        lenses: calibration file whose lenses are kept; 4 points are enough then, otherwise 6.
        lens: lens model, without --lenses.
        sigma_px: standard deviation of the pixels.
    """
    check_replaceable([out, out.with_suffix(".html")], overwrite)
    result = calibrate_points_file(path, size, videos, lenses, lens, sigma_px)
    solved = result.solved
    save_calibration(solved.cameras, out)
    page = write_solved_page(out, out.stem, solved, f"{len(np.unique(solved.point))} known points", solved.cameras)
    notes = [*result.notes, *far_apart_note(solved.cameras, "the points' coordinates")]
    print("\n".join([*table(solved), *notes, f"written: {out}", page]))
    return 0
