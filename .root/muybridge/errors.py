"""The errors that a user can cause and fix.

A message says what is wrong, where (file, camera, frame) and what would be valid, in one line. What to do about it
differs between a Python caller and a user of the command line, so it is not part of the message: the exception
carries a remedy key, and `muybridge.remedies` has the text for callers while the command line has its own table with
commands to paste. The command line prints both in one line and exits with 2; any other exception is a bug and keeps
its traceback.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from muybridge.remedies import REMEDIES

_LONGEST = 1200  # characters of a message


class MuybridgeError(Exception):
    """Base of every error that a user can fix.

    Attributes:
        message: what is wrong, where, and what would be valid.
        remedy: key of `muybridge.remedies.REMEDIES`, or None where the message says everything.
        details: values that the remedy's text names, such as `path`.
    """

    def __init__(self, message: str = "", *, remedy: str | None = None, **details: Any):
        if remedy is not None and remedy not in REMEDIES:
            raise KeyError(f"no remedy {remedy!r} in muybridge.remedies")
        super().__init__(message)
        self.message = message
        self.remedy = remedy
        self.details = details

    def __str__(self) -> str:
        if self.remedy is None:
            return self.message
        return f"{self.message}; {REMEDIES[self.remedy].format(**self.details)}"

    def reworded(self, message: str) -> "MuybridgeError":
        """The same error with another message."""
        return type(self)(message, remedy=self.remedy, **self.details)

    def about(self, what: str) -> "MuybridgeError":
        """The same error with a message that begins with the file, camera or argument that it is about."""
        return self.reworded(f"{what}: {self.message}")

    def __reduce__(self) -> tuple[Any, ...]:  # exceptions cross process boundaries
        return _rebuild, (type(self), self.message, self.remedy, self.details)


def _rebuild(kind: type[MuybridgeError], message: str, remedy: str | None, details: dict[str, Any]) -> MuybridgeError:
    return kind(message, remedy=remedy, **details)


class SessionError(MuybridgeError):
    """A session folder cannot be used as it is."""


class VideoError(MuybridgeError):
    """A video cannot be read, or cannot be read to its end."""


class CalibrationError(MuybridgeError):
    """A calibration file is corrupt, of no known format, or does not fit the videos."""


class ModelError(MuybridgeError):
    """A model file is missing or is not one that muybridge can use."""


class FormatError(MuybridgeError):
    """A motion or marker file (BVH, C3D, TRC, ...) is malformed."""


class OutputError(MuybridgeError):
    """Results cannot be written to the requested place."""


class MissingExtraError(MuybridgeError):
    """A command needs an extra (`pip install "muybridge[train]"`) that is not installed."""


@contextmanager
def parsing(path: Path | str, error: type[MuybridgeError], what: str, remedy: str | None = None) -> Iterator[None]:
    """Turn anything that parsing a damaged file may raise into an error that names the file.

    Every reader of a file that comes from outside runs its parser in this context. Errors of the family pass through
    unchanged, but for what they quote of the file, which is cut where it is long. The original exception is kept as the
    cause, so that a bug in a parser still shows its traceback in the detailed log.

    Args:
        path: the file, as the message names it.
        error: kind of error to raise.
        what: the file's format with its article, such as "a BVH".
        remedy: key of what to do about it, which needs no details.

    Raises:
        MuybridgeError: of kind `error`, for any other exception.
    """
    try:
        yield
    except MuybridgeError as problem:
        short = _one_line(problem.message)
        if short == problem.message:
            raise
        raise problem.reworded(short) from problem
    except MemoryError as problem:
        raise error(
            f"{_named(path)}: declares more data than fits into memory; {what} of this size is damaged", remedy=remedy
        ) from problem
    except RecursionError as problem:
        raise error(f"{_named(path)}: nested too deeply for {what}; the file is damaged", remedy=remedy) from problem
    except OSError as problem:
        reason = " ".join(str(problem.strerror or problem).split())[:200]
        raise error(f"{_named(path)}: cannot be read: {reason}") from problem
    except Exception as problem:
        reason = " ".join(str(problem).partition("; use sys.")[0].split())[:200] or type(problem).__name__
        raise error(f"{_named(path)}: damaged, or not {what}: {reason}", remedy=remedy) from problem


def _named(path: Path | str) -> str:
    """A path as messages name it: in one line, whatever its characters are."""
    return " ".join(str(path).splitlines())


def _one_line(message: str) -> str:
    """A message without line breaks, and of a length that can be read even where it quotes a damaged file."""
    line = " ".join(message.split()) if "\n" in message or "\r" in message else message
    half = _LONGEST // 2
    return line if len(line) <= _LONGEST else f"{line[:half]} [...] {line[-half:]}"
