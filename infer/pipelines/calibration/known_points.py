"""Points of known position and their pixels, as a CSV file, and cameras calibrated from them."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shorten

import numpy as np

from muybridge.errors import CalibrationError, parsing
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.board.intrinsics import Lens
from muybridge.geometry.calibration.resection import KnownPoints, PointsCalibration, calibrate_points
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.session.probe import probe_video

COLUMNS = ("camera", "x", "y", "z", "u", "v")
_LARGEST = 1e9  # metres or px; anything beyond is damage


@dataclass(frozen=True)
class ImageSizes:
    """Where the sizes of the cameras' images are known from; the first that is given counts.

    Attributes:
        lenses: calibration whose lenses are kept.
        size: width and height of all images, px.
        videos: folder with a video of each camera, named as the camera.
    """

    lenses: CameraGroup | None = None
    size: tuple[int, int] | None = None
    videos: Path | None = None

    def __post_init__(self) -> None:
        if self.size is not None and min(self.size) < 1:
            raise CalibrationError(f"an image size must be two positive numbers, not {self.size[0]} {self.size[1]}")

    def of(self, name: str) -> tuple[int, int]:
        """Width and height of a camera's images, px.

        Raises:
            CalibrationError: nothing is given, or not one video has the camera's name.
        """
        if self.lenses is not None:
            return self.lenses[name].width, self.lenses[name].height
        if self.size is not None:
            return self.size
        if self.videos is None:
            raise CalibrationError("the size of the images is not known", remedy="image_size")
        videos = [p for p in self.videos.glob(f"{name}.*") if p.is_file()] if self.videos.is_dir() else []
        if len(videos) != 1:
            raise CalibrationError(f"{self.videos}: {len(videos)} videos named {name}; there must be one")
        info = probe_video(videos[0])
        return info.width, info.height


def read_points(path: Path) -> dict[str, KnownPoints]:
    """Known points of each camera from a CSV file with the columns camera, x, y, z (metres), u, v (px).

    The separator is a comma, a tab or a semicolon; with semicolons, numbers may have decimal commas. Rows without
    pixels (a point that the camera does not see) are left out.

    Raises:
        CalibrationError: the file does not exist, a column is missing, or a value is no number (line and column).
    """
    rows: dict[str, list[list[float]]] = {}
    with parsing(path, CalibrationError, "a table of known points"):
        with path.open(newline="", encoding="utf-8-sig") as file:
            first = file.readline()
            file.seek(0)
            between = max(",;\t", key=first.count)
            reader = csv.DictReader(file, skipinitialspace=between != "\t", delimiter=between)
            names = [n.strip().lower() for n in reader.fieldnames or []]
            missing = [c for c in COLUMNS if c not in names]
            if missing:
                raise CalibrationError(
                    f"{path}: no column {', '.join(missing)}; its first line must name {', '.join(COLUMNS)}"
                )
            reader.fieldnames = names
            for line, row in enumerate(reader, start=2):
                values = {c: (row[c] or "").strip() for c in COLUMNS}
                if not values["u"] and not values["v"]:
                    continue
                if between == ";":
                    values |= {c: values[c].replace(",", ".") for c in COLUMNS[1:]}
                rows.setdefault(values["camera"], []).append([_number(path, line, c, values[c]) for c in COLUMNS[1:]])
    if not rows:
        raise CalibrationError(f"{path}: no rows; give one for each point and camera that sees it")
    arrays = {name: np.array(values) for name, values in rows.items()}
    return {name: KnownPoints(a[:, :3], a[:, 3:]) for name, a in arrays.items()}


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) < _LARGEST:
        raise CalibrationError(f"{path}: line {line}: {column} is {shorten(text)}, not a number")
    return value


def read_lenses(path: Path, names: Mapping[str, object]) -> CameraGroup:
    """A calibration whose lenses the cameras of these names have.

    Raises:
        CalibrationError: it cannot be read, or lacks a camera.
    """
    lenses = load_calibration(path)
    missing = [n for n in names if n not in lenses]
    if missing:
        raise CalibrationError(f"{path}: no lens for {', '.join(missing)}; it has {', '.join(lenses.names)}")
    return lenses


def calibrate_points_file(
    path: Path, size: tuple[int, int] | None, videos: Path | None, lenses: Path | None, lens: Lens, sigma_px: float
) -> PointsCalibration:
    """Calibrate cameras from a CSV file of known points.

    Args:
        path: see `read_points`.
        size: width and height of all images, px.
        videos: folder with a video of each camera, to take the sizes from.
        lenses: calibration file whose lenses are kept.
        lens: model of lenses that are not known.
        sigma_px: standard deviation of the pixels.

    Raises:
        CalibrationError: the file, or what it says, is not usable.
    """
    known = read_points(path)
    if sigma_px <= 0:
        raise CalibrationError(f"the standard deviation of the pixels must be positive, not {sigma_px:g}")
    given = None if lenses is None else read_lenses(lenses, known)
    source = ImageSizes(given, size, videos)
    sizes = {name: source.of(name) for name in known}
    for name, mine in known.items():
        outside = ~((mine.pixels > -1) & (mine.pixels < sizes[name])).all(axis=1)
        if outside.any():
            u, v = mine.pixels[outside][0]
            raise CalibrationError(
                f"{path}: camera {name}: pixel ({u:g}, {v:g}) is outside its {sizes[name][0]} x {sizes[name][1]} image"
            )
    return calibrate_points(known, sizes, given, lens, sigma_px)
