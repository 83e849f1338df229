"""From a command's signature to its options: tyro, with help in two lengths and no option that nobody should set.

A command's module may have a mapping `COMMON_OPTIONS` from a command's function name to the names of the options that
its `--help` shows; `--help-all` shows the others too, grouped by stage. Fields of options classes that are left out of
`muybridge.infer.commands.options.COMMAND_LINE` can be set from Python alone.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import textwrap
import typing
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro
from tyro.constructors import (
    MISSING_NONPROP,
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from muybridge.infer.commands.options import COMMAND_LINE, METAVARS, NAMES, WITHOUT_PREFIX

_CONSOLE = "console"


@dataclass(frozen=True)
class ConsoleOptions:
    """Options of every command.

    Attributes:
        help_all: show all options, grouped by stage, and exit.
        verbose: print log messages too; -vv adds debug messages and the names of modules.
        quiet: print results, warnings and errors only.
    """

    help_all: bool = False
    verbose: Annotated[tyro.conf.UseCounterAction[int], tyro.conf.arg(aliases=("-v",))] = 0
    quiet: Annotated[bool, tyro.conf.arg(aliases=("-q",))] = False


@dataclass(frozen=True)
class Call:
    """A command with the arguments of a command line.

    Attributes:
        function: the command.
        arguments: its arguments by name.
        console: the options that every command has.
    """

    function: Callable[..., Any]
    arguments: dict[str, Any]
    console: ConsoleOptions

    def outputs(self) -> list[Path]:
        """The files and folders that --out names, also those of options classes."""
        groups = [self.arguments, *(vars(v) for v in self.arguments.values() if dataclasses.is_dataclass(v))]
        return [group["out"] for group in groups if isinstance(group.get("out"), Path)]

    def __call__(self) -> Any:
        """Run the command."""
        positional = inspect.signature(self.function).parameters.values()
        first = [p.name for p in positional if p.kind is p.POSITIONAL_ONLY]
        rest = {name: value for name, value in self.arguments.items() if name not in first}
        return self.function(*(self.arguments[name] for name in first), **rest)


def parse(command: Callable[..., Any], name: str, words: Sequence[str]) -> Call:
    """Parse a command line; `--help`, `--help-all` and errors print and raise SystemExit.

    Args:
        command: the command's function.
        name: what the user calls it, such as `calibrate board`.
        words: what stands after the name.

    Raises:
        ValueError: an options class refused a value.
    """
    everything = not {"-h", "--help"} & set(words)
    words = _options_last(command, ["--help" if word == "--help-all" else word for word in words])
    call: Call = tyro.cli(_target(command), prog=f"muybridge {name}", args=words, **settings(command, everything))
    return call


def _options_last(command: Callable[..., Any], words: Sequence[str]) -> Sequence[str]:
    """The words with options behind all others, since argparse takes what stands behind an option for unknown.

    Nothing is moved where an option is none of the function's own, or takes several values.
    """
    hints = _option_hints(command)
    flags = {"help", "help_all", "verbose", "quiet", "v", "q", "vv", "h"} | {n for n, h in hints.items() if h is bool}
    flags |= {f"no_{name}" for name in flags}
    parameters = inspect.signature(command).parameters.values()
    named = hints.keys() - {p.name for p in parameters if p.kind is p.POSITIONAL_ONLY}
    named -= {name for name, hint in hints.items() if _takes_several(hint)}
    renamed = {_option_name(hint): name for name, hint in get_type_hints(command, include_extras=True).items()}
    plain: list[str] = []
    options: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or re.fullmatch(r"-\.?\d.*", word):
            plain.append(word)
            continue
        name, equals, _ = word.lstrip("-").replace("-", "_").partition("=")
        name = renamed.get(name, name)
        options.append(word)
        if name in flags:
            continue
        if name not in named:
            return words
        if not equals and rest:
            options.append(rest.pop(0))
    return [*plain, *options]


def _option_hints(command: Callable[..., Any]) -> dict[str, Any]:
    """Types of a command's parameters, and of the fields of those classes that stand for several options."""
    out: dict[str, Any] = {}
    for name, hint in get_type_hints(command, include_extras=True).items():
        plain = _plain(hint)
        if dataclasses.is_dataclass(plain) and _names_nothing(hint):
            out |= get_type_hints(plain)
        else:
            out[name] = hint.__origin__ if typing.get_origin(hint) is Annotated else hint
    return out


def _takes_several(hint: Any) -> bool:
    return typing.get_origin(_plain(hint)) in (tuple, list, dict) or dataclasses.is_dataclass(_plain(hint))


def _option_name(hint: Any) -> str | None:
    """What an option is called where not as its parameter."""
    names = (getattr(a, "name", None) for a in getattr(hint, "__metadata__", ()))
    return next((name.replace("-", "_") for name in names if name), None)


def settings(command: Callable[..., Any], everything: bool = True) -> dict[str, Any]:
    """Keyword arguments for `tyro.cli`, or another function of tyro that makes a parser, beside the command.

    Args:
        command: the command's function.
        everything: whether all options are there, or the common ones alone.
    """
    common = vars(inspect.getmodule(command)).get("COMMON_OPTIONS", {}).get(command.__name__)
    registry = ConstructorRegistry()
    registry.struct_rule(_Fields(command, None if everything or common is None else frozenset(common)))
    return {
        "description": description(command),
        "config": (tyro.conf.DisallowNone, tyro.conf.HelptextFromCommentsOff),
        "registry": registry,
    }


def parser_of(command: Callable[..., Any], name: str) -> Any:
    """An `argparse` parser with all options of a command, for documentation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # tyro has no other public way to a parser
        return tyro.extras.get_parser(_target(command), prog=f"muybridge {name}", **settings(command))


def description(command: Callable[..., Any]) -> str:
    """A command's docstring without its arguments; lines of a paragraph are joined, indented ones stay."""
    paragraphs = re.split(r"\n\s*\n", _sections(command)[0])
    return "\n\n".join(re.sub(r"\n(?! )", " ", paragraph) for paragraph in paragraphs)


class _Target:
    """Stands for a command where tyro asks for a type."""

    def __init__(self, command: Callable[..., Any]):
        self.command = command
        self.__doc__ = command.__doc__

    def __call__(self, **arguments: Any) -> Call:
        console = arguments.pop(_CONSOLE)
        return Call(self.command, arguments, console)


def _target(command: Callable[..., Any]) -> Callable[..., Call]:
    return _Target(command)


class _Fields:
    """tyro's rule for the fields of a command and of options classes."""

    def __init__(self, command: Callable[..., Any], common: frozenset[str] | None):
        self.command = command
        self.common = common
        hints = get_type_hints(command, include_extras=True).values()
        self.flat = {_plain(hint) for hint in hints if _names_nothing(hint)}

    def __call__(self, info: StructTypeInfo) -> StructConstructorSpec | None:
        if isinstance(info.type, _Target):
            return StructConstructorSpec(info.type, tuple(self._parameters()))
        if dataclasses.is_dataclass(info.type):
            return StructConstructorSpec(info.type, tuple(self._attributes(info.type, info.default)))
        return None

    def _parameters(self) -> Iterable[StructFieldSpec]:
        hints = get_type_hints(self.command, include_extras=True)
        texts = _sections(self.command)[1]
        for p in inspect.signature(self.command).parameters.values():
            default = MISSING_NONPROP if p.default is p.empty else p.default
            extra = [tyro.conf.Positional] if p.kind is p.POSITIONAL_ONLY else []
            yield self._field(p.name, hints[p.name], default, texts.get(p.name), extra)
        yield self._field(_CONSOLE, ConsoleOptions, ConsoleOptions(), "", [tyro.conf.CascadeSubcommandArgs])

    def _attributes(self, kind: Any, instance: Any) -> Iterable[StructFieldSpec]:
        hints = get_type_hints(kind, include_extras=True)
        texts = _texts_of_class(kind)
        shown = COMMAND_LINE.get(kind.__name__)
        for f in dataclasses.fields(kind):
            if not f.init:
                continue
            default = _default(f, instance)
            extra: list[Any] = [tyro.conf.arg(prefix_name=False)] if self._is_flat(kind) else []
            if shown is not None and f.name not in shown:
                extra.append(tyro.conf.Suppress)
            key = f"{kind.__name__}.{f.name}"
            if key in METAVARS:
                extra.append(tyro.conf.arg(metavar=METAVARS[key]))
            if key in NAMES:
                extra.append(tyro.conf.arg(name=NAMES[key], prefix_name=False))
            yield self._field(f.name, hints[f.name], default, texts.get(f.name), extra)

    def _field(self, name: str, hint: Any, default: Any, text: str | None, extra: list[Any]) -> StructFieldSpec:
        plain = _plain(hint)
        if dataclasses.is_dataclass(plain):
            extra += self._heading(name, plain)
        if plain is bool and default is False:
            extra.append(tyro.conf.FlagCreatePairsOff)
        if not dataclasses.is_dataclass(plain):
            extra.append(tyro.conf.arg(help_behavior_hint="" if name == "verbose" else _default_label))
        shown = tyro.conf.Positional in extra or default is MISSING_NONPROP
        if self.common is not None and not self._is_common(name, plain) and not shown:
            extra.append(tyro.conf.Suppress)
        if text is not None:
            text = re.sub(r"`?\bNone\b`?", "unset", text)  # on the command line nothing can be set to None
        return StructFieldSpec(name, Annotated[(hint, *extra)] if extra else hint, default, text)  # type: ignore[arg-type]

    def _heading(self, name: str, kind: Any) -> list[Any]:
        """An options class has a heading of its own in the long help; the short one has one heading for all."""
        alone = name != "options" and kind is not ConsoleOptions and (self.common is None or not self._is_flat(kind))
        return [tyro.conf.arg(name=name.replace("_", "-") if alone else "")]

    def _is_common(self, name: str, plain: Any) -> bool:
        assert self.common is not None
        if dataclasses.is_dataclass(plain):
            return self._is_flat(plain)
        return name in self.common or name in ConsoleOptions.__dataclass_fields__

    def _is_flat(self, kind: Any) -> bool:
        return kind is ConsoleOptions or kind in self.flat or kind.__name__ in WITHOUT_PREFIX


def _default_label(label: str) -> str:
    return "" if label in ("", "''", "None", "False") else f"(default: {label})"


def _plain(hint: Any) -> Any:
    """A type without its annotations, and without None."""
    if typing.get_origin(hint) is Annotated:
        return _plain(typing.get_args(hint)[0])
    parts = [a for a in typing.get_args(hint) if a is not type(None)]
    return _plain(parts[0]) if type(None) in typing.get_args(hint) and len(parts) == 1 else hint


def _names_nothing(hint: Any) -> bool:
    """Whether a parameter is annotated with `tyro.conf.arg(name="")`."""
    return any(getattr(a, "name", None) == "" for a in getattr(hint, "__metadata__", ()))


def _default(field: dataclasses.Field[Any], instance: Any) -> Any:
    """The default of a field in an instance of its class or, without one, in the class itself."""
    if dataclasses.is_dataclass(instance) and not isinstance(instance, type):
        return getattr(instance, field.name)
    if field.default is not dataclasses.MISSING:
        return field.default
    return MISSING_NONPROP if field.default_factory is dataclasses.MISSING else field.default_factory()


def _texts_of_class(kind: type) -> dict[str, str]:
    """What the docstrings of a class and its bases say about their attributes."""
    out: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if base.__dict__.get("__doc__"):
            out |= _sections(base)[1]
    return out


def _sections(documented: Any) -> tuple[str, dict[str, str]]:
    """A docstring's text before its first section, and the texts of its `Args` or `Attributes` by name, each in one
    line."""
    text = inspect.cleandoc(documented.__doc__ or "")
    before, *rest = re.split(r"^(?:Args|Attributes|Returns|Raises):\n", text, maxsplit=1, flags=re.M)
    found = re.search(r"^(?:Args|Attributes):\n((?:(?: {4}.*)?\n?)*)", text, flags=re.M)
    items = re.split(r"^(\w+): ", textwrap.dedent(found[1]), flags=re.M)[1:] if found else []
    return before.strip(), {name: " ".join(item.split()) for name, item in zip(items[::2], items[1::2], strict=True)}
