"""Log messages of all modules, and how much a command prints.

Every module logs with the standard library (`logging.getLogger(__name__)`). The command line shows the records on
standard error with rich; where progress bars are shown, they appear above the bars, on the bars' own console.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

_quiet: ContextVar[bool] = ContextVar("quiet", default=False)
# muybridge's own loggers, then everyone else's (numba's debug messages number thousands), by --verbose.
_LEVELS = ((logging.WARNING, logging.WARNING), (logging.INFO, logging.WARNING), (logging.DEBUG, logging.INFO))
_STYLES = {logging.DEBUG: "dim", logging.INFO: "", logging.WARNING: "yellow", logging.ERROR: "bold red"}


@functools.cache
def error_console() -> Console:
    """The console of standard error, which bars and log messages share."""
    from rich.console import Console  # for whoever prints nothing, importing rich is time lost

    return Console(stderr=True)


def is_quiet() -> bool:
    """Whether the command was asked to print results, warnings and errors only."""
    return _quiet.get()


@contextmanager
def verbosity(verbose: int = 0, quiet: bool = False) -> Iterator[None]:
    """Show log records on standard error while the block runs.

    Args:
        verbose: 0 shows warnings, 1 also information, 2 or more also debug messages, with the names of modules.
        quiet: progress messages are left out, see `is_quiet`.
    """
    own, root = logging.getLogger("muybridge"), logging.getLogger()
    before = own.level, root.level
    handler = _ConsoleHandler(names=verbose >= 2)
    token = _quiet.set(quiet)
    own_level, root_level = _LEVELS[min(verbose, 2)]
    own.setLevel(own_level)
    root.setLevel(root_level)
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)
        own.setLevel(before[0])
        root.setLevel(before[1])
        _quiet.reset(token)


class _ConsoleHandler(logging.Handler):
    """Prints records in one line each: rich's own handler breaks lines where standard error is no terminal."""

    def __init__(self, names: bool):
        super().__init__()
        self._names = names

    def emit(self, record: logging.LogRecord) -> None:
        try:
            from rich.text import Text

            level = f"{record.levelname.lower()}: "
            name = f"{record.name}: " if self._names else ""
            text = Text.assemble((level, _STYLES.get(record.levelno, "")), (name, "dim"), self.format(record))
            error_console().print(text, soft_wrap=True)
        except Exception:
            self.handleError(record)
