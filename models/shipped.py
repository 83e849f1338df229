"""The networks that come with the package."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Literal

from muybridge.errors import ModelError

ModelKind = Literal["keypoints", "people", "labels", "solver", "skinning", "rigger"]
Precision = Literal["int8", "fp32"]
_KINDS: tuple[ModelKind, ...] = ("keypoints", "people", "labels", "solver", "skinning", "rigger")


def shipped_model(kind: ModelKind, precision: Precision = "fp32") -> Path:
    """Path of the weights that come with the package.

    Args:
        kind: what the network is for.
        precision: `int8` is three times as fast, and available only for the keypoint network.

    Raises:
        ModelError: the installation does not contain it.
        ValueError: there is no such kind.
    """
    if kind not in _KINDS:
        raise ValueError(f"no model of kind {kind!r}; known: {', '.join(_KINDS)}")
    file = f"{kind}-int8.onnx" if precision == "int8" else f"{kind}.onnx"
    path = Path(str(resources.files("muybridge.models"))) / "weights" / file
    if not path.is_file():
        raise ModelError(f"{path}: the shipped {kind} model is missing", remedy="missing_weights")
    return path
