"""Every option on a page is one of the command that it is shown with."""

import argparse
import functools
import importlib
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest

from muybridge.infer.commands.parsing import parser_of
from tests.paths import REPOSITORY

DOCS = REPOSITORY / "docs"
PAGES = [REPOSITORY / "README.md", *sorted(p for p in DOCS.rglob("*.md") if p.parent.name != "development")]
OTHERS = {"--depth"}  # of other programs


@functools.cache
def _commands() -> dict[str, str]:
    sys.path.insert(0, str(REPOSITORY / "scripts" / "docs"))
    try:
        found: dict[str, str] = importlib.import_module("command_pages").registered(REPOSITORY / "pyproject.toml")
    finally:
        sys.path.pop(0)
    return found


@functools.cache
def _options(command: str) -> frozenset[str]:
    module, _, name = _commands()[command].partition(":")
    return frozenset(_collected(parser_of(getattr(importlib.import_module(module), name), command)))


def _collected(parser: Any) -> set[str]:
    found: set[str] = set()
    for action in parser._actions:
        if action.help != argparse.SUPPRESS:
            found.update(action.option_strings)
        if isinstance(action.choices, dict):
            for sub in action.choices.values():
                found |= _collected(sub)
    return found


def _shown(page: Path) -> list[list[str]]:
    blocks = re.findall(r"```(?:sh|console|powershell)\n(.*?)```", page.read_text(), re.S)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    calls = [re.search(r"(?:^|[\s\\/])muybridge\s+([a-z].*)", line.split("  #")[0]) for line in lines]
    return [shlex.split(call[1]) for call in calls if call and "--version" not in call[1]]


def _command(words: list[str]) -> str:
    two = " ".join(words[:2])
    return two if two in _commands() else words[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(REPOSITORY)))
def test_commands_have_the_options_that_they_are_shown_with(page: Path) -> None:
    for words in _shown(page):
        if words[0] == "cd" or words[0] not in {c.split()[0] for c in _commands()}:
            assert words[0] in ("clone", "cd", "&&"), f"muybridge {' '.join(words)}: no such command"
            continue
        command = _command(words)
        wrong = [w for w in words if w.startswith("--") and w not in _options(command)]
        assert not wrong, f"muybridge {command} has no {', '.join(wrong)}"


# The benchmarks' page names options of scripts too.
@pytest.mark.parametrize("page", [p for p in PAGES if p.name != "benchmarks.md"], ids=lambda p: p.stem)
def test_options_in_the_text_exist(page: Path) -> None:
    prose = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
    known = OTHERS.union(*(_options(command) for command in _commands()))
    named = {w for code in re.findall(r"`([^`\n]*)`", prose) for w in re.findall(r"(?<![\w-])--[a-z][\w.-]*", code)}
    assert not sorted(named - known)
