"""Corrections of labels by a person: a small text file that every later run applies again.

A line gives frames (from 0, both ends included) and which point gets which name::

    # frames   from   to
    100-250    LWRA   LWRB
    100-250    LWRB   LWRA
    300-320    LTOE   delete
    410        *12    RTOE
    all        C7     T10

`from` is a label of the run before, or the name of one of the file's own trajectories. All lines apply at once, so
that two of them exchange two markers.
"""

from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shorten

import numpy as np

from muybridge.arrays import IndexArray
from muybridge.errors import FormatError, parsing

DELETE = "delete"
_MOST_DIGITS = 18  # of a frame


@dataclass(frozen=True)
class Correction:
    """One line: in frames `first` to `last` the point named `source` becomes `target`."""

    first: int
    last: int
    source: str
    target: str
    line: int


def read_corrections(path: Path) -> list[Correction]:
    """The lines of a corrections file.

    Raises:
        FormatError: a line is malformed, or the file cannot be read.
    """
    if not path.is_file():
        raise FormatError(f"{path}: no such file; give an existing file of corrections")
    with parsing(path, FormatError, "a file of corrections, a text file with one per line"):
        return _read(path, path.read_text(encoding="utf-8-sig").splitlines())


def _read(path: Path, lines: list[str]) -> list[Correction]:
    out = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) != 3:
            raise FormatError(f"{path}: line {number}: {len(words)} words; write frames, from and to, "
                              "such as: 100-250 LWRA LWRB")  # fmt: skip
        first, last = _frames(path, number, words[0])
        out.append(Correction(first, last, words[1], words[2], number))
    return out


def _frames(path: Path, number: int, text: str) -> tuple[int, int]:
    if text == "all":
        return 0, 1 << 60
    first, _, last = text.partition("-")
    if not (first.isdecimal() and (last.isdecimal() or not last)) or max(len(first), len(last)) > _MOST_DIGITS:
        raise FormatError(f"{path}: line {number}: {shorten(text)} is no range of frames; write 100-250, 100 or all")
    a, b = int(first), int(last or first)
    if b < a:
        raise FormatError(f"{path}: line {number}: the range {text} runs backwards; write {b}-{a}")
    return a, b


def apply_corrections(
    label: IndexArray, column: IndexArray, corrections: list[Correction], labels: tuple[str, ...],
    names: tuple[str, ...], path: Path,
) -> tuple[IndexArray, list[str]]:  # fmt: skip
    """Apply a person's corrections to the labels of slots.

    Args:
        label: (T, S) index of every slot's label, -1 for none.
        column: (T, S) column of the file that a slot comes from, -1 where it is empty.
        corrections: to apply.
        labels: of the marker set.
        names: of the file's columns.
        path: of the corrections, for messages.

    Returns:
        The new labels, and a sentence per line about its effect, also where it matched nothing.

    Raises:
        FormatError: a line names a frame, label or trajectory that does not exist.
    """
    out, notes = label.copy(), []
    corrected = np.zeros(label.shape, bool)
    for one in corrections:
        if one.first >= len(label):
            raise FormatError(f"{path}: line {one.line}: frame {one.first} is beyond the last, {len(label) - 1}")
        if one.target != DELETE and one.target not in labels:
            raise FormatError(f"{path}: line {one.line}: no label {one.target!r} in the set; valid are {DELETE} and "
                              f"{', '.join(labels)}")  # fmt: skip
        frames = slice(one.first, one.last + 1)
        if one.source in labels:
            chosen = label[frames] == labels.index(one.source)
        elif one.source in names:
            chosen = column[frames] == names.index(one.source)
        else:
            raise FormatError(f"{path}: line {one.line}: {one.source!r} is neither a label of the set nor a trajectory "
                              "of the file")  # fmt: skip
        new = -1 if one.target == DELETE else labels.index(one.target)
        if new >= 0:
            # A point that had this name and gets no other loses it.
            others = (out[frames] == new) & ~corrected[frames] & ~chosen
            out[frames][others & chosen.any(1)[:, None]] = -1
        out[frames][chosen] = new
        corrected[frames] |= chosen
        what = "deleted" if new < 0 else f"called {one.target}"
        count = int(chosen.any(1).sum())
        notes.append(f"{one.source} {what} in {count} frames" if count else f"line {one.line} found no {one.source}")
    return out, notes
