"""Where the repository is, what git tracks of it, and where real recordings are, if there are any."""

import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED = REPOSITORY.parent / "shared"
DATA = SHARED / "data"


def tracked_files(repository: Path = REPOSITORY) -> list[Path]:
    """The files that git tracks, without links; the test is skipped outside of a git checkout."""
    done = subprocess.run(["git", "ls-files", "-z"], cwd=repository, capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip("not a git checkout")
    paths = (repository / name for name in done.stdout.split("\0") if name)
    return [path for path in paths if path.is_file() and not path.is_symlink()]


def case_file(name: str) -> Path:
    """A file of the cases that once went wrong, such as `c3d_shifted/a.c3d`; the test is skipped where it is absent."""
    path = DATA / "cases" / name
    if not path.is_file():
        pytest.skip(f"../shared/data/cases/{name} is not here")
    return path
