"""The public names of packages, for the API pages and for the check that all of them are documented."""

import importlib
import inspect
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class PublicName:
    """One name of a package's `__all__`.

    Attributes:
        package: the package that exports it, such as `muybridge.geometry.calibration`.
        name: as it is exported.
        home: where it is defined, dotted, for static analysis; `package.name` for what has no module of its own.
        documented: whether it has a docstring of its own. Plain values (constants) need none.
    """

    package: str
    name: str
    home: str
    documented: bool


def public_names(package: str) -> list[PublicName]:
    """The names in a package's `__all__`, sorted without regard to case; none where it has no `__all__`.

    Raises:
        ModuleNotFoundError: there is no such package.
        AttributeError: `__all__` lists a name that the package does not have.
    """
    module = importlib.import_module(package)
    names = sorted(getattr(module, "__all__", ()), key=str.lower)
    return [_describe(package, name, getattr(module, name)) for name in names]


def _describe(package: str, name: str, value: object) -> PublicName:
    home, documented = f"{package}.{name}", True
    if inspect.isclass(value) or inspect.isroutine(value):
        home = f"{value.__module__}.{value.__qualname__}"
        documented = bool((value.__doc__ or "").strip()) and not _generated(value)
    elif inspect.ismodule(value):
        home, documented = value.__name__, bool((value.__doc__ or "").strip())
    return PublicName(package, name, home, documented)


def _generated(value: object) -> bool:
    """Whether a docstring is the signature that `dataclass` writes where there is none."""
    return inspect.isclass(value) and (value.__doc__ or "").startswith(f"{value.__name__}(")


def undocumented(packages: Iterable[str]) -> list[str]:
    """Exported names without a docstring, as `package.name`."""
    return [f"{found.package}.{found.name}" for p in packages for found in public_names(p) if not found.documented]
