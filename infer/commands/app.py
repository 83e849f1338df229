"""The command line: finds commands by entry point, and says known errors in one line.

A command is a plain function registered in the entry-point group ``muybridge.commands``. Its signature
becomes flags (tyro), the first line of its docstring is its line in ``muybridge --help``, and what it returns
is the exit code (None is 0). A command's name may be two words (`calibrate board`). The help reads that line
from the source without importing it, so that it works at once and without the extras.

Exit codes: 0 done; 2 an error that the user can mend, in one line; 130 interrupted; anything else is a bug,
with its traceback.
"""

import ast
import difflib
import functools
import importlib.metadata
import importlib.util
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from muybridge import __version__
from muybridge.errors import MissingExtraError, MuybridgeError
from muybridge.extras import extra_of
from muybridge.infer.commands.remedies import error_line

GROUP = "muybridge.commands"
_FIRST = ("run", "demo")


def main(argv: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit."""
    sys.exit(run_command(sys.argv[1:] if argv is None else list(argv)))


def run_command(argv: Sequence[str]) -> int:
    """Run one command line and return its exit code; a bug's exception passes through."""
    try:
        return _dispatch(argv)
    except MuybridgeError as error:
        print(f"error: {error_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from the last finished stage", file=sys.stderr)
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
    try:
        result = _parsed(entry, arguments)()
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


def _parsed(entry: importlib.metadata.EntryPoint, arguments: list[str]) -> Callable[[], Any]:
    """The command with its arguments, ready to be called."""
    command: Callable[..., Any] = entry.load()
    import tyro

    @functools.wraps(command)
    def bind(*given: Any, **named: Any) -> Callable[[], Any]:
        return functools.partial(command, *given, **named)

    try:
        call: Callable[[], Any] = tyro.cli(bind, prog=f"muybridge {entry.name}", args=arguments)
    except ValueError as error:  # an options class refused what it was given
        raise MuybridgeError(f"{error}; `muybridge {entry.name} --help` lists the options") from None
    return call


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
            "`muybridge COMMAND --help` lists a command's options; `muybridge --version` prints the version.",
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
