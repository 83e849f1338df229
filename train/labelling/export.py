"""From a checkpoint to the labelling network's ONNX file: averaged weights, rigidity of the label pairs, metadata."""

import datetime
import pathlib
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.arrays import Float32Array
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.models.labelling.network import WINDOW, LabelNet
from muybridge.models.onnx_files.export import outputs_of_both, write_onnx
from muybridge.train.engine.checkpoint import load_checkpoint
from muybridge.train.engine.export import licence
from muybridge.train.labelling.train import HELD_OUT, evaluate, held_out_batches, label_net
from muybridge.train.synthesis.markers.trajectories import load_marker_clips

LICENCE = licence("markers")
_INPUTS = ("points", "seen", "asked")


def rigidity(clips: pathlib.Path, most: int = 400) -> dict[str, list[int]]:
    """Distances between the landmarks, whose variation tells which pairs are rigid.

    Args:
        clips: folder of marker trajectories.
        most: number of clips at most.

    Returns:
        Of every pair (upper triangle, row by row), in millimetres: mean distance, its standard deviation within a clip,
            and
        the standard deviation of its mean between bodies.
    """
    points = load_marker_clips(clips, range(HELD_OUT.stop, 100_000)).points
    points = points[:: max(1, len(points) // most), ::6]
    a, b = np.triu_indices(len(SURFACE), 1)
    mean, motion = [], []
    for clip in points:
        distance = np.linalg.norm(clip[:, a] - clip[:, b], axis=-1)
        mean.append(distance.mean(0))
        motion.append(distance.std(0))
    figures = {"distance_mm": np.mean(mean, 0), "motion_mm": np.sqrt(np.mean(np.square(motion), 0)),
               "bodies_mm": np.std(mean, 0)}  # fmt: skip
    return {k: np.rint(v * 1000).astype(int).tolist() for k, v in figures.items()}


def publish_labels(checkpoint: pathlib.Path, path: pathlib.Path, clips: pathlib.Path, command: str) -> dict[str, float]:
    """Write the ONNX file of a checkpoint.

    Args:
        checkpoint: of the training.
        path: of the ONNX file.
        clips: folder of marker trajectories.
        command: the command line that trained the network.

    Returns:
        Scores on held-out clips, which the file contains too.
    """
    saved = load_checkpoint(checkpoint)
    net = label_net(saved)
    scores = evaluate(net, held_out_batches(clips, 16))
    metadata: dict[str, Any] = {
        "muybridge_kind": "labels", "version": muybridge.__version__, "names": list(SURFACE.names),
        "window": list(WINDOW), "neighbours": net.neighbours, "config": net.config, "rigidity": rigidity(clips),
        "input": "points (B, 1+W, N, 3) metres, z up; seen (B, 1+W, N); asked (B, L)",
        "output": "assignment (B, N, L+1), natural logarithm; the last column is the dustbin",
        "scores": scores, "frames_seen": saved["state"]["images"], "seconds_trained": round(saved["state"]["seconds"]),
        "command": command, "date": datetime.date.today().isoformat(), "licence": LICENCE,
    }  # fmt: skip
    _export(net, path, metadata)
    worst = parity(net, path)
    if worst > 1e-3:
        raise AssertionError(f"{path}: onnxruntime differs from torch by {worst}")
    return scores


def example(count: int, points: int, seed: int = 0) -> tuple[Float32Array, ...]:
    """Random inputs of the network: points, known ones, and labels of the marker set."""
    rng = np.random.default_rng(seed)
    at = rng.normal(0, 0.4, (count, 1 + len(WINDOW), points, 3)).astype(np.float32)
    seen = (rng.random((count, 1 + len(WINDOW), points)) < 0.9).astype(np.float32)
    return at, seen, (rng.random((count, len(SURFACE))) < 0.6).astype(np.float32)


def parity(net: LabelNet, path: pathlib.Path) -> float:
    """Largest difference between torch and onnxruntime in the probabilities of a known point."""
    inputs = example(3, 37, 4)
    ((of_net, of_file),) = outputs_of_both(net, path, dict(zip(_INPUTS, inputs, strict=True)))
    known = inputs[1][:, 0] > 0
    return float(np.abs(np.exp(of_net) - np.exp(of_file))[known].max())


def _export(net: LabelNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    batch, points = torch.export.Dim("batch", min=1, max=4096), torch.export.Dim("points", min=16, max=2048)
    inputs = {name: torch.from_numpy(a) for name, a in zip(_INPUTS, example(3, 41), strict=True)}
    shapes = ({0: batch, 2: points}, {0: batch, 2: points}, {0: batch})
    write_onnx(net, path, inputs, ["assignment"], shapes, metadata)
