"""`muybridge calibrate points`: cameras from known points and their pixels."""

import csv
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.board.intrinsics import Lens
from muybridge.geometry.calibration.bundle_adjustment.result import table
from muybridge.geometry.calibration.formats.common import far_apart_note
from muybridge.geometry.calibration.resection import KnownPoints, calibrate_points
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.report.calibration_page import write_solved_page
from muybridge.infer.session.probe import probe_video

COLUMNS = ("camera", "x", "y", "z", "u", "v")


def read_points(path: Path) -> dict[str, KnownPoints]:
    """Known points of each camera from a CSV with the columns camera, x, y, z (metres), u, v (px).

    Separated by commas, tabs, or semicolons, with which numbers may have decimal commas.

    Rows whose pixels are empty (a point that the camera does not see) are left out.

    Raises:
        CalibrationError: no such file, a column that is missing, something that is no number (line and column).
    """
    rows: dict[str, list[list[float]]] = {}
    try:
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
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError(f"{path}: cannot be read ({error})") from None
    if not rows:
        raise CalibrationError(f"{path}: no rows; give one for each point and camera that sees it")
    arrays = {name: np.array(values) for name, values in rows.items()}
    return {name: KnownPoints(a[:, :3], a[:, 3:]) for name, a in arrays.items()}


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise CalibrationError(f"{path}: line {line}: {column} is {text!r}, not a number")
    return value


def points(
    table_of_points: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="POINTS.csv")],
    /,
    out: Path = Path("calibration.toml"),
    size: Annotated[tuple[int, int] | None, tyro.conf.arg(metavar="WIDTH HEIGHT")] = None,
    videos: Path | None = None,
    lenses: Path | None = None,
    lens: Lens = "pinhole",
    sigma_px: float = 1.0,
    overwrite: bool = False,
) -> int:
    """Cameras from points whose place is known and their pixels, with their lenses or with lenses given.

    Args:
        table_of_points: CSV with the columns camera, x, y, z (metres), u, v (px; 0, 0 is the middle of the top-left
            pixel): a row for each point and camera. Its world becomes the calibration's.
        out: calibration file to write (TOML).
        size: width and height of the images, px, where all have the same.
        videos: folder with a film for each camera, to take the sizes from.
        lenses: calibration file whose lenses are kept; 4 points are enough then, otherwise 6.
        lens: model, without --lenses.
        sigma_px: how well the pixels were measured.
        overwrite: replace files there that muybridge did not write.
    """
    check_replaceable([out, out.with_suffix(".html")], overwrite)
    known = read_points(table_of_points)
    if sigma_px <= 0:
        raise CalibrationError(f"--sigma-px must be positive, not {sigma_px:g}")
    given: CameraGroup | None = None
    if lenses is not None:
        given = load_calibration(lenses)
        missing = [n for n in known if n not in given]
        if missing:
            raise CalibrationError(f"{lenses}: no lens for {', '.join(missing)}; it has {', '.join(given.names)}")
    sizes = {n: _size(n, size, videos, given) for n in known}
    for name, mine in known.items():
        outside = ~((mine.pixels > -1) & (mine.pixels < sizes[name])).all(axis=1)
        if outside.any():
            u, v = mine.pixels[outside][0]
            raise CalibrationError(
                f"{table_of_points}: camera {name}: pixel ({u:g}, {v:g}) is outside its {sizes[name][0]} x "
                f"{sizes[name][1]} image"
            )
    result = calibrate_points(known, sizes, given, lens, sigma_px)
    save_calibration(result.solved.cameras, out)
    solved = result.solved
    shown = write_solved_page(out, out.stem, solved, f"{len(np.unique(solved.point))} known points", solved.cameras)
    notes = [*result.notes, *far_apart_note(solved.cameras, "the points' coordinates")]
    for line in [*table(result.solved), *notes, f"written: {out}", shown]:
        print(line)
    return 0


def _size(name: str, size: tuple[int, int] | None, videos: Path | None, given: CameraGroup | None) -> tuple[int, int]:
    if given is not None:
        return given[name].width, given[name].height
    if size is not None:
        if min(size) < 1:
            raise CalibrationError(f"--size must be two positive numbers, not {size[0]} {size[1]}")
        return size
    if videos is None:
        raise CalibrationError("the size of the images is not known; give --size WIDTH HEIGHT, --videos or --lenses")
    films = [p for p in videos.glob(f"{name}.*") if p.is_file()] if videos.is_dir() else []
    if len(films) != 1:
        raise CalibrationError(f"{videos}: {len(films)} films named {name}; there must be one")
    info = probe_video(films[0])
    return info.width, info.height
