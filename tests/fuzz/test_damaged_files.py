"""Damaged files: every reader says in one line what is wrong, or reads something sound; none crashes or hangs."""

import subprocess
import sys

import pytest

from tests.fuzz.readers import READERS
from tests.fuzz.run import fuzz
from tests.paths import REPOSITORY

MUTANTS = 200
MANY = 6000
# Readers that answer damage with nothing, not with an error; readers of lines of free text refuse less.
_SILENT, _LENIENT = {"stage"}, {"corrections", ".mot", ".sto", ".txt", ".fbx", "character FBX"}


def _skip_without_library(name: str) -> None:
    if name == ".parquet":
        pytest.importorskip("pyarrow", reason="pyarrow (the extra parquet) is not installed")


@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_refused_in_one_line_or_read(tmp_path, name):
    _skip_without_library(name)
    fine, refused = fuzz(name, tmp_path, MUTANTS)
    assert fine + refused == MUTANTS
    if name not in _SILENT:
        assert refused > (MUTANTS // 20 if name in _LENIENT else MUTANTS // 5), "damage must show"


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_many_damaged_files_in_a_process_each(tmp_path, name):
    _skip_without_library(name)
    command = [sys.executable, "-m", "tests.fuzz.run", name, str(tmp_path), str(MANY // len(READERS)), "1"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"exit status {done.returncode}: {done.stderr[-2000:]}"
