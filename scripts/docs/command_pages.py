"""Markdown of the command-line reference, from the parsers of the commands themselves."""

import argparse
import importlib
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

FOLDER = "reference/cli"
GROUP = "muybridge.commands"
_FIRST = ("run", "demo")


def registered(pyproject: Path) -> dict[str, str]:
    """The commands that pyproject.toml registers: name -> `module:function`, the most used first."""
    data = tomllib.loads(pyproject.read_text(encoding="utf-8"))
    found: dict[str, str] = data["project"]["entry-points"][GROUP]
    names = [n for n in _FIRST if n in found] + sorted(n for n in found if n not in _FIRST)
    return {name: found[name] for name in names}


def page_path(command: str) -> str:
    """The page of a command, relative to the documentation's folder."""
    return f"{FOLDER}/{command.replace(' ', '-')}.md"


def index_page(commands: dict[str, str]) -> str:
    """The table of commands with the first lines of their docstrings."""
    lines = [
        "# Command line",
        "",
        "`muybridge COMMAND --help` shows a command's common options, `--help-all` every option. The pages of this"
        " section are generated from the commands themselves and list every option. Exit codes: 0 for success, 2 for an"
        " error that you can fix (one line on standard error says what to do), 130 when interrupted. Anything else is"
        " a bug: please report it with its traceback.",
        "",
        "| command | purpose |",
        "| --- | --- |",
    ]
    for name, target in commands.items():
        summary = (_function(target).__doc__ or "").strip().split("\n")[0]
        lines.append(f"| [`muybridge {name}`]({Path(page_path(name)).name}) | {_escape(summary)} |")
    return "\n".join([*lines, ""])


def command_page(name: str, target: str) -> str:
    """The page of one command: usage, description, arguments, and every group of options."""
    from muybridge.infer.commands.parsing import parser_of

    parser = parser_of(_function(target), name)
    lines = [f"# muybridge {name}", "", *_parser(parser, f"muybridge {name}", 2)]
    return "\n".join(lines)


def _function(target: str) -> Callable[..., Any]:
    module, _, name = target.partition(":")
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


def _parser(parser: Any, name: str, level: int) -> Iterator[str]:
    yield from (_description(parser.description or ""), "")
    yield from ("```console", f"{name} {_usage(parser)}".rstrip(), "```", "")
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if _shown(a)]
        if not actions or all(_subparsers(a) for a in actions):
            continue
        yield from ("#" * level + f" {_title(group.title)}", "")
        if group.description and group.description.strip():
            yield from (_sentence(group.description), "")
        for action in actions:
            yield from _option(action)
    for action in parser._actions:
        for word, sub in _subparsers(action).items():
            yield from ("#" * level + f" {name} {word}", "", *_parser(sub, f"{name} {word}", level + 1))


def _description(text: str) -> str:
    """Indented lines, which show a command, as a block of code."""
    blocks = re.sub(
        r"((?:^    .*\n?)+)", lambda found: f"\n```sh\n{textwrap.dedent(found[1]).rstrip()}\n```\n", text, flags=re.M
    )
    return blocks.strip()


def _shown(action: Any) -> bool:
    return action.dest != "help" and action.help != argparse.SUPPRESS


def _subparsers(action: Any) -> dict[str, Any]:
    choices = getattr(action, "choices", None)
    return choices if isinstance(choices, dict) else {}


def _usage(parser: Any) -> str:
    words = ["[OPTIONS]"] if any(a.option_strings and _shown(a) for a in parser._actions) else []
    for action in parser._actions:
        if _subparsers(action):
            words.append("{" + ",".join(_subparsers(action)) + "}")
        elif not action.option_strings:
            words.append(str(action.metavar or action.dest))
    return " ".join(words)


def _title(title: str) -> str:
    words = title.strip()
    return {"positional arguments": "Arguments", "options": "Options"}.get(words, words[:1].upper() + words[1:])


def _option(action: Any) -> Iterator[str]:
    names = [f"`{n}`" for n in action.option_strings] or [f"`{action.metavar or action.dest}`"]
    value = str(action.metavar or "").replace("{None}|", "") if action.option_strings and action.nargs != 0 else ""
    yield ", ".join(names) + (f" `{value}`" if value else "")
    text = re.sub(r"\s+", " ", action.help or "").strip()
    text = re.sub(r"\s*\(default: (?:None)?\)$", "", text)  # "no value" says nothing to a reader
    text = re.sub(r"\(default: ([^()]*)\)$", lambda found: f"Default: {_value(found[1])}.", text)
    text = text.replace("(required)", "Required.")
    yield f":   {_sentence(text) or 'See the description.'}"
    yield ""


def _value(text: str) -> str:
    """A default: code where it is one word, else the words of whoever wrote the help."""
    return text if " " in text else f"`{text}`"


def _sentence(text: str) -> str:
    text = re.sub(r"\s+", " ", text).strip()
    return text[:1].upper() + text[1:]


def _escape(text: str) -> str:
    return text.replace("|", "\\|")
