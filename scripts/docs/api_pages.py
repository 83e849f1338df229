"""Markdown of the API reference: one page per package, one entry per name of its `__all__`."""

import importlib
from collections.abc import Sequence

from public_names import PublicName, public_names

FOLDER = "reference/api"
_SECTIONS = {"function": "Functions", "class": "Classes", "options": "Options", "error": "Errors", "value": "Values"}


def page_path(package: str) -> str:
    """The page of a package, relative to the documentation's folder."""
    return f"{FOLDER}/{package}.md"


def index_page(packages: Sequence[str]) -> str:
    """The list of packages with the first line of their docstrings and their names."""
    lines = [
        "# Python API",
        "",
        "The public names of the packages below; [what is stable](../api-policy.md). An introduction with examples:"
        " [Use muybridge from Python](../../guides/python.md).",
        "",
    ]
    shown: dict[str, str] = {}
    for package in packages:
        lines += [f"## [`{package}`]({package}.md) {{ #{package} }}", "", _summary(package), ""]
        names = []
        for found in public_names(package):
            page = shown.setdefault(found.home, package)
            names.append(f"[`{found.name}`]({page}.md#{found.home})")
        lines += [", ".join(names) + "." if names else "It exports no names yet.", ""]
    return "\n".join(lines)


def package_pages(packages: Sequence[str]) -> dict[str, str]:
    """The pages of all packages by path. A name that several export is documented by the first that has it."""
    pages: dict[str, str] = {}
    shown: dict[str, str] = {}
    for package in packages:
        names = public_names(package)
        own = [found for found in names if found.home not in shown]
        pages[page_path(package)] = _package_page(package, own, [n for n in names if n.home in shown], shown)
        shown |= {found.home: package for found in own}
    return pages


def _package_page(package: str, own: list[PublicName], others: list[PublicName], shown: dict[str, str]) -> str:
    lines = [f"# {package}", "", _summary(package), ""]
    for kind, title in _SECTIONS.items():
        chosen = [found for found in own if found.kind == kind]
        lines += [f"## {title}", ""] if chosen else []
        for found in chosen:
            options = [f"      heading: {found.name}", f"      toc_label: {found.name}", "      heading_level: 3"]
            lines += [f"::: {found.home}", "    options:", *options, ""]
    if others:
        links = [f"[`{n.name}`]({shown[n.home]}.md#{n.home})" for n in others]
        lines += ["## Documented elsewhere", "", ", ".join(links) + ".", ""]
    return "\n".join(lines)


def _summary(package: str) -> str:
    doc = importlib.import_module(package).__doc__ or ""
    return doc.strip().split("\n\n")[0].replace("\n", " ")
