"""Errors say what is wrong; what to do about it stands in two tables, for Python callers and for the command line."""

import ast
import re
import string
from collections.abc import Iterator
from pathlib import Path

import pytest

from muybridge.errors import FormatError, MuybridgeError
from muybridge.infer.commands.remedies import COMMAND_REMEDIES, error_line
from muybridge.remedies import REMEDIES

LOWER_LAYERS = ("geometry", "models", "motion")
FOLDERS = (*LOWER_LAYERS, "infer", "train", ".root/muybridge")
FLAG = re.compile(r"(?<![\w-])--[a-z]|`muybridge ")
# Files that still name flags or commands; they only ever become fewer.
STILL_NAME_FLAGS: set[str] = set()


def sources(repository: Path, folders: tuple[str, ...]) -> Iterator[tuple[str, ast.Module]]:
    for folder in folders:
        for path in sorted((repository / folder).rglob("*.py")):
            if path.resolve().is_relative_to((repository / folder).resolve()):  # .root has links to the folders
                yield str(path.relative_to(repository)), ast.parse(path.read_text(encoding="utf-8"))


def strings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def uses(repository: Path) -> Iterator[tuple[str, str, set[str]]]:
    """Every place where an error gets a remedy: file and line, key, and the names of the details."""
    for name, tree in sources(repository, FOLDERS):
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            for keyword in node.keywords:
                if keyword.arg != "remedy" or name.endswith("muybridge/errors.py"):
                    continue
                place = f"{name}:{node.lineno}"
                details = {k.arg for k in node.keywords} - {"remedy"}
                assert None not in details, f"{place}: details must be named where the error is raised"
                for key in keys(keyword.value, tree):
                    yield place, key, {str(d) for d in details}


def keys(value: ast.expr, tree: ast.Module) -> set[str]:
    """The remedies that an expression can be: a literal, one of two, or any that a module hands to its own function."""
    if isinstance(value, ast.Constant):
        return set() if value.value is None else {value.value}
    if isinstance(value, ast.IfExp):
        return keys(value.body, tree) | keys(value.orelse, tree)
    assert isinstance(value, ast.Name), f"the remedy must be a literal: {ast.dump(value)}"
    return {text for _, text in strings(tree)} & set(REMEDIES)


def fields(text: str) -> set[str]:
    return {re.split(r"[.\[]", name)[0] for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def test_both_tables_have_the_same_keys_in_order():
    assert list(REMEDIES) == sorted(REMEDIES) == list(COMMAND_REMEDIES)


def test_every_remedy_is_used_and_gets_the_details_that_it_names(repository):
    tables = (".root/muybridge/remedies.py", "infer/commands/remedies.py")
    named = {text for name, tree in sources(repository, FOLDERS) if name not in tables for _, text in strings(tree)}
    assert set(REMEDIES) - named == set()
    for place, key, details in uses(repository):
        for text in (REMEDIES[key], COMMAND_REMEDIES[key]):
            assert fields(text) <= details, f"{place}: {key} needs {fields(text) - details}"


def test_remedies_for_callers_name_no_flags_and_all_are_half_sentences():
    for table in (REMEDIES, COMMAND_REMEDIES):
        for key, text in table.items():
            assert text == text.strip() and text[-1] not in ".;" and text[0] == text[0].lower(), key
    assert not [key for key, text in REMEDIES.items() if FLAG.search(text)]


def test_geometry_models_and_motion_know_no_command_line(repository):
    found = {name for name, tree in sources(repository, LOWER_LAYERS) if any(FLAG.search(s) for _, s in strings(tree))}
    assert found - STILL_NAME_FLAGS == set(), "give the error a remedy, see muybridge/errors.py"
    gone = {name for name in STILL_NAME_FLAGS if (repository / name).is_file()} - found
    assert not gone, "these can leave STILL_NAME_FLAGS"


def test_a_message_is_followed_by_the_remedy_of_the_reader():
    error = MuybridgeError("a.trc\n is there already", remedy="overwrite")
    assert str(error) == "a.trc\n is there already; choose another name, or pass overwrite=True"
    assert error_line(error) == "a.trc is there already; choose another name, or give --overwrite"
    placed = FormatError("no rate", remedy="overwrite", path=Path("x")).about("walk.trc")
    assert type(placed) is FormatError and placed.message == "walk.trc: no rate"
    assert (placed.remedy, placed.details) == ("overwrite", {"path": Path("x")})
    with pytest.raises(KeyError, match="no remedy 'nonsense'"):
        MuybridgeError("a", remedy="nonsense")
