"""`muybridge calibrate board`: lenses and poses of cameras from a board that is moved before them."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.board.board import Board, fitting_descriptions
from muybridge.geometry.calibration.board.extrinsics import (
    BoardOptions,
    RigCalibration,
    calibrate_lenses,
    calibrate_rig,
)
from muybridge.geometry.calibration.board.intrinsics import FEWEST_CORNERS, FEWEST_VIEWS, View, usable
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult, misfits, table
from muybridge.geometry.calibration.gravity import level
from muybridge.geometry.calibration.world import moved, on_board
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.commands.calibrate.board_images import (
    Pictures,
    at_moment,
    find_pictures,
    look_for_board,
    some_pictures,
)
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.report.calibration_page import write_solved_page
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {
    "board": (
        "out", "overwrite", "board", "columns", "rows", "square", "dictionary", "board_file", "lenses", "lenses_only",
        "floor",
    )
}  # fmt: skip
_LOOKED_FOR_OTHERS = 12
_OUT_OF_STEP = 0.05
# Metres; larger ones are millimetres or, where few, centimetres.
_LARGEST_SQUARE, _SURELY_MM = 1.0, 10.0


@dataclass(frozen=True)
class BoardChoice:
    """The board.

    Attributes:
        board: its kind.
        columns: squares across (ChArUco), inner corners across (checkerboard).
        rows: the same downwards.
        square: side of a square as printed, metres; measure it.
        marker_share: side of a marker over that of a square (ChArUco).
        dictionary: the markers' dictionary, by OpenCV's name (ChArUco).
        inverted: printed white on black.
        legacy: ChArUco pattern as OpenCV made it before version 4.6.
        board_file: TOML that describes the board in place of the above (columns, rows, square_size_override_cm,
            dictionary, aruco_scale, inverted: Caliscope's).
    """

    board: Literal["charuco", "checkerboard"] = "charuco"
    columns: int = 7
    rows: int = 5
    square: float = 0.035
    marker_share: float = 0.75
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False
    legacy: bool = False
    board_file: Path | None = None


def chosen_board(choice: BoardChoice) -> Board:
    """The board that the options describe.

    Raises:
        CalibrationError: a description that is none.
    """
    try:
        if choice.board_file is not None:
            found = _board_of(choice.board_file)
        else:
            found = Board(
                choice.board, choice.columns, choice.rows, choice.square, choice.marker_share, choice.dictionary,
                choice.inverted, choice.legacy,
            )  # fmt: skip
    except ValueError as error:
        raise CalibrationError(f"the board's description: {error}") from None
    if found.square > _LARGEST_SQUARE:
        meant = found.square / (100 if found.square < _SURELY_MM else 1000)
        raise CalibrationError(
            f"the board's description: squares of {found.square:g} m; their side is given in metres: did you mean "
            f"{meant:g}?"
        )
    return found


def _board_of(path: Path) -> Board:
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        square = data["square_size_override_cm"] / 100 if "square_size_override_cm" in data else float(data["square"])
        return Board(
            "charuco", int(data["columns"]), int(data["rows"]), square, float(data.get("aruco_scale", 0.75)),
            str(data.get("dictionary", "DICT_4X4_50")), bool(data.get("inverted", False)),
            bool(data.get("legacy_pattern", False)),
        )  # fmt: skip
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise CalibrationError(
            f"{path}: no description of a board ({error}); it needs columns, rows, dictionary and "
            "square_size_override_cm"
        ) from None


def board(
    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER")],
    /,
    out: Path = Path("calibration.toml"),
    pattern: BoardChoice = BoardChoice(),  # noqa: B008 - frozen
    options: BoardOptions = BoardOptions(),  # noqa: B008
    lenses: Path | None = None,
    lenses_only: bool = False,
    floor: int | None = None,
    timestamps: Path | None = None,
    every: int | None = None,
    overwrite: bool = False,
) -> int:
    """Lenses and poses of cameras from a board that is moved before them, seen in films or images.

    Args:
        folder: a film or a folder of images for each camera, named as the camera.
        out: calibration file to write (TOML).
        pattern: what board it is.
        options: how.
        lenses: calibration file whose lenses are kept; only the poses are found.
        lenses_only: find only the lenses: every camera from its own views, with no pose.
        floor: moment (number of the frame, image or sync_index) at which the board lay on the floor: it becomes
            the world's floor. Without, up is guessed from how the cameras are held; see `muybridge calibrate world`.
        timestamps: CSV that says which frames belong together (default: `timestamps.csv` in the folder).
        every: look at every so many-th frame of films (default: six a second).
        overwrite: replace files there that muybridge did not write.
    """
    wanted = chosen_board(pattern)
    if every is not None and every < 1:
        raise CalibrationError(f"--every must be at least 1, not {every}")
    check_replaceable([out] if lenses_only else [out, out.with_suffix(".html")], overwrite)
    with Progress() as progress:
        pictures = find_pictures(folder, timestamps, every, floor)
        if floor is not None:
            _check_floor(wanted, pictures, floor, progress)
        views, sizes = look_for_board(pictures, wanted, progress)
        check_seen(wanted, pictures, views)
        known = _known(lenses, [p.name for p in pictures], sizes) if lenses is not None else None
        with progress.task("adjusting", 1):
            try:
                if lenses_only or len(pictures) == 1:
                    result = calibrate_lenses(wanted, views, sizes, options)
                    save_calibration(result.cameras, out)
                    _say_lenses(result)
                    return 0
                rig = calibrate_rig(wanted, views, sizes, options, known, floor)
            except CalibrationError as error:
                raise CalibrationError(f"{error}{_others(wanted, pictures, views)}") from None
    cameras, said = _world(rig, floor)
    save_calibration(cameras, out)
    shown = write_solved_page(out, folder.resolve().name, rig.solved, f"a board at {len(rig.times)} moments", cameras)
    for line in [*table(rig.solved), *told(rig), said, f"written: {out}", shown]:
        print(line)
    return 0


def _check_floor(wanted: Board, pictures: Sequence[Pictures], floor: int, progress: Progress) -> None:
    """Raise where nobody sees the board at the moment at which it should lie on the floor: before the long work."""
    views, _ = look_for_board(at_moment(pictures, floor, "--floor"), wanted, progress)
    if not any(usable(wanted, list(mine.values())) for mine in views.values()):
        raise CalibrationError(
            f"--floor {floor}: the board ({wanted.describe()}) was not seen at that moment, or too little of it; name "
            "one at which it lay on the floor in full view"
        )


def check_seen(wanted: Board, pictures: Sequence[Pictures], views: Mapping[str, Mapping[int, View]]) -> None:
    """Raise where the board was never found, or too rarely by one camera, with what would fit."""
    looked = sum(len(p.looked_at) for p in pictures)
    if not any(len(v[0]) >= FEWEST_CORNERS for mine in views.values() for v in mine.values()):
        others = _others(wanted, pictures, views) or (
            "; show it whole, flat and sharp, with a white margin, or check its description"
        )
        raise CalibrationError(f"the board ({wanted.describe()}) is in none of the {looked} pictures{others}")
    for p in pictures:
        count = sum(len(v[0]) >= FEWEST_CORNERS for v in views[p.name].values())
        if count < FEWEST_VIEWS:
            raise CalibrationError(
                f"camera {p.name}: the board ({wanted.describe()}) is seen in {count} of {len(p.looked_at)} pictures, "
                f"at least {FEWEST_VIEWS} are needed{_others(wanted, [p], views) or '; show it to this camera too'}"
            )


def _others(wanted: Board, pictures: Sequence[Pictures], views: Mapping[str, Mapping[int, View]]) -> str:
    """Descriptions under which more would be found, as the end of a sentence."""
    images = [image for p in pictures for image in some_pictures(p, max(1, _LOOKED_FOR_OTHERS // len(pictures)))]
    found = fitting_descriptions(wanted, images)
    return f"; it would be found as: {' | '.join(found)}" if found else ""


def _known(path: Path, names: Sequence[str], sizes: Mapping[str, tuple[int, int]]) -> CameraGroup:
    known = load_calibration(path)
    missing = [n for n in names if n not in known]
    if missing:
        raise CalibrationError(f"{path}: no lens for {', '.join(missing)}; it has {', '.join(known.names)}")
    for n in names:
        if (known[n].width, known[n].height) != sizes[n]:
            raise CalibrationError(
                f"{path}: camera {n} is {known[n].width} x {known[n].height} px there and {sizes[n][0]} x "
                f"{sizes[n][1]} here; calibrate its lens at this size"
            )
    return known


def _world(rig: RigCalibration, floor: int | None) -> tuple[CameraGroup, str]:
    """The cameras in a world with Z up, and how it was chosen."""
    if floor is None:
        change = level(rig.cameras, rig.world_from_boards[:, :, 3])
        return moved(rig.cameras, change), (
            "world: up is guessed from how the cameras are held, the origin is amid the board's places; "
            "set it with --floor or `muybridge calibrate world`"
        )
    change = on_board(rig.cameras, rig.world_from_boards[int(np.searchsorted(rig.times, floor))])
    return moved(rig.cameras, change), f"world: the board's place at moment {floor} is the floor and the origin"


def told(rig: RigCalibration) -> list[str]:
    """What else is worth knowing of a rig."""
    names = rig.cameras.names
    median = float(np.nanmedian(rig.solved.errors_px))
    lines = [f"median reprojection error {median:.2f} px over {len(rig.times)} moments"]
    late = np.array([np.nanmean(d) if np.isfinite(d).any() else np.nan for d in rig.delays])
    late -= late[np.isfinite(late)][0] if np.isfinite(late).any() else 0.0
    if rig.delay_spread > _OUT_OF_STEP or np.nanmax(np.abs(late)) > _OUT_OF_STEP:
        means = ", ".join(f"{n} {d:+.2f}" for n, d in zip(names[1:], late[1:], strict=True) if np.isfinite(d))
        lines.append(
            f"the cameras do not expose together; against {names[0]}, in frames of the table of moments: {means}, each "
            f"view +- {rig.delay_spread:.2f}; the errors above are those left once this is taken into account"
        )
    lines += [m.sentence for m in misfits(rig.solved) if not m.grave]  # the grave ones are said with the page
    weak = [n for n, count in ((b, c) for _, b, c in rig.joined) if count < 5]
    if weak:
        lines.append(f"few shared views for {', '.join(weak)}: show the board longer where several cameras see it")
    return lines


def _say_lenses(result: CalibrationResult) -> None:
    for line in table(result):
        print(re.sub(r"\(reference\)", "no pose    ", line))
    print("lenses only: no camera has a place yet; give this file to `muybridge calibrate board|points` with --lenses")
