"""Writing files so that a killed run leaves no half file behind."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from muybridge.errors import OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it takes `path`'s place when the block ends well.

    The suffix is kept, since some writers choose the format by it. If the block raises, the temporary file is
    removed and what stood at `path` before stays as it was.

    Raises:
        OutputError: the folder cannot be made or the file cannot be written there.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); choose a folder you may write to"
        ) from error
    finally:
        temporary.unlink(missing_ok=True) if temporary.parent.is_dir() else None
