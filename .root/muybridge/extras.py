"""Which optional extra of the package brings a module."""

import importlib.metadata
import importlib.util
import re


def extra_of(module: str) -> str | None:
    """The extra of muybridge that brings a module, by the installed package's own requirements."""
    wanted = module.split(".")[0].lower().replace("_", "-")
    try:
        requirements = importlib.metadata.requires("muybridge") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    for line in requirements:
        found = re.match(r"\s*([\w.-]+).*;.*extra\s*==\s*['\"]([\w.-]+)['\"]", line)
        if found and found[1].lower().replace("_", "-") == wanted:
            return found[2]
    return None
