"""The public names of packages, for the API pages and for the check that all of them are documented."""

import ast
import importlib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Kind = Literal["function", "class", "options", "error", "value"]


@dataclass(frozen=True)
class PublicName:
    """One name of a package's `__all__`.

    Attributes:
        package: the package that exports it, such as `muybridge.geometry.calibration`.
        name: as it is exported.
        home: where it is defined, dotted, for static analysis; `package.name` for what has no module of its own.
        documented: whether it has a docstring of its own. Plain values (constants) need none.
        kind: what it is, for the page's sections.
    """

    package: str
    name: str
    home: str
    documented: bool
    kind: Kind


def public_names(package: str) -> list[PublicName]:
    """The names in a package's `__all__`, sorted without regard to case; none where it has no `__all__`.

    Raises:
        ModuleNotFoundError: there is no such package.
        AttributeError: `__all__` lists a name that the package does not have.
    """
    module = importlib.import_module(package)
    names = sorted((n for n in getattr(module, "__all__", ()) if not n.startswith("__")), key=str.lower)
    stub = _homes_in_stub(package, getattr(module, "__file__", None))
    return [_describe(package, name, getattr(module, name), stub.get(name)) for name in names]


def _homes_in_stub(package: str, file: str | None) -> dict[str, str]:
    """Where the stub of a lazy package says that its names are defined."""
    if file is None or not Path(file).with_suffix(".pyi").is_file():
        return {}
    homes: dict[str, str] = {}
    stub = Path(file).with_suffix(".pyi")
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            module = ".".join(part for part in (above, node.module) if part)
            homes |= {alias.asname or alias.name: f"{module}.{alias.name}" for alias in node.names}
    return homes


def _describe(package: str, name: str, value: object, home: str | None) -> PublicName:
    documented, kind = True, _kind(name, value)
    if inspect.isclass(value) or inspect.isroutine(value):
        home = home or f"{value.__module__}.{value.__qualname__}"
        documented = bool((value.__doc__ or "").strip()) and not _generated(value)
    return PublicName(package, name, home or f"{package}.{name}", documented, kind)


def _kind(name: str, value: object) -> Kind:
    if inspect.isclass(value):
        return "error" if issubclass(value, BaseException) else "options" if name.endswith("Options") else "class"
    return "function" if inspect.isroutine(value) else "value"


def _generated(value: object) -> bool:
    """Whether a docstring is the signature that `dataclass` writes where there is none."""
    return inspect.isclass(value) and (value.__doc__ or "").startswith(f"{value.__name__}(")


def undocumented(packages: Iterable[str]) -> list[str]:
    """Exported names without a docstring, as `package.name`."""
    return [f"{found.package}.{found.name}" for p in packages for found in public_names(p) if not found.documented]
