"""What the readers of point files (TRC, C3D, tables) share: units, axes, text, and which row is which frame."""

import math
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import FormatError, MuybridgeError

METRES_OF_UNIT = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
UNIT_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches"}
# Every spelling that files have of them, in small letters.
UNIT_WORDS = {word: unit for unit, words in {
    "m": ("m", "meter", "metre", "meters", "metres"),
    "cm": ("cm", "centimeter", "centimetre", "centimeters", "centimetres"),
    "mm": ("mm", "millimeter", "millimetre", "millimeters", "millimetres"),
    "in": ("in", "inch", "inches"),
}.items() for word in words}  # fmt: skip
# Systems of the eighties keep four letters of a unit.
_FEWEST_LETTERS = 4
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
# Rows may be missing between the first frame and the last, but not nearly all.
_SPREAD, _FEW = 100, 1000
# Of rows that come evenly the step is never so many times the usual one.
_GAP = 1.75
# Which coordinates of a file are x, y, z of the world: where y is up, the file's z is our x.
UP_PERMUTATION = {"z": (0, 1, 2), "y": (2, 0, 1)}


def check_unit(path: Path, unit: str, where: str) -> str:
    """The unit, if it is one that we know in some spelling; FormatError with what was found if not."""
    word = unit.strip(" \t\0.[]()").lower()
    if word in UNIT_WORDS:
        return UNIT_WORDS[word]
    cut_off = {u for full, u in UNIT_WORDS.items() if len(word) >= _FEWEST_LETTERS and full.startswith(word)}
    if len(cut_off) != 1:
        raise FormatError(f"{path}: {where} is {unit!r}; valid are {', '.join(METRES_OF_UNIT)}")
    return cut_off.pop()


def check_fps(fps: float | None) -> None:
    """MuybridgeError unless frames per second are finite and above zero."""
    if fps is not None and not 0 < fps < math.inf:
        raise MuybridgeError(f"frames per second must be above zero, not {fps:g}", remedy="fps_range", fps=f"{fps:g}")


def read_text(path: Path, kind: str) -> str:
    """A file of text, whatever ends its lines; `kind` is what it should be.

    Raises:
        FormatError: it cannot be read, or is neither UTF-8 nor UTF-16 that says so.
    """
    try:
        data = path.read_bytes()
        text = data.decode("utf-16" if data[:2] in _UTF16 else "utf-8-sig")
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
