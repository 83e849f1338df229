"""Files that `muybridge calibrate` writes: none replaces one that muybridge did not write."""

import re
from collections.abc import Iterable
from pathlib import Path

from muybridge.errors import OutputError

_MOST_BYTES = 1 << 20
# Our calibration files, pages and boards; other programs' formats have nothing that says who wrote them.
_OURS = re.compile(rb'^muybridge_calibration\s*=|<p class="kicker">muybridge calibration</p>|^%muybridge', re.M)


def check_replaceable(paths: Iterable[Path], overwrite: bool) -> None:
    """Before any work: refuse to write where there is something of somebody else's.

    Args:
        paths: files that will be written, and folders that will get files.
        overwrite: replace them all the same.

    Raises:
        OutputError: a file that muybridge did not write, or a folder with anything in it.
    """
    for path in paths if not overwrite else ():
        if any(path.iterdir()) if path.is_dir() else path.exists() and not _is_ours(path):
            raise OutputError(
                f"{path} is there already and was not made by muybridge, or has no mark of it: move it, choose another "
                "name, or give --overwrite"
            )


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return _OURS.search(file.read(_MOST_BYTES)) is not None
    except OSError:
        return False
