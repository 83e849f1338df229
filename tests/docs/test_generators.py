"""The generated pages of the reference, from toy packages and toy commands."""

import dataclasses
import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.paths import REPOSITORY


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the scripts on the import path."""
    monkeypatch.syspath_prepend(str(REPOSITORY / "scripts" / "docs"))


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A package that exports one lazy function, one bare function, two classes and a constant."""
    package = tmp_path / "toy_package"
    package.mkdir()
    (package / "parts.py").write_text(
        "import dataclasses\n"
        "def good():\n    '''Say how it goes.'''\n"
        "def bare():\n    pass\n"
        "@dataclasses.dataclass\nclass Silent:\n    x: int = 0\n"
        "class Told:\n    '''A class.'''\n"
        "LIMIT = 3\n"
        "__all__ = ['good', 'Told']\n"
    )
    (package / "__init__.py").write_text(
        "'''A toy.\n\nMore of it.'''\n"
        "from toy_package.parts import LIMIT, Silent, Told, bare\n"
        "__all__ = ['good', 'bare', 'Silent', 'Told', 'LIMIT']\n"
        "def __getattr__(name):\n"
        "    from toy_package import parts\n"
        "    return getattr(parts, name)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "toy_package"
    for name in [n for n in sys.modules if n.startswith("toy_package")]:
        del sys.modules[name]


def _load(name: str) -> ModuleType:
    return importlib.import_module(name)


def test_public_names_know_where_lazy_names_live(scripts: None, toy: str) -> None:
    found = {name.name: name for name in _load("public_names").public_names(toy)}
    assert list(found) == ["bare", "good", "LIMIT", "Silent", "Told"]
    assert found["good"].home == "toy_package.parts.good"
    assert found["LIMIT"].home == "toy_package.LIMIT"
    assert [found[n].kind for n in ("good", "Told", "LIMIT")] == ["function", "class", "value"]


def test_a_stub_says_where_names_live(scripts: None, toy: str, tmp_path: Path) -> None:
    stub = "from .parts import LIMIT as LIMIT\nfrom .parts import good as good\n"
    (tmp_path / "toy_package" / "__init__.pyi").write_text(stub)
    found = {name.name: name.home for name in _load("public_names").public_names(toy)}
    assert found["LIMIT"] == "toy_package.parts.LIMIT" and found["good"] == "toy_package.parts.good"


def test_names_without_a_docstring_are_found(scripts: None, toy: str) -> None:
    # A dataclass' signature is no docstring; a constant needs none.
    assert _load("public_names").undocumented([toy]) == ["toy_package.bare", "toy_package.Silent"]


def test_a_name_that_is_not_there_is_an_error(scripts: None, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("toy_broken")
    module.__all__ = ["missing"]  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "toy_broken", module)
    with pytest.raises(AttributeError, match="missing"):
        _load("public_names").public_names("toy_broken")


def test_api_pages_have_an_entry_for_each_name(scripts: None, toy: str) -> None:
    pages = _load("api_pages")
    page = pages.package_pages([toy])["reference/api/toy_package.md"]
    assert page.index("## Functions") < page.index("## Classes") < page.index("## Values")
    for name in ("bare", "good", "Silent", "Told"):
        assert f"::: toy_package.parts.{name}\n    options:\n      heading: {name}\n" in page
    # A second package that exports the same things links to the first.
    again = pages.package_pages([toy, "toy_package.parts"])["reference/api/toy_package.parts.md"]
    assert ":::" not in again and "[`good`](toy_package.md#toy_package.parts.good)" in again
    index = pages.index_page([toy])
    assert "[`good`](toy_package.md#toy_package.parts.good)" in index
    assert "A toy." in index and "More of it" not in index


@dataclasses.dataclass
class Options:
    """Options of the toy.

    Attributes:
        strength: how strongly. (default: as it was)
        tail: what comes last.
    """

    strength: float | None = None
    tail: str = "end"


def command(target: Path, options: Options) -> None:
    """Do a toy's work.

    With care.

    Args:
        target: what to write (required).
        options: how.
    """


def test_command_pages_list_every_option(scripts: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "toy_command", module := ModuleType("toy_command"))
    module.command = command  # type: ignore[attr-defined]
    page = _load("command_pages").command_page("toy", "toy_command:command")
    assert page.startswith("# muybridge toy\n\nDo a toy's work.\n\nWith care.\n")
    assert "`--target` `PATH`\n:   What to write" in page
    assert "`--strength` `FLOAT`\n:   How strongly. Default: as it was.\n" in page
    assert "`--tail` `STR`\n:   What comes last. Default: `end`.\n" in page
    assert "toy" in _load("command_pages").index_page({"toy": "toy_command:command"})


def test_every_registered_command_has_a_page(scripts: None) -> None:
    pages = _load("command_pages")
    commands = pages.registered(REPOSITORY / "pyproject.toml")
    assert list(commands)[:2] == ["run", "demo"]
    for name in ("run", "calibrate board", "convert"):
        page = pages.command_page(name, commands[name])
        assert f"muybridge {name}" in page and "`--overwrite`" in page
    assert pages.page_path("calibrate board") == "reference/cli/calibrate-board.md"
