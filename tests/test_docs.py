"""Links between the documents lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TOP = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
DOCUMENTS = [*TOP, *sorted((ROOT / "docs").rglob("*.md"))]
# Made when the site is built, which also checks the links to them.
GENERATED = [ROOT / "docs" / "reference" / name for name in ("cli", "api")]
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?```", re.DOTALL)


def anchors(document: Path) -> set[str]:
    """Of its headings: those given, and those that GitHub and MkDocs make of the titles."""
    found = set()
    for line in CODE.sub("", document.read_text()).splitlines():
        if line.startswith("#"):
            found.update(re.findall(r"\{[^}]*#([\w-]+)[^}]*\}", line))
            title = re.sub(r"\{.*\}", "", line.lstrip("#")).strip().lower()
            title = re.sub(r"[^\w\- ]", "", title)
            found.update((title.replace(" ", "-"), re.sub(r"[-\s]+", "-", title)))
    return found


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files_and_headings_that_are_there(document):
    lost = []
    for link in LINK.findall(CODE.sub("", document.read_text())):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        there = (document.parent / name).resolve() if name else document
        if any(there.is_relative_to(folder) for folder in GENERATED):
            continue
        if not there.exists() or (anchor and anchor not in anchors(there)):
            lost.append(link)
    assert not lost
