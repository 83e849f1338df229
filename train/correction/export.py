"""From a checkpoint to the solver network's ONNX file with its metadata."""

import datetime
import json
import logging
import pathlib
import warnings
from typing import Any

import numpy as np
import torch

import muybridge
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.body import BODY
from muybridge.models.correction.network import JOINT_FEATURES, MARKER_FEATURES, SPANS, SolverNet
from muybridge.models.onnx_files.export import OPSET
from muybridge.train.correction.examples import load_fits
from muybridge.train.correction.train import HELD_OUT, evaluate, trained_network
from muybridge.train.labelling.export import LICENCE

_INPUTS = ("markers", "known", "joints")


def publish_solver(checkpoint: pathlib.Path, path: pathlib.Path, fits: pathlib.Path, command: str) -> dict[str, float]:
    """Writes the ONNX file of a checkpoint; returns its scores on held-out people, which the file tells too."""
    net = trained_network(checkpoint)
    saved: dict[str, Any] = torch.load(checkpoint, map_location="cpu", weights_only=False)
    scores = evaluate(net, load_fits(fits, HELD_OUT))
    metadata: dict[str, Any] = {
        "muybridge_kind": "solver", "version": muybridge.__version__, "names": list(SURFACE.names),
        "joints": list(BODY.joint_names), "spans": list(SPANS), "config": net.config,
        "input": "markers (B, M, F), known (B, M), joints (B, J, 17): see geometry.solver_features",
        "output": "corrections (B, J, 6)", "scores": scores, "frames_seen": saved["state"]["images"],
        "seconds_trained": round(saved["state"]["seconds"]), "command": command,
        "date": datetime.date.today().isoformat(), "licence": LICENCE,
    }  # fmt: skip
    _export(net, path, metadata)
    worst = parity(net, path)
    if worst > 1e-3:
        raise AssertionError(f"{path}: onnxruntime differs from torch by {worst}")
    return scores


def example(count: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Random inputs of the network."""
    rng = np.random.default_rng(seed)
    markers = rng.normal(0, 1, (count, len(SURFACE), MARKER_FEATURES)).astype(np.float32)
    known = (rng.random((count, len(SURFACE))) < 0.6).astype(np.float32)
    return markers, known, rng.normal(0, 1, (count, len(BODY.joint_names), JOINT_FEATURES)).astype(np.float32)


def parity(net: SolverNet, path: pathlib.Path) -> float:
    """Largest difference between torch and onnxruntime."""
    import onnxruntime

    inputs = example(5, 4)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    there = session.run(None, dict(zip(_INPUTS, inputs, strict=True)))[0]
    with torch.inference_mode():
        here = net(*(torch.from_numpy(a) for a in inputs)).numpy()
    return float(np.abs(here - there).max())


def _export(net: SolverNet, path: pathlib.Path, metadata: dict[str, Any]) -> None:
    import onnx

    batch = torch.export.Dim("batch", min=1, max=65536)
    with replacing(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.getLogger("torch.onnx").setLevel(logging.ERROR)
        torch.onnx.export(
            net, tuple(torch.from_numpy(a) for a in example(3)), str(temporary), input_names=list(_INPUTS),
            output_names=["corrections"], dynamic_shapes=({0: batch}, {0: batch}, {0: batch}), opset_version=OPSET,
            dynamo=True, verbose=False, external_data=False,
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
