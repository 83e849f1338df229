"""From a checkpoint to the ONNX file of the network that weights skins, with its metadata."""

import datetime
import pathlib
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.models.characters.weight_network import WeightNet
from muybridge.models.onnx_files.export import outputs_of_both, write_onnx
from muybridge.motion.character.weights.graph import CANDIDATES, FEATURES, NEIGHBOURS
from muybridge.train.characters.examples import load_shards
from muybridge.train.characters.train_weights import HELD_OUT, evaluate, weight_net
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import licence


def publish_skinning(
    checkpoint: pathlib.Path, path: pathlib.Path, examples: pathlib.Path, command: str
) -> dict[str, float]:
    """Write the ONNX file of a checkpoint.

    Args:
        checkpoint: of the training.
        path: of the ONNX file.
        examples: folder of examples.
        command: the command line that trained the network.

    Returns:
        Scores on held-out characters, which the file contains too.
    """
    saved = load_checkpoint(checkpoint)
    net = weight_net(saved)
    scores = evaluate(net, load_shards(examples, HELD_OUT))
    metadata: dict[str, Any] = {
        "muybridge_kind": "skinning", "version": muybridge.__version__, "features": list(FEATURES),
        "config": net.config,
        "input": "features (P, K, F), base (P, K), exists (P, K), parent (P, K), same (P, N, K): see "
                 "muybridge.motion.character.weights.graph",
        "output": "weights (P, K)", "scores": scores, "characters_seen": saved["state"]["images"],
        "seconds_trained": round(saved["state"]["seconds"]), "command": command,
        "date": datetime.date.today().isoformat(), "licence": licence("characters"),
    }  # fmt: skip
    _export(net, path, metadata)
    worst = parity(net, path)
    if worst > 1e-3:
        raise AssertionError(f"{path}: onnxruntime differs from torch by {worst}")
    return scores


def example(points: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Random inputs of the network."""
    rng = np.random.default_rng(seed)
    pairs = points * CANDIDATES
    return {
        "features": rng.normal(0, 1, (points, CANDIDATES, len(FEATURES))).astype(np.float32),
        "base": rng.normal(0, 1, (points, CANDIDATES)).astype(np.float32),
        "exists": (np.arange(CANDIDATES) < rng.integers(1, CANDIDATES + 1, (points, 1))).astype(np.float32),
        "parent": rng.integers(0, CANDIDATES + 1, (points, CANDIDATES)),
        "same": rng.integers(0, pairs + 1, (points, NEIGHBOURS, CANDIDATES)),
    }


def parity(net: WeightNet, path: pathlib.Path) -> float:
    """Largest difference between torch and onnxruntime."""
    ((of_net, of_file),) = outputs_of_both(net, path, example(37, 4))
    return float(np.abs(of_net - of_file).max())


def _export(net: WeightNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    points = torch.export.Dim("points", min=2, max=100_000)
    inputs = {name: torch.from_numpy(a) for name, a in example(41).items()}
    write_onnx(net, path, inputs, ["weights"], ({0: points},) * 5, metadata)
