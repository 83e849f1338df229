"""What the readers of point files (TRC, C3D) share: labelled points that come without any uncertainty."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23, LandmarkSet

METRES_OF_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
# Every spelling that files have of them, in small letters.
UNIT_WORDS = {word: unit for unit, words in {
    "m": ("m", "meter", "metre", "meters", "metres"),
    "cm": ("cm", "centimeter", "centimetre", "centimeters", "centimetres"),
    "mm": ("mm", "millimeter", "millimetre", "millimeters", "millimetres"),
    "in": ("in", "inch", "inches"),
}.items() for word in words}  # fmt: skip
# Rows may be missing between the first frame and the last, but not nearly all.
_SPREAD, _FEW = 100, 1000
# Of rows that come evenly the step is never so many times the usual one.
_GAP = 1.75
# Frames that are converted at once, so that a long file needs no second copy.
CHUNK = 4096
# Which coordinates of a file are x, y, z of the world: where y is up, the file's z is our x.
UP_PERMUTATION = {"z": (0, 1, 2), "y": (2, 0, 1)}


def check_unit(path: Path, unit: str, where: str) -> str:
    """The unit, if it is one that we know in some spelling; FormatError with what was found if not."""
    word = unit.strip().lower()
    if word not in UNIT_WORDS:
        raise FormatError(f"{path}: {where} is {unit!r}; valid are {', '.join(METRES_OF_UNIT)}")
    return UNIT_WORDS[word]


def check_fps(fps: float | None) -> None:
    """MuybridgeError unless frames per second are finite and above zero."""
    if fps is not None and not 0 < fps < math.inf:
        raise MuybridgeError(f"frames per second must be above zero, not {fps:g}", remedy="fps_range", fps=f"{fps:g}")


def read_text(path: Path, kind: str) -> str:
    """A file of text, whatever ends its lines; `kind` is what it should be.

    Raises:
        FormatError: it cannot be read, or is not UTF-8.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror}); give an existing {kind} file") from error
    except UnicodeDecodeError as error:
        raise FormatError(
            f"{path}: is not text in UTF-8 (byte {error.start + 1}); save it as UTF-8, if it is a {kind} file"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def frames_of_rows(path: Path, numbers: FloatArray | None, times: FloatArray | None, fps: float | None) -> IndexArray:
    """The frame, from 0, of each of N rows, so that rows that are missing are gaps.

    Args:
        path: for the message.
        numbers: (N,) frames' numbers as the file has them. Where they are whole and differ, rows are placed by them.
        times: (N,) the file's times; else these have to rise evenly.
        fps: frames per second that the user stated: rows are then consecutive whatever the times' steps are.

    Raises:
        FormatError: two rows are of one frame, or times fall or have a gap.
    """
    if numbers is not None and np.isfinite(numbers).all() and (numbers == np.round(numbers)).all():
        frames, count = np.unique(numbers, return_counts=True)
        if len(frames) > 1 and np.ptp(frames) < _SPREAD * len(numbers) + _FEW:
            if count.max() > 1:
                raise FormatError(f"{path}: {count.max()} rows are of frame {frames[count.argmax()]:.0f}; keep one")
            # Frames may be numbered in steps of two, for example; a few frames do not show the step.
            step = np.gcd.reduce(np.diff(frames).astype(np.int64)) if len(frames) > 3 else 1
            return np.asarray((numbers - frames[0]) // step, dtype=np.intp)
    if times is not None and len(times) > 1 and np.isfinite(times).all():
        steps = np.diff(times)
        usual = float(np.median(steps))
        if steps.min() < 0:
            raise FormatError(f"{path}: time falls after {times[steps.argmin()]:g}; sort the rows")
        if fps is None and 0 < usual * _GAP < steps.max():
            at = int(steps.argmax())
            raise FormatError(
                f"{path}: there is no row between the times {times[at]:g} and {times[at + 1]:g}, and frames have no "
                "numbers", remedy="frames_unnumbered"
            )  # fmt: skip
    length = len(numbers) if numbers is not None else len(times) if times is not None else 0
    return np.arange(length, dtype=np.intp)


def in_frames(values: FloatArray, row: IndexArray) -> FloatArray:
    """`values` (N, ...) at the frames (N,) that `frames_of_rows` gave, NaN in those without a row."""
    out = np.full((int(row.max(initial=-1)) + 1, *values.shape[1:]), np.nan)
    out[row] = values
    return out


def check_up(up: str) -> str:
    """The axis, if it is y or z; ValueError if not."""
    if up not in UP_PERMUTATION:
        raise ValueError(f"up must be one of {', '.join(UP_PERMUTATION)}, not {up!r}")
    return up


def in_world(xyz: FloatArray, metres: float, turn: Sequence[int]) -> FloatArray:
    """Coordinates (T, J, 3) of a file in metres, Z up, NaN where one is none; `xyz` is overwritten."""
    for at in range(0, len(xyz), CHUNK):
        part = xyz[at : at + CHUNK]
        part[~np.all(np.abs(part) < 1e12, axis=-1)] = np.nan
        part[:] = part[..., list(turn)] * metres
    return xyz


def points_of_file(path: Path, names: Sequence[str], points_world: FloatArray, fps: float, name: str) -> Points3D:
    """Points3D of what a file holds: positions only, so covariance is NaN and there are no cameras.

    Args:
        path: for the message.
        names: (J,) labels; those of BODY23 in its order give that very set, others one called `name` without
            edges.
        points_world: (T, J, 3) metres, Z up, NaN where missing.
        fps: frames per second.
        name: the landmark set's name where it is not one of ours.

    Raises:
        FormatError: a label appears twice.
    """
    twice = sorted({n for n in names if list(names).count(n) > 1})
    if twice:
        raise FormatError(f"{path}: the label {twice[0]!r} appears more than once; rename one of them")
    landmarks = BODY23 if tuple(names) == BODY23.names else LandmarkSet(name, tuple(names), ())
    t, j = points_world.shape[:2]
    return Points3D(
        landmarks=landmarks,
        points_world=points_world,
        covariance_world=np.broadcast_to(np.float64(np.nan), (t, j, 3, 3)),
        residual_px=np.empty((0, t, j)),
        inlier=np.empty((0, t, j), dtype=np.bool_),
        fps=fps,
    )
