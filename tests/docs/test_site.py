"""The documentation builds strictly, and a strict build fails for what it should fail for."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.paths import REPOSITORY

pytest.importorskip("mkdocs", reason="mkdocs is in the docs extra")
pytest.importorskip("mkdocstrings", reason="mkdocstrings is in the docs extra")
pytestmark = pytest.mark.slow

Build = Callable[[], None]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The documentation's sources in another folder, beside the same scripts and packages."""
    shutil.copytree(REPOSITORY / "docs", tmp_path / "docs")
    for name in ("mkdocs.yml", "pyproject.toml", "CONTRIBUTING.md"):
        shutil.copy(REPOSITORY / name, tmp_path / name)
    for name in (".root", "scripts", "geometry", "models", "motion", "infer", "train"):
        (tmp_path / name).symlink_to(REPOSITORY / name, target_is_directory=True)
    return tmp_path


def _build(folder: Path) -> Path:
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    config = load_config(str(folder / "mkdocs.yml"), site_dir=str(folder / "site"), strict=True)
    config.plugins.on_startup(command="build", dirty=False)
    build(config)
    return folder / "site"


def test_the_site_builds_and_has_its_generated_pages(copy: Path) -> None:
    site = _build(copy)
    run = (site / "reference" / "cli" / "run" / "index.html").read_text()
    assert "--overwrite" in run
    for page in ("index.html", "reference/api/index.html", "reference/cli/calibrate-board/index.html"):
        assert (site / page).is_file()
    # Nothing is fetched from elsewhere: the site works without a network.
    for page in site.rglob("*.html"):
        text = page.read_text()
        assert not [s for s in ("fonts.googleapis", "cdn.", "unpkg.com") if s in text], page


@pytest.mark.parametrize(
    "text",
    ["[lost](no-such-page.md)", "[lost](reference/conventions.md#no-such-heading)", '--8<-- "no_such_example.py"'],
)
def test_lost_links_anchors_and_examples_fail(copy: Path, text: str) -> None:
    with (copy / "docs" / "index.md").open("a") as page:
        page.write(f"\n{text}\n")
    with pytest.raises(Exception, match=r"(?s).*(Aborted|could not be found|no_such)"):
        _build(copy)


def test_pages_outside_of_the_navigation_fail(copy: Path) -> None:
    (copy / "docs" / "orphan.md").write_text("# Nobody links here\n")
    with pytest.raises(Exception, match="Aborted"):
        _build(copy)


def test_public_names_without_docstring_fail(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import muybridge.geometry.ik as package

    monkeypatch.setattr(package.solve_ik, "__doc__", None)
    with pytest.raises(Exception, match="Aborted"):
        _build(copy)
