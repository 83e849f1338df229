"""`muybridge calibrate world`: origin, floor, axes and scale of a calibration."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.calibration.board import BoardChoice
from muybridge.infer.pipelines.calibration.world import (
    change_world,
    world_from_board,
    world_from_points,
    world_from_session,
)
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

COMMON_OPTIONS = {
    "world": (
        "out", "overwrite", "points", "floor_board", "people", "moment", "height", "keep_scale", "turn_deg", "origin",
    )
}  # fmt: skip


def world(
    calibration: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CALIBRATION")],
    /,
    out: Path,
    overwrite: bool = False,
    points: Path | None = None,
    floor_board: Path | None = None,
    people: Path | None = None,
    pattern: BoardChoice = BoardChoice(),  # noqa: B008 - frozen
    moment: int | None = None,
    height: float | None = None,
    keep_scale: bool = False,
    scale_by: float = 1.0,
    turn_deg: float = 0.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Set a calibration's origin, floor, axes and scale from known points, a board on the floor, or people.

    Example:
        muybridge calibrate world calibration.toml --floor-board boards/floor --out calibration.toml --overwrite

    Args:
        calibration: file of any known format.
        out: calibration file to write (TOML).
        overwrite: replace files there that muybridge did not write.
        points: CSV file with the columns camera, x, y, z (metres, in the wanted world), u, v (px): at least three
            points, each marked in two cameras or more.
        floor_board: folder with a video, or a folder of images, per camera, that shows a board on the floor: its first
            corner becomes the origin, its columns run along +X, Z is up.
        people: session folder in which people walk about: the floor is where their feet are.
        pattern: the calibration board.
        moment: number of the frame or image in which the board lies there, if it does not in all of them.
        height: of the (first) person, metres; without it the scale is kept.
        keep_scale: turn and move only, even where points or the board have another scale.
        scale_by: then multiply all lengths by this factor.
        turn_deg: then turn the world about Z, counterclockwise seen from above.
        origin: then move the origin to this place, metres, in the world so far.
        session: how the session folder is read.
        detect: 2D landmarks.
    """
    check_replaceable([out], overwrite)
    cameras = load_calibration(calibration)
    by_hand = scale_by != 1 or turn_deg != 0 or any(origin)
    _check_sources((("--points", points), ("--floor-board", floor_board), ("--people", people)), by_hand)
    if not (np.isfinite([scale_by, turn_deg, *origin]).all() and scale_by > 0):
        raise CalibrationError(f"--scale-by must be positive, not {scale_by:g}; all numbers finite")
    lines: list[str] = []
    with Progress() as progress:
        if points is not None:
            cameras, lines = world_from_points(cameras, points, keep_scale)
        elif floor_board is not None:
            board = pattern.board_described()
            cameras, lines = world_from_board(cameras, board, floor_board, moment, keep_scale, progress)
        elif people is not None:
            read = replace(session, calibration=calibration)
            cameras, lines = world_from_session(cameras, people, height, read, detect, progress)
    if by_hand:
        cameras = change_world(cameras, scale_by, turn_deg, origin)
    save_calibration(cameras, out)
    at = zip(cameras.names, cameras.centers_world, strict=True)
    places = [f"{name}: at ({x:.2f}, {y:.2f}, {z:.2f}) m" for name, (x, y, z) in at]
    print("\n".join([*lines, *places, f"written: {out}"]))
    return 0


def _check_sources(sources: Sequence[tuple[str, Path | None]], by_hand: bool) -> None:
    given = [name for name, value in sources if value]
    if len(given) > 1 or not (given or by_hand):
        raise CalibrationError(
            f"give one of --points, --floor-board, --people ({' and '.join(given) or 'none'} given), or change the "
            "world by hand with --scale-by, --turn-deg, --origin"
        )
