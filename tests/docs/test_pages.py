"""What the documents say of the repository is so, and they say it in plain language."""

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest

import muybridge
from muybridge.models.keypoints.external import load_card
from tests.paths import REPOSITORY

DOCS = REPOSITORY / "docs"
PAGES = [p for p in sorted(DOCS.rglob("*.md")) if p.name != "training-log.md"]
TOP = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
CODE = re.compile(r"```.*?```", re.DOTALL)
# Words that used to have a private meaning here.
DIALECT = re.compile(
    r"\b(films?|filmed by|mended|second look|first look|as sure as|sureness|who is seen|culprits?|is told|are told|"
    r"left out in silence|hangs|plates? of)\b",
    re.I,
)


def _name(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


@pytest.mark.parametrize("page", [*TOP, *PAGES], ids=_name)
def test_pages_use_the_fields_words(page: Path) -> None:
    text = CODE.sub("", page.read_text())
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", "", text)
    assert not DIALECT.findall(text)


@pytest.mark.parametrize("page", [*TOP, *PAGES], ids=_name)
def test_commands_on_pages_exist(page: Path) -> None:
    registered = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]["entry-points"][
        "muybridge.commands"
    ]
    groups = "|".join(sorted({name.split()[0] for name in registered if " " in name}))
    for command in re.findall(
        rf"muybridge ((?:(?:{groups}) )?[a-z][a-z-]+)", "\n".join(CODE.findall(page.read_text()))
    ):
        first = command.split()[0]
        assert command in registered or first in registered, f"muybridge {command}"


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_scripts_on_pages_exist(page: Path) -> None:
    text = page.read_text()
    named = set(re.findall(r"\bscripts/[\w/]+\.(?:py|sh)", text))
    named |= {f"{m.replace('.', '/')}.py" for m in re.findall(r"python -m (scripts(?:\.\w+)+)", text)}
    assert not [script for script in sorted(named) if not (REPOSITORY / script).is_file()]


def test_the_map_of_the_source_names_folders_that_are_there() -> None:
    text = (REPOSITORY / "CONTRIBUTING.md").read_text()
    rows = [row for row in text.splitlines() if row.startswith("| ")]
    folders = {f for row in rows for f in re.findall(r"`((?:geometry|models|motion|infer|train|scripts)/[\w/]*)`", row)}
    assert len(folders) > 40
    assert not [f for f in sorted(folders) if not (REPOSITORY / f).is_dir()]


def test_the_map_of_the_source_names_every_folder() -> None:
    text = (REPOSITORY / "CONTRIBUTING.md").read_text()
    for top in ("geometry", "models", "infer"):
        for folder in sorted(p.parent for p in (REPOSITORY / top).glob("*/__init__.py")):
            assert f"`{top}/{folder.name}/`" in text, f"{top}/{folder.name}/ is not in CONTRIBUTING.md"


def test_twenty_things_are_listed() -> None:
    text = (REPOSITORY / "CONTRIBUTING.md").read_text().split("### Where is ...?")[1].split("\n## ")[0]
    assert len(re.findall(r"^\| (?!thing|---)", text, re.M)) == 20


def test_every_example_is_short_and_shown_on_a_page() -> None:
    shown = "\n".join(p.read_text() for p in PAGES)
    for example in sorted((DOCS / "examples").glob("*.py")):
        assert re.match(r"\d\d_", example.name)
        assert len(example.read_text().splitlines()) < 60, example.name
        assert f'"{example.name}' in shown, f"{example.name} is on no page"


def test_pages_that_the_source_names_exist() -> None:
    lost = []
    for top in ("geometry", "models", "motion", "infer", "train", "scripts", ".root/muybridge"):
        for path in (REPOSITORY / top).rglob("*.py"):
            for page in re.findall(r"\bdocs/[\w/-]+\.(?:md|webp)", path.read_text()):
                if not (REPOSITORY / page).is_file():
                    lost.append(f"{path.relative_to(REPOSITORY)}: {page}")
    assert not lost


def test_every_figure_of_a_run_is_documented() -> None:
    page = (DOCS / "reference" / "run-json.md").read_text()
    fields = [field.name for field in dataclasses.fields(muybridge.Quality)]
    assert "leave_one_out_px" in fields
    assert not [name for name in fields if f"`{name}`" not in page]


def test_the_model_card_of_the_reference_is_a_card(tmp_path: Path) -> None:
    page = (DOCS / "reference" / "model-files.md").read_text()
    first, heatmaps = re.findall(r"```toml\n(.*?)```", page, re.S)
    (tmp_path / "simcc.toml").write_text(first)
    assert load_card(tmp_path / "simcc.toml").name == "RTMPose, COCO-17"
    other = re.sub(r"\[simcc\].*?(?=\[variance\])", heatmaps + "\n", first.replace('"simcc"', '"heatmaps"'), flags=re.S)
    (tmp_path / "heatmaps.toml").write_text(other)
    assert load_card(tmp_path / "heatmaps.toml").width == 192
