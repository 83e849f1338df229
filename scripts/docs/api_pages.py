"""Markdown of the API reference: one page per package, one entry per name of its `__all__`."""

import importlib
from collections.abc import Sequence

from public_names import public_names

FOLDER = "reference/api"


def page_path(package: str) -> str:
    """The page of a package, relative to the documentation's folder."""
    return f"{FOLDER}/{package}.md"


def index_page(packages: Sequence[str]) -> str:
    """The list of packages with the first line of their docstrings and their names."""
    lines = [
        "# Python API",
        "",
        "These packages are the public interface: their names are kept stable within a minor version. Anything else"
        " is internal and may change at any time. [Use muybridge from Python](../../guides/python.md) is an"
        " introduction.",
        "",
    ]
    for package in packages:
        lines += [f"## [`{package}`]({package}.md) {{ #{package} }}", "", _summary(package), ""]
        names = [f"[`{n.name}`]({package}.md#{n.home})" for n in public_names(package)]
        lines += [", ".join(names) + "." if names else "It exports no names yet.", ""]
    return "\n".join(lines)


def package_page(package: str) -> str:
    """The page of one package: an mkdocstrings block for each of its names."""
    lines = [f"# {package}", "", _summary(package), ""]
    for found in public_names(package):
        options = [f"      heading: {found.name}", f"      toc_label: {found.name}"]
        lines += [f"::: {found.home}", "    options:", *options, ""]
    return "\n".join(lines)


def _summary(package: str) -> str:
    doc = importlib.import_module(package).__doc__ or ""
    return doc.strip().split("\n\n")[0].replace("\n", " ")
