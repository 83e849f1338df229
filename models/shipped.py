"""The networks that come with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal

from muybridge.errors import ModelError

ModelKind = Literal["keypoints", "people", "labels", "solver"]
Precision = Literal["int8", "fp32"]
_KINDS: tuple[ModelKind, ...] = ("keypoints", "people", "labels", "solver")


def shipped_model(kind: ModelKind, precision: Precision = "fp32") -> Path:
    """Path of the weights that came with the package.

    Args:
        kind: what the network is for.
        precision: `int8` is three times as fast, to be had of the keypoint network alone.

    Raises:
        ModelError: the installation has none.
    """
    if kind not in _KINDS:
        raise ValueError(f"no model of kind {kind!r}; known: {', '.join(_KINDS)}")
    file = f"{kind}-int8.onnx" if precision == "int8" else f"{kind}.onnx"
    path = Path(str(resources.files("muybridge.models"))) / "weights" / file
    if not path.is_file():
        raise ModelError(
            f"{path}: the shipped {kind} model is missing; reinstall muybridge, or name a model file of yours"
        )
    return path
