"""Cameras from a calibration board that is moved in front of them, or from one on the floor."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from muybridge.errors import CalibrationError, parsing
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.board.board import Board, fitting_descriptions, seen_markers
from muybridge.geometry.calibration.board.extrinsics import (
    BoardOptions,
    RigCalibration,
    calibrate_lenses,
    calibrate_rig,
)
from muybridge.geometry.calibration.board.intrinsics import FEWEST_CORNERS, FEWEST_VIEWS, View, usable
from muybridge.geometry.calibration.bundle_adjustment.result import CalibrationResult, misfits
from muybridge.geometry.calibration.gravity import level_transform
from muybridge.geometry.calibration.world import on_board, transform_cameras
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.pipelines.calibration.board_images import (
    BoardImages,
    at_moment,
    clocks_of,
    find_board,
    find_images,
    sample_images,
)
from muybridge.infer.runtime.progress import Progress

# Images in which other descriptions of the board are tried.
_TRIED_IMAGES = 12
# Frames; cameras whose exposures differ by more are reported.
_LATE = 0.05
# Metres; larger squares are meant in millimetres or, the smaller ones, in centimetres.
_LARGEST_SQUARE, _SURELY_MM = 1.0, 10.0


@dataclass(frozen=True)
class BoardChoice:
    """The calibration board.

    Attributes:
        board: its kind.
        columns: squares across (ChArUco), or inner corners across (checkerboard).
        rows: squares down (ChArUco), or inner corners down (checkerboard).
        square: side of a square as printed, metres; measure it.
        marker_share: side of a marker divided by that of a square (ChArUco).
        dictionary: marker dictionary, by its name in OpenCV (ChArUco).
        inverted: the board is printed white on black.
        legacy: ChArUco pattern of OpenCV before version 4.6.
        first_marker: number of the first marker, of a board whose markers are not numbered from 0 (ChArUco).
        board_file: TOML file that describes the board in place of the above, as Caliscope writes it (columns, rows,
            square_size_override_cm, dictionary, aruco_scale, inverted).
    """

    board: Literal["charuco", "checkerboard"] = "charuco"
    columns: int = 7
    rows: int = 5
    square: float = 0.035
    marker_share: float = 0.75
    dictionary: str = "DICT_4X4_50"
    inverted: bool = False
    legacy: bool = False
    first_marker: int = 0
    board_file: Path | None = None

    def board_described(self) -> Board:
        """The board.

        Raises:
            CalibrationError: the description makes no sense.
        """
        try:
            if self.board_file is not None:
                found = read_board(self.board_file)
            else:
                found = Board(
                    self.board, self.columns, self.rows, self.square, self.marker_share, self.dictionary,
                    self.inverted, self.legacy, self.first_marker,
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


def read_board(path: Path) -> Board:
    """The board that a TOML file describes.

    Raises:
        CalibrationError: the file cannot be read, or describes no board that there is.
    """
    with parsing(path, CalibrationError, "the description of a board"):
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        lacking = [key for key in ("columns", "rows") if key not in data]
        if lacking or not {"square_size_override_cm", "square"} & data.keys():
            raise CalibrationError(
                f"{path}: no description of a board (it has no {(lacking or ['square_size_override_cm'])[0]}); it "
                "needs columns, rows, dictionary and square_size_override_cm"
            )
        square = data["square_size_override_cm"] / 100 if "square_size_override_cm" in data else float(data["square"])
        described = (
            int(data["columns"]), int(data["rows"]), square, float(data.get("aruco_scale", 0.75)),
            str(data.get("dictionary", "DICT_4X4_50")), bool(data.get("inverted", False)),
            bool(data.get("legacy_pattern", False)), int(data.get("first_marker", 0)), _thickness(data),
        )  # fmt: skip
        try:
            return Board("charuco", *described)
        except ValueError as error:
            raise CalibrationError(f"{path}: the board's description: {error}") from None


def _thickness(data: Mapping[str, object]) -> float | None:
    """Metres between a board's faces; None where the file, as Caliscope writes it, says that it has one face."""
    thickness = data.get("thickness_cm", 0.0)
    if isinstance(thickness, bool) or not isinstance(thickness, int | float):
        raise TypeError(f"thickness_cm is {thickness!r}, not a number")
    return thickness / 100 if thickness else None


@dataclass(frozen=True)
class BoardInput:
    """Images of a board, and how to read them.

    Attributes:
        folder: videos, or folders of images, one per camera and named as the camera.
        timestamps: CSV file of the frames that belong together; None for `timestamps.csv` in the folder, if any.
        every: search every n-th frame of videos; None for about six per second.
        floor: moment at which the board lies on the floor; None where it never does.
    """

    folder: Path
    timestamps: Path | None = None
    every: int | None = None
    floor: int | None = None

    def __post_init__(self) -> None:
        if self.every is not None and self.every < 1:
            raise CalibrationError(f"every must be at least 1, not {self.every}")


@dataclass(frozen=True)
class BoardCalibration:
    """Cameras calibrated with a board.

    Attributes:
        result: the calibration as it was solved.
        cameras: the calibrated cameras; with poses, in a world whose floor is the board at the given moment, or else
            whose up is estimated from the cameras' poses.
        rig: poses and delays of the cameras; None where only lenses were calibrated.
    """

    result: CalibrationResult
    cameras: CameraGroup
    rig: RigCalibration | None


def calibrate_board(
    board: Board,
    source: BoardInput,
    options: BoardOptions,
    lenses: Path | None,
    lenses_only: bool,
    progress: Progress,
) -> BoardCalibration:
    """Calibrate lenses and poses of all cameras; of a single camera, the lens.

    Args:
        board: which board the images show.
        source: the images.
        options: of the calibration.
        lenses: calibration file whose lenses are kept.
        lenses_only: calibrate only the lenses, each camera from its own views.
        progress: receives progress messages.

    Raises:
        CalibrationError: the images do not suffice.
    """
    images = find_images(source.folder, source.timestamps, source.every, source.floor)
    if clocks := clocks_of(source.folder, source.timestamps, images):
        progress.notice(f"frames are paired by the clocks in {clocks}")
    if source.floor is not None:
        _check_floor(board, images, source.floor, progress)
    views, sizes = find_board(images, board, progress)
    check_seen(board, images, views)
    known = _known_lenses(lenses, sizes) if lenses is not None else None
    with progress.task("calibrating", 1):
        try:
            if lenses_only or len(images) == 1:
                result = calibrate_lenses(board, views, sizes, options)
                return BoardCalibration(result, result.cameras, None)
            rig = calibrate_rig(board, views, sizes, options, known, source.floor)
        except CalibrationError as error:
            raise error.reworded(f"{error.message}{_others(board, images, views)}") from None
    if source.floor is None:
        change = level_transform(rig.cameras, rig.world_from_boards[:, :, 3])
    else:
        change = on_board(rig.cameras, rig.world_from_boards[int(np.searchsorted(rig.times, source.floor))])
    return BoardCalibration(rig.solved, transform_cameras(rig.cameras, change), rig)


def _check_floor(board: Board, images: Sequence[BoardImages], floor: int, progress: Progress) -> None:
    """Raise where no camera sees the board at the moment at which it should lie on the floor: before the long work."""
    views, _ = find_board(at_moment(images, floor, "floor"), board, progress)
    if not any(usable(board, list(mine.values())) for mine in views.values()):
        raise CalibrationError(
            f"floor {floor}: the board ({board.describe()}) was not seen at that moment, or too little of it; name "
            "one at which it lay on the floor in full view"
        )


def check_seen(board: Board, images: Sequence[BoardImages], views: Mapping[str, Mapping[int, View]]) -> None:
    """Raise where the board was never found, or too rarely by one camera, with the descriptions that would fit."""
    searched = sum(len(p.searched) for p in images)
    if not any(len(v[0]) >= FEWEST_CORNERS for mine in views.values() for v in mine.values()):
        others = _others(board, images, views) or (
            "; show it whole, flat and sharp, with a white margin, or check its description"
        )
        raise CalibrationError(f"the board ({board.describe()}) is in none of the {searched} images{others}")
    for p in images:
        count = sum(len(v[0]) >= FEWEST_CORNERS for v in views[p.name].values())
        if count < FEWEST_VIEWS:
            raise CalibrationError(
                f"camera {p.name}: the board ({board.describe()}) is seen in {count} of {len(p.searched)} images, "
                f"at least {FEWEST_VIEWS} are needed{_others(board, [p], views) or '; show it to this camera too'}"
            )


def _others(board: Board, images: Sequence[BoardImages], views: Mapping[str, Mapping[int, View]]) -> str:
    """Descriptions under which more of the board would be found, as the end of a sentence."""
    tried = [image for p in images for image in sample_images(p, max(1, _TRIED_IMAGES // len(images)))]
    found = fitting_descriptions(board, tried)
    markers = seen_markers(board, tried) if board.kind == "charuco" else None
    numbers = ""
    if markers is not None and (markers[0] < board.markers[0] or markers[-1] > board.markers[-1]):
        numbers = (
            f"; markers {markers[0]} to {markers[-1]} are seen, {board.markers[0]} to {board.markers[-1]} expected"
        )
    return numbers + (f"; it would be found as: {' | '.join(found)}" if found else "")


def _known_lenses(path: Path, sizes: Mapping[str, tuple[int, int]]) -> CameraGroup:
    known = load_calibration(path)
    missing = [n for n in sizes if n not in known]
    if missing:
        raise CalibrationError(f"{path}: no lens for {', '.join(missing)}; it has {', '.join(known.names)}")
    for n, (width, height) in sizes.items():
        if (known[n].width, known[n].height) != (width, height):
            raise CalibrationError(
                f"{path}: camera {n} is {known[n].width} x {known[n].height} px there and {width} x {height} here; "
                "calibrate its lens at this size"
            )
    return known


def format_summary(rig: RigCalibration) -> list[str]:
    """What a user should know of a calibration besides its table, a sentence each."""
    names = rig.cameras.names
    median = float(np.nanmedian(rig.solved.errors_px))
    lines = [f"median reprojection error {median:.2f} px over {len(rig.times)} moments"]
    late = np.array([np.nanmean(d) if np.isfinite(d).any() else np.nan for d in rig.delays])
    late -= late[np.isfinite(late)][0] if np.isfinite(late).any() else 0.0
    if rig.delay_spread > _LATE or np.nanmax(np.abs(late)) > _LATE:
        means = ", ".join(f"{n} {d:+.2f}" for n, d in zip(names[1:], late[1:], strict=True) if np.isfinite(d))
        lines.append(
            f"the cameras do not expose at the same time; delays against {names[0]}, in frames of the table of "
            f"moments: {means}, each view +- {rig.delay_spread:.2f}; the errors above are those that remain once the "
            "delays are taken into account"
        )
    lines += [m.sentence for m in misfits(rig.solved) if not m.grave]  # the grave ones are said with the page
    weak = [n for n, count in ((b, c) for _, b, c in rig.joined) if count < 5]
    if weak:
        lines.append(f"few shared views for {', '.join(weak)}: show the board longer where several cameras see it")
    return lines
