"""The command line: finds commands by entry point and reports known errors in one line.

A command is a plain function registered in the entry-point group `muybridge.commands`. Its signature becomes options
(`muybridge.infer.commands.parsing`), the first line of its docstring is its line in `muybridge --help`, and its return
value is the exit code (None is 0). A command's name may have two words (`calibrate board`). `muybridge --help` reads
that line from the source without importing it, so it is fast and works without the extras.

Exit codes: 0 success; 2 an error that the user can fix, reported in one line; 130 interrupted; anything else is a bug,
with its traceback.
"""

import ast
import atexit
import difflib
import gc
import importlib.metadata
import importlib.util
import logging
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from muybridge import __version__
from muybridge.errors import MissingExtraError, MuybridgeError
from muybridge.extras import extra_of
from muybridge.infer.commands.remedies import print_error

if TYPE_CHECKING:
    from muybridge.infer.commands.parsing import Call

GROUP = "muybridge.commands"
_log = logging.getLogger(__name__)
_FIRST = ("run", "demo")
# OpenBLAS starts a thread for every core as soon as numpy or scipy is loaded, and they spin while they wait for work.
# Nothing here has matrices large enough to gain by them; whoever does can set the variable.
_ONE_THREAD = "OPENBLAS_NUM_THREADS"


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit."""
    os.environ.setdefault(_ONE_THREAD, "1")
    # At its end the interpreter would look for cycles among all that was loaded, which takes most of a second.
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    sys.exit(run_command(sys.argv[1:] if argv is None else list(argv)))


def run_command(argv: Sequence[str]) -> int:
    """Run one command line and return its exit code; a bug's exception passes through."""
    try:
        return _dispatch(argv)
    except MuybridgeError as error:
        print_error(error)
        return 2
    except KeyboardInterrupt:
        print("interrupted; the same command resumes after the last finished stage", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader (`| head`) has gone; nothing may be flushed to it at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _dispatch(argv: Sequence[str]) -> int:
    commands = find_commands()
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(_help(commands))
        return 0
    if argv[0] in ("-V", "--version"):
        print(f"muybridge {__version__}")
        return 0
    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in commands:
            return _call(commands[name], list(argv[words:]))
    group = {n: e for n, e in commands.items() if n.startswith(f"{argv[0]} ")}
    if group and (len(argv) == 1 or argv[1] in ("-h", "--help", "help")):
        print(_help(group, f"{argv[0]} COMMAND"))
        return 0
    name = " ".join(argv[: 2 if group else 1])
    near = difflib.get_close_matches(name, commands, n=1)
    hint = f"did you mean `muybridge {near[0]}`?" if near else "`muybridge --help` lists them"
    raise MuybridgeError(f"no command `{name}` among {', '.join(group or commands)}; {hint}")


def find_commands() -> dict[str, importlib.metadata.EntryPoint]:
    """The registered commands by name, `run` and `demo` first."""
    found = {entry.name: entry for entry in importlib.metadata.entry_points(group=GROUP)}
    names = [n for n in _FIRST if n in found] + sorted(n for n in found if n not in _FIRST)
    return {n: found[n] for n in names}


def _call(entry: importlib.metadata.EntryPoint, arguments: list[str]) -> int:
    from muybridge.infer.results.ownership import refuse_root
    from muybridge.infer.runtime.logs import verbosity

    try:
        call = _parsed(entry, arguments)
        for path in call.outputs():
            refuse_root(path)
        with verbosity(call.console.verbose, call.console.quiet):
            _log.debug("muybridge %s, Python %s: %s %s", __version__, platform.python_version(), entry.name, arguments)
            _log.debug("arguments: %s", call.arguments)
            result = call()
    except ModuleNotFoundError as error:
        missing = error.name or ""
        extra = extra_of(missing)
        if extra is not None:
            raise MissingExtraError(
                f"`muybridge {entry.name}` needs {missing.split('.')[0]}, which is not installed; "
                f'install the extra: pip install "muybridge[{extra}]"'
            ) from None
        if missing and entry.module.startswith(missing):
            raise MuybridgeError(
                f"`muybridge {entry.name}` is not part of this installation ({missing} is missing); reinstall muybridge"
            ) from None
        raise
    return result if isinstance(result, int) else 0


def _parsed(entry: importlib.metadata.EntryPoint, arguments: list[str]) -> "Call":
    """The command with its arguments, ready to be called.

    Raises:
        MuybridgeError: an options class refuses a value.
    """
    command: Callable[..., Any] = entry.load()
    from muybridge.infer.commands.parsing import parse

    try:
        return parse(command, entry.name, arguments)
    except ValueError as error:
        raise MuybridgeError(f"{error}; `muybridge {entry.name} --help-all` lists the options") from None


def _help(commands: dict[str, importlib.metadata.EntryPoint], usage: str = "COMMAND") -> str:
    width = max((len(n) for n in commands), default=0)
    lines = [f"  {name:<{width}}  {summary(entry)}" for name, entry in commands.items()]
    return "\n".join(
        [
            f"usage: muybridge {usage} [OPTIONS]",
            "",
            f"muybridge {__version__}: motion capture from videos of a few calibrated cameras.",
            "",
            "commands:",
            *lines,
            "",
            "`muybridge COMMAND --help` shows a command's common options, `--help-all` every option;",
            "`muybridge --version` prints the version.",
        ]
    )


def summary(entry: importlib.metadata.EntryPoint) -> str:
    """First line of a command's docstring, read from its source without running it."""
    try:
        spec = importlib.util.find_spec(entry.module)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        return "(not part of this installation)"
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == entry.attr:
            return (ast.get_docstring(node) or "").split("\n")[0]
    return ""
