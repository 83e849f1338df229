"""Atomic writing: a run that is killed leaves no half-written file under a final name.

Every file is written under a temporary name and renamed when it is complete. Temporary names carry the host, the
process and a running number, so that neither threads nor computers that share a folder write to the same one.
"""

import functools
import glob
import hashlib
import itertools
import os
import platform
import re
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from muybridge.errors import OutputError

# Seconds without a write after which a temporary file of another host counts as abandoned.
_ABANDONED = 86400.0
_TEMPORARY = re.compile(r"\.(?P<host>[0-9a-f]{8})-(?P<process>\d+)-\d+\.tmp(\.[^.]*)?$")
_numbers = itertools.count()
# Temporary paths that this process is writing now.
_open: set[Path] = set()


def temporary_path(path: Path) -> Path:
    """A hidden name beside `path` that no other process, host or thread uses.

    The suffix is kept, in lower case, because some writers choose the format by it.
    """
    token = f"{_host()}-{os.getpid()}-{next(_numbers)}"
    return path.with_name(f".{path.stem}.{token}.tmp{path.suffix.lower()}")


@contextmanager
def replacing(path: Path, work: Path | None = None) -> Iterator[Path]:
    """A temporary path to write to; it replaces `path` when the block ends without an exception.

    If the block raises, the temporary file is removed and the file at `path` stays as it was. Temporary files of
    `path` that killed runs left are removed first.

    Args:
        path: file to write; its folder is made where missing.
        work: folder, on the same file system, for the temporary file, which then keeps the name of `path` (some
            formats record it); None for the folder of `path`.

    Raises:
        OutputError: the folder cannot be made, or the file cannot be written.
    """
    path = Path(path)
    entry = temporary_path(path if work is None else work / path.name)
    temporary = entry if work is None else entry / path.name
    _open.add(entry)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(entry.parent, path.name)
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except OutputError as error:
        # A writer that is atomic itself names the temporary file, which means nothing to the user.
        if error.details.get("path") != temporary or not isinstance(error.__cause__, OSError):
            raise
        raise cannot_write(path, error.__cause__) from error.__cause__
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        _open.discard(entry)
        with suppress(OSError):
            _remove(entry)


def cannot_write(path: Path, error: Exception) -> OutputError:
    """The error to raise where writing `path` failed."""
    reason = str(getattr(error, "strerror", None) or error).lower()
    return OutputError(f"{path} cannot be written ({reason})", remedy="unwritable", path=path)


def remove_abandoned(folder: Path, name: str | None = None) -> None:
    """Remove temporary files that killed runs left in a folder.

    Args:
        folder: to look in, not below it.
        name: only those of the file of this name; None for all.
    """
    pattern = ".*.tmp*"
    if name is not None:
        stem, suffix = glob.escape(Path(name).stem), glob.escape(Path(name).suffix.lower())
        pattern = f".{stem}.*.tmp{suffix}"
    for entry in folder.glob(pattern):
        with suppress(FileNotFoundError):  # other processes tidy too
            if _is_abandoned(entry):
                _remove(entry)


def _is_abandoned(entry: Path) -> bool:
    """Whether no process writes a temporary file any more: its process has ended, or it is another host's and old."""
    match = _TEMPORARY.search(entry.name)
    if match is None:
        return False
    if match["host"] == _host():
        process = int(match["process"])
        if process == os.getpid():
            return entry not in _open
        if os.name == "posix":  # elsewhere, sending signal 0 would end the process
            return not _is_alive(process)
    return time.time() - entry.stat().st_mtime > _ABANDONED


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass  # it belongs to another user
    return True


def _remove(entry: Path) -> None:
    if entry.is_dir():
        shutil.rmtree(entry, ignore_errors=True)
    else:
        entry.unlink(missing_ok=True)


@functools.cache
def _host() -> str:
    """Eight hexadecimal digits for what numbers processes: this boot of this host, or of this container on it."""
    facts = [platform.node()]
    with suppress(OSError):
        facts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
    with suppress(OSError):
        facts.append(os.readlink("/proc/self/ns/pid"))
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:8]
