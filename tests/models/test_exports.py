"""Packages of networks export their public names without importing torch until one is needed."""

import importlib
import subprocess
import sys

import pytest

PACKAGES = ("models", "models.keypoints", "models.people", "models.labelling", "models.correction", "models.onnx_files")
TRAINING_PACKAGES = (
    "engine", "images", "keypoints", "people", "labelling", "correction", "synthesis", "synthesis.bodies",
    "synthesis.clothing", "synthesis.markers", "synthesis.rendering",
)  # fmt: skip


@pytest.mark.parametrize("package", [*PACKAGES, *(f"train.{name}" for name in TRAINING_PACKAGES)])
def test_importing_a_package_loads_no_training_library(package: str) -> None:
    libraries = "('torch', 'kornia', 'onnx', 'anny')"
    code = f"import sys, muybridge.{package}; print([name for name in {libraries} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("package", [*PACKAGES, *(f"train.{name}" for name in TRAINING_PACKAGES)])
def test_every_exported_name_exists(package: str) -> None:
    for name in ("torch", "onnx", "kornia", "anny", "moderngl"):
        pytest.importorskip(name)
    module = importlib.import_module(f"muybridge.{package}")
    assert module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None


@pytest.mark.parametrize("network", ["keypoints", "people", "labelling", "correction"])
def test_training_options_load_no_training_library(network: str) -> None:
    code = f"import sys, muybridge.train.{network}.options, muybridge.train.commands; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "False"
