"""Writing files so that a killed run leaves no half file behind."""

import glob
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from muybridge.errors import OutputError

# Seconds after which a temporary file that nobody wrote to is a killed run's.
_ABANDONED = 86400.0


def check_free(path: Path, overwrite: bool, read: Iterable[Path] = ()) -> None:
    """Refuse to replace what is there already.

    Args:
        path: a file to be written.
        overwrite: whether it may be replaced.
        read: files that are read; none of them is ever replaced.

    Raises:
        OutputError: it may not.
    """
    if not path.exists():
        return
    if path.resolve() in (other.resolve() for other in read):
        raise OutputError(f"{path} is a file to be read: choose another name")
    if not overwrite:
        raise OutputError(f"{path} is there already: choose another name, or give --overwrite")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes `path`'s place when the block ends well.

    The suffix is kept, in small letters, since some writers choose the format by it. If the block raises, the
    temporary file is removed and what stood at `path` before stays as it was. What runs that were killed a day ago or
    earlier left of `path` is removed.

    Raises:
        OutputError: the folder cannot be made or the file cannot be written there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix.lower()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _tidy(path)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); choose a folder you may write to"
        ) from error
    finally:
        temporary.unlink(missing_ok=True) if temporary.parent.is_dir() else None


def _tidy(path: Path) -> None:
    for left in path.parent.glob(f".{glob.escape(path.stem)}.*.tmp{glob.escape(path.suffix.lower())}"):
        with suppress(FileNotFoundError):  # another process tidies too
            if time.time() - left.stat().st_mtime > _ABANDONED:
                left.unlink()
