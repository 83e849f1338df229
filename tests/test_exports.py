"""What packages export: every name resolves and is documented, and none hides a submodule."""

import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import muybridge

ROOT = Path(muybridge.__file__).parent


def _lazy_packages() -> list[str]:
    """Packages with a stub of their exports, by their dotted names."""
    found = ["muybridge"]
    for module in pkgutil.walk_packages([str(ROOT)], "muybridge.", onerror=lambda _: None):
        folder = ROOT.joinpath(*module.name.split(".")[1:])
        if module.ispkg and (folder / "__init__.pyi").is_file():
            found.append(module.name)
    return found


@pytest.mark.parametrize("name", _lazy_packages())
def test_every_export_resolves_and_is_documented(name: str) -> None:
    try:
        package = importlib.import_module(name)
        exported = {export: getattr(package, export) for export in package.__all__}
    except ImportError as error:
        pytest.skip(f"an extra is missing: {error}")
    assert len(set(package.__all__)) == len(package.__all__)
    for export, value in exported.items():
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__module__.startswith("muybridge."), export
            assert inspect.getdoc(value), export
            # A dataclass without a docstring gets its signature as one.
            assert not (value.__doc__ or "").startswith(f"{export}("), export


@pytest.mark.parametrize("name", _lazy_packages())
def test_no_export_has_the_name_of_a_submodule(name: str) -> None:
    package = importlib.import_module(name)
    folders = [str(path) for path in package.__path__]
    submodules = {module.name for module in pkgutil.iter_modules(folders)}
    assert not submodules & set(package.__all__)


def test_importing_a_package_does_not_load_its_modules() -> None:
    """Checked in a process of its own, since other tests load these modules."""
    code = "import sys, muybridge.geometry.calibration; print('cv2' in sys.modules, 'pycolmap' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
