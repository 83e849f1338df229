"""MkDocs hooks: the generated parts of the reference, and what must be documented before a build passes.

The pages under `reference/cli` come from the commands' own parsers, those under `reference/api` from the packages'
`__all__`; both are made at build time and never stored. A public name without a docstring fails a strict build.
"""

import logging
import sys
from pathlib import Path
from typing import Any

import api_pages
import command_pages
import public_names
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[2]
log = logging.getLogger("mkdocs.hooks.muybridge")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the generated pages where the navigation names their folders."""
    # Here and not above: MkDocs restores the path after it has loaded the hooks.
    if str(ROOT / ".root") not in sys.path:
        sys.path.insert(0, str(ROOT / ".root"))  # this tree, whatever is installed
    commands = command_pages.registered(ROOT / "pyproject.toml")
    generated: dict[str, list[Any]] = {
        f"{command_pages.FOLDER}/": [
            f"{command_pages.FOLDER}/index.md",
            *({name: command_pages.page_path(name)} for name in commands),
        ],
        f"{api_pages.FOLDER}/": [
            f"{api_pages.FOLDER}/index.md",
            *({package: api_pages.page_path(package)} for package in config.extra["api_packages"]),
        ],
    }
    config.nav = _filled(config.nav, generated)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    packages: list[str] = config.extra["api_packages"]
    for name in public_names.undocumented(packages):
        log.warning("%s is public and has no docstring", name)
    commands = command_pages.registered(ROOT / "pyproject.toml")
    pages = {f"{command_pages.FOLDER}/index.md": command_pages.index_page(commands)}
    pages |= {command_pages.page_path(n): command_pages.command_page(n, target) for n, target in commands.items()}
    pages |= {f"{api_pages.FOLDER}/index.md": api_pages.index_page(packages)}
    pages |= api_pages.package_pages(packages)
    for path, content in pages.items():
        files.append(File.generated(config, path, content=content))
    return files


def _filled(nav: Any, generated: dict[str, list[Any]]) -> Any:
    """The navigation with each folder's name replaced by the pages made for it."""
    if isinstance(nav, list):
        return [_filled(item, generated) for item in nav]
    if isinstance(nav, dict):
        return {title: _filled(item, generated) for title, item in nav.items()}
    return generated.get(nav, nav)
