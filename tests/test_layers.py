"""The folders import each other only as the layers allow, and inference never loads a training library."""

import subprocess
import sys
from pathlib import Path

import pytest

EXTRAS = ("torch", "kornia", "anny", "moderngl", "onnx", "onnxscript")


def test_import_contracts(repository: Path) -> None:
    pytest.importorskip("importlinter", reason="import-linter is in the dev extra")
    code = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run([sys.executable, "-c", code], cwd=repository, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    "module", ["commands.app", "commands.run", "pipelines.videos", "report.page", "results.overlay"]
)
def test_inference_leaves_training_libraries_unloaded(module: str) -> None:
    code = f"import sys, muybridge.infer.{module}\nprint([m for m in {EXTRAS!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
