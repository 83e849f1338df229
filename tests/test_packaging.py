"""The wheel holds every package and every data file, and the tracked texts name no machine."""

import importlib.util
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.paths import tracked_files

TOP_FOLDERS = ("models", "train", "infer", "geometry", "motion")


def _setuptools_table(repository: Path) -> dict[str, object]:
    return tomllib.loads((repository / "pyproject.toml").read_text())["tool"]["setuptools"]


def _folders_with_modules(repository: Path) -> set[str]:
    """Dotted package names of all folders below the top ones that hold Python files."""
    return {
        ".".join(("muybridge", *path.parent.relative_to(repository).parts))
        for top in TOP_FOLDERS
        for path in (repository / top).rglob("*.py")
    }


def test_every_folder_is_a_named_package(repository: Path) -> None:
    named = set(_setuptools_table(repository)["packages"])  # type: ignore[call-overload]
    root = repository / ".root" / "muybridge"
    ours = {f"muybridge.{p.name}" for p in root.iterdir() if p.is_dir() and not p.is_symlink() and any(p.glob("*.py"))}
    assert _folders_with_modules(repository) | {"muybridge"} | ours == named


def test_every_package_has_an_init(repository: Path) -> None:
    for package in _folders_with_modules(repository):
        folder = repository.joinpath(*package.split(".")[1:])
        assert (folder / "__init__.py").is_file(), f"{folder.name} would be a namespace package"


def test_every_folder_is_linked_for_type_checkers(repository: Path) -> None:
    for top in TOP_FOLDERS:
        link = repository / ".root" / "muybridge" / top
        assert link.is_symlink() and not link.readlink().is_absolute()
        assert link.resolve() == (repository / top).resolve()


def test_constraints_pin_torch_and_every_dependency(repository: Path) -> None:
    pins = dict(re.findall(r"^([A-Za-z0-9_.-]+)==(\S+)$", (repository / "constraints.txt").read_text(), re.M))
    assert pins["torch"] == "2.13.0"
    assert not [v for v in pins.values() if "+" in v], "a local version exists on one index only"
    normalised = {name.lower().replace("_", "-") for name in pins}
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *sum(project["optional-dependencies"].values(), [])]
    names = {re.split(r"[<>=!~\[; ]", requirement, maxsplit=1)[0].lower() for requirement in wanted}
    assert names <= normalised, f"not in constraints.txt: {sorted(names - normalised)}"


# A home or work folder of one machine; a link to a package index; each with what may precede it.
FORBIDDEN = re.compile(
    r"(?<![\w.\-])/(?:home|root|work|Users)/\w|pypi\.org/simple|files\.pythonhosted|--(?:extra-)?index-url"
)


def test_texts_name_no_machine_and_no_registry(repository: Path) -> None:
    offences = []
    for path in tracked_files(repository):
        if path.is_symlink() or not path.is_file() or path == Path(__file__).resolve():
            continue
        data = path.read_bytes()
        if b"\0" in data:
            continue
        for number, line in enumerate(data.decode("utf-8").splitlines(), 1):
            if FORBIDDEN.search(line):
                offences.append(f"{path.relative_to(repository)}:{number}: {line.strip()[:100]}")
    assert not offences, "\n".join(offences)


@pytest.mark.slow
def test_wheel_holds_every_module_and_asset(repository: Path, tmp_path: Path) -> None:
    if importlib.util.find_spec("build") is None:
        pytest.skip("build is in the dev extra")
    # From a clean copy of what is tracked, so that a stale build folder can neither help nor hurt.
    copy = tmp_path / "checkout"
    subprocess.run(["git", "clone", "--quiet", str(repository), str(copy)], check=True)
    done = subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", str(tmp_path / "dist"), str(copy)],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    wanted = {
        f"muybridge/{path.relative_to(copy)}"
        for top in TOP_FOLDERS
        for path in (copy / top).rglob("*")
        if path.is_file()
    }
    assert wanted <= held, f"missing from the wheel: {sorted(wanted - held)}"
    assert not {name.split("/")[0] for name in held} - {"muybridge", f"muybridge-{_version()}.dist-info"}


def _version() -> str:
    import muybridge

    return muybridge.__version__
