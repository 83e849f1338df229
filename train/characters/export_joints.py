"""From a checkpoint to the ONNX file of the network that finds joints, with its metadata."""

import datetime
import pathlib
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.arrays import Float32Array
from muybridge.models.characters.rig_network import RigNet
from muybridge.models.onnx_files.export import outputs_of_both, write_onnx
from muybridge.motion.character.rigging.points import POINTS, upright_points
from muybridge.train.characters.bodies import ROLES, load_bodies
from muybridge.train.characters.train_joints import HELD_OUT, evaluate, packed, rig_net
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import licence


def publish_rigger(
    checkpoint: pathlib.Path, path: pathlib.Path, bodies: pathlib.Path, command: str
) -> dict[str, float]:
    """Write the ONNX file of a checkpoint.

    Args:
        checkpoint: of the training.
        path: of the ONNX file.
        bodies: folder of generated bodies.
        command: the command line that trained the network.

    Returns:
        Scores on held-out bodies, which the file contains too.
    """
    saved = load_checkpoint(checkpoint)
    net = rig_net(saved)
    scores = evaluate(net, packed(*load_bodies(bodies, HELD_OUT), None))
    metadata: dict[str, Any] = {
        "muybridge_kind": "rigger", "version": muybridge.__version__, "roles": list(ROLES), "points": POINTS,
        "config": net.config, "input": "points (B, N, 6): see muybridge.motion.character.rigging.points",
        "output": "places (B, J, 3), shares of the height; spread (B, J), logarithm of the expected distance",
        "scores": scores, "bodies_seen": saved["state"]["images"],
        "seconds_trained": round(saved["state"]["seconds"]), "command": command,
        "date": datetime.date.today().isoformat(), "licence": licence("characters"),
    }  # fmt: skip
    _export(net, path, metadata)
    worst = parity(net, path)
    if worst > 1e-3:
        raise AssertionError(f"{path}: onnxruntime differs from torch by {worst}")
    return scores


def example(count: int, seed: int = 0) -> Float32Array:
    """Random inputs of the network: balls."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, POINTS, 3))
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    points = np.concatenate([0.5 * normal, normal], axis=2).astype(np.float32)
    return np.stack([upright_points(p)[0] for p in points])


def parity(net: RigNet, path: pathlib.Path) -> float:
    """Largest difference of the places between torch and onnxruntime, shares of the height."""
    both = outputs_of_both(net, path, {"points": example(2, 4)})
    return max(float(np.abs(a - b).max()) for a, b in both)


def _export(net: RigNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    batch = torch.export.Dim("batch", min=1, max=1024)
    write_onnx(net, path, {"points": torch.from_numpy(example(3))}, ["places", "spread"], ({0: batch},), metadata)
