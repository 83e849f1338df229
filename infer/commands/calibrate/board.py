"""`muybridge calibrate board`: lenses and poses of cameras from images of a calibration board."""

import re
from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.board.extrinsics import BoardOptions
from muybridge.geometry.calibration.bundle_adjustment.result import table
from muybridge.infer.pipelines.calibration.board import (
    BoardChoice,
    BoardInput,
    calibrate_board,
    format_summary,
)
from muybridge.infer.report.calibration_page import write_solved_page
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {
    "board": (
        "out", "overwrite", "board", "columns", "rows", "square", "dictionary", "board_file", "lenses", "lenses_only",
        "floor",
    )
}  # fmt: skip


def board(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")],
    /,
    out: Path = Path("calibration.toml"),
    overwrite: bool = False,
    pattern: BoardChoice = BoardChoice(),  # noqa: B008 - frozen
    options: BoardOptions = BoardOptions(),  # noqa: B008
    lenses: Path | None = None,
    lenses_only: bool = False,
    floor: int | None = None,
    timestamps: Path | None = None,
    every: int | None = None,
) -> int:
    """Calibrate lenses and poses of cameras from videos or images of a moving calibration board.

    Example:
        muybridge calibrate board boards/ --columns 7 --rows 5 --square 0.035 --out calibration.toml

    Args:
        folder: a video, or a folder of images, per camera, named as the camera.
        out: calibration file to write (TOML); a page with the same name shows how good it is.
        overwrite: replace files there that muybridge did not write.
        pattern: the calibration board.
        options: options of the calibration.
        lenses: calibration file whose lenses are kept; only the poses are calibrated.
        lenses_only: calibrate only the lenses, each camera from its own images, without poses.
        floor: moment (frame number, image number or sync_index) at which the board lies on the floor, which becomes
            the floor of the world. Without it, up is estimated from the cameras' poses; see `muybridge calibrate
            world`.
        timestamps: CSV file of the frames that belong together (default: `timestamps.csv` in the folder).
        every: search every n-th frame of videos (default: six frames per second).
    """
    described = pattern.board_described()
    source = BoardInput(folder, timestamps, every, floor)
    check_replaceable([out] if lenses_only else [out, out.with_suffix(".html")], overwrite)
    with Progress() as progress:
        found = calibrate_board(described, source, options, lenses, lenses_only, progress)
    save_calibration(found.cameras, out)
    if found.rig is None:
        lines = [re.sub(r"\(reference\)", "no pose    ", line) for line in table(found.result)]
        lines.append("lenses only, no camera has a pose yet: give this file to `muybridge calibrate board|points` with "
                     "--lenses")  # fmt: skip
    else:
        world = f"world: the board at moment {floor} is the floor and the origin"
        if floor is None:
            world = ("world: up is estimated from the cameras' poses, the origin is the middle of the board's "
                     "positions; set it with --floor or `muybridge calibrate world`")  # fmt: skip
        moments = f"a board at {len(found.rig.times)} moments"
        page = write_solved_page(out, folder.resolve().name, found.result, moments, found.cameras)
        lines = [*table(found.result), *format_summary(found.rig), world, f"written: {out}", page]
    print("\n".join(lines))
    return 0
