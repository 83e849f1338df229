"""onnxruntime sessions: opened on the wished device, with errors that name the file."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import onnxruntime

from muybridge.errors import ModelError
from muybridge.models.onnx_files.prune_outputs import without_outputs

Device = Literal["cpu", "auto", "cuda", "directml", "coreml"]
# onnxruntime's providers, the first that is there being the one of `auto`.
PROVIDERS = {
    "cuda": "CUDAExecutionProvider",
    "directml": "DmlExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
# Packages in which onnxruntime has them.
_PACKAGES = {"cuda": "onnxruntime-gpu", "directml": "onnxruntime-directml", "coreml": "onnxruntime on a Mac"}
_CPU = "CPUExecutionProvider"
_opening = threading.Lock()
_ONLY_ERRORS = 4  # onnxruntime's "fatal": a damaged file is reported by us, in one line
REMEDY = "name a model that muybridge exported, or leave the option out to use the shipped one"


def providers(device: Device, available: Sequence[str] | None = None) -> list[str]:
    """The providers that a session is opened with, the wished one first and the processor last.

    Args:
        device: `cpu`, a kind of graphics card, or `auto` for the first kind that is there, else the processor.
        available: names of providers; by default those of the installed onnxruntime.

    Raises:
        ModelError: the installed onnxruntime does not have the device's provider.
    """
    there = onnxruntime.get_available_providers() if available is None else available
    if device == "cpu":
        return [_CPU]
    if device == "auto":
        return [*[name for name in PROVIDERS.values() if name in there][:1], _CPU]
    if PROVIDERS[device] not in there:
        raise ModelError(
            f"device {device}: the installed onnxruntime has no {PROVIDERS[device]}; it is in {_PACKAGES[device]}, "
            "which is installed instead of onnxruntime"
        )
    return [PROVIDERS[device], _CPU]


def open_session(
    path: Path, threads: int = 1, device: Device = "cpu", unwanted: Sequence[str] = ()
) -> onnxruntime.InferenceSession:
    """A session that does not compute the `unwanted` outputs; the same for equal arguments, since threads may share
    one and opening it takes time.

    Args:
        path: of the network's file.
        threads: within one call.
        device: that it runs on.
        unwanted: names of outputs.

    Raises:
        ModelError: the file is missing, damaged or no ONNX model, or the device is not there.
    """
    if not path.is_file():
        raise ModelError(f"{path}: no such model file; {REMEDY}")
    about = path.stat()
    with _opening:
        return _open(path, (about.st_mtime_ns, about.st_size), threads, device, tuple(unwanted))


@lru_cache(maxsize=4)
def _open(
    path: Path, version: tuple[int, int], threads: int, device: Device, unwanted: tuple[str, ...]
) -> onnxruntime.InferenceSession:
    """See `open_session`; `version` tells a file from one that was there before."""
    wished = providers(device)
    settings = onnxruntime.SessionOptions()
    settings.intra_op_num_threads = threads
    settings.inter_op_num_threads = 1
    settings.log_severity_level = _ONLY_ERRORS
    try:
        with path.open("rb") as file:
            data = file.read() if unwanted else b""
    except OSError as error:
        raise ModelError(f"{path}: the model file cannot be read ({error.strerror}); {REMEDY}") from error
    try:
        # By its path where it is used as it is: weights may be in a file beside it.
        wanted = without_outputs(data, unwanted) if unwanted else str(path)
        session = onnxruntime.InferenceSession(wanted, settings, providers=wished)
    except Exception as error:  # onnxruntime's exceptions share no base but Exception
        raise ModelError(
            f"{path}: not an ONNX model, or a damaged one ({str(error).splitlines()[0]}); {REMEDY}"
        ) from error
    # onnxruntime goes on with the processor where a card's libraries cannot be loaded.
    if device in PROVIDERS and wished[0] not in session.get_providers():
        raise ModelError(
            f"device {device}: onnxruntime could not start {wished[0]}; check the card's drivers and libraries, or "
            "take the device auto, which falls back to the processor"
        )
    return session
