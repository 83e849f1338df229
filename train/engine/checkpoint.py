"""Checkpoints on disk: tensors, text and plain numbers only, so that opening one never runs code."""

import pathlib
from collections.abc import Mapping
from typing import Any

import torch

from muybridge.errors import ModelError
from muybridge.files import replacing

CHECKPOINT = "checkpoint.pt"
# Entries that every checkpoint has: averaged weights, the network's constructor arguments, step and image counters.
_ENTRIES = ("average", "config", "state")


def save_checkpoint(path: pathlib.Path, content: Mapping[str, Any]) -> None:
    """Write a checkpoint; if the process is killed, the previous one stays.

    Args:
        path: of the file.
        content: tensors, text, numbers, None, and lists, tuples and dictionaries of them; no NumPy scalars.
    """
    with replacing(path) as temporary:
        torch.save(dict(content), temporary)


def load_checkpoint(path: pathlib.Path, device: torch.device | str = "cpu") -> dict[str, Any]:
    """Read a checkpoint without unpickling objects, so that a file from a stranger cannot run code.

    Args:
        path: of the file.
        device: where its tensors go.

    Raises:
        ModelError: there is no such file, it is damaged, or it holds anything but tensors, text and numbers.
    """
    try:
        saved: dict[str, Any] = torch.load(path, map_location=device, weights_only=True)
        missing = [entry for entry in _ENTRIES if entry not in saved]
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such checkpoint; train first with `muybridge train`") from error
    except Exception as error:  # the exceptions of pickle, zip files and torch share no other base class
        raise ModelError(
            f"{path}: not a training checkpoint of muybridge, or a damaged one; only tensors, text and numbers are "
            "loaded, since anything else in it could run code"
        ) from error
    if missing:
        raise ModelError(f"{path}: not a training checkpoint of muybridge: no {', '.join(missing)} in it")
    return saved
