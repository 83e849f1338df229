"""From a checkpoint to the correction network's ONNX file with its metadata."""

import datetime
import pathlib
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.arrays import Float32Array
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.body import BODY
from muybridge.models.correction.network import JOINT_FEATURES, MARKER_FEATURES, SPANS, SolverNet
from muybridge.models.onnx_files.export import outputs_of_both, write_onnx
from muybridge.train.correction.examples import load_fits
from muybridge.train.correction.train import HELD_OUT, evaluate, solver_net
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import licence

_INPUTS = ("markers", "known", "joints")


def publish_solver(checkpoint: pathlib.Path, path: pathlib.Path, fits: pathlib.Path, command: str) -> dict[str, float]:
    """Write the ONNX file of a checkpoint.

    Args:
        checkpoint: of the training.
        path: of the ONNX file.
        fits: folder of fitted examples.
        command: the command line that trained the network.

    Returns:
        Scores on held-out people, which the file contains too.
    """
    saved = load_checkpoint(checkpoint)
    net = solver_net(saved)
    scores = evaluate(net, load_fits(fits, HELD_OUT))
    metadata: dict[str, Any] = {
        "muybridge_kind": "solver", "version": muybridge.__version__, "names": list(SURFACE.names),
        "joints": list(BODY.joint_names), "spans": list(SPANS), "config": net.config,
        "input": "markers (B, M, F), known (B, M), joints (B, J, 17): see muybridge.models.correction.features",
        "output": "corrections (B, J, 6)", "scores": scores, "frames_seen": saved["state"]["images"],
        "seconds_trained": round(saved["state"]["seconds"]), "command": command,
        "date": datetime.date.today().isoformat(), "licence": licence("markers"),
    }  # fmt: skip
    _export(net, path, metadata)
    worst = parity(net, path)
    if worst > 1e-3:
        raise AssertionError(f"{path}: onnxruntime differs from torch by {worst}")
    return scores


def example(count: int, seed: int = 0) -> tuple[Float32Array, ...]:
    """Random inputs of the network: markers, known ones, joints."""
    rng = np.random.default_rng(seed)
    markers = rng.normal(0, 1, (count, len(SURFACE), MARKER_FEATURES)).astype(np.float32)
    known = (rng.random((count, len(SURFACE))) < 0.6).astype(np.float32)
    return markers, known, rng.normal(0, 1, (count, len(BODY.joint_names), JOINT_FEATURES)).astype(np.float32)


def parity(net: SolverNet, path: pathlib.Path) -> float:
    """Largest difference between torch and onnxruntime."""
    ((of_net, of_file),) = outputs_of_both(net, path, dict(zip(_INPUTS, example(5, 4), strict=True)))
    return float(np.abs(of_net - of_file).max())


def _export(net: SolverNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    batch = torch.export.Dim("batch", min=1, max=65536)
    inputs = {name: torch.from_numpy(a) for name, a in zip(_INPUTS, example(3), strict=True)}
    write_onnx(net, path, inputs, ["corrections"], ({0: batch}, {0: batch}, {0: batch}), metadata)
