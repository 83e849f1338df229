"""What muybridge may replace, decided before any work starts.

A file belongs to muybridge if the manifest of its results folder has the digest of its content (`OutputFolder.owns`),
or if its content bears muybridge's mark, as calibrations, clock files, boards, motion graphs, styles and pages do. Any
other file is replaced only with `overwrite`, input files never, and the root of a file system takes no results.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from muybridge.errors import OutputError
from muybridge.files import cannot_write, temporary_path

_MOST_BYTES = 1 << 20
_MARK = re.compile(
    rb'^muybridge_(calibration|sync)\s*=|<p class="kicker">muybridge calibration</p>|^%muybridge'
    rb'|<meta name="generator" content="muybridge (?:view|match|graph)">'
    rb"|\APK\x03\x04[\s\S]{26}muybridge_(?:graph|style)\.npy",
    re.M,
)


def check_replaceable(
    paths: Iterable[Path], overwrite: bool = False, read: Iterable[Path] = (), make_folders: bool = True
) -> None:
    """Refuse files that cannot or may not be written; makes their folders.

    Args:
        paths: files that will be written, and folders that will receive files.
        overwrite: whether files of others may be replaced.
        read: input files.
        make_folders: whether missing folders stay; not where reading, which may fail, comes after this check.

    Raises:
        OutputError: an input file, a file that muybridge did not write, a folder with anything in it, the root of a
            file system, or a place that cannot be written.
    """
    inputs = {other.resolve() for other in read}
    for path in paths:
        refuse_root(path)
        if path.resolve() in inputs:
            raise OutputError(f"{path} is a file to be read", remedy="other_name")
        taken = any(path.iterdir()) if path.is_dir() else path.exists() and not bears_mark(path)
        if taken and not overwrite:
            raise OutputError(
                f"{path} is there already and was not made by muybridge, or has no mark of it", remedy="overwrite"
            )
        made = [each for each in (path.parent, *path.parent.parents) if not each.exists()]
        make_writable(path.parent)
        if not make_folders:
            for each in made:
                each.rmdir()


def refuse_root(path: Path) -> None:
    """Refuse the root of a file system as a place for results.

    Raises:
        OutputError: it is one.
    """
    place = path.resolve()
    if place == place.parent:
        raise OutputError(f"{path} is the root of a file system, which takes no results", remedy="other_folder")


def make_writable(folder: Path) -> None:
    """Make a folder, and try to write there.

    Raises:
        OutputError: that is not possible.
    """
    probe = temporary_path(folder / "probe")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"muybridge")
        probe.unlink()
    except OSError as error:
        raise cannot_write(folder, error) from None


def bears_mark(path: Path) -> bool:
    """Whether a file's content says that muybridge wrote it."""
    try:
        with path.open("rb") as file:
            return _MARK.search(file.read(_MOST_BYTES)) is not None
    except OSError:
        return False
