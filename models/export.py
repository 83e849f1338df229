"""Networks to ONNX files that say what they are. Needs torch and onnx (the `train` extra)."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from muybridge.files import replacing

OPSET = 18


def export_onnx(
    net: nn.Module,
    path: Path,
    example: tuple[int, int, int, int],
    outputs: tuple[str, ...],
    metadata: Mapping[str, Any],
) -> None:
    """Writes `net` with its metadata; batch, height and width stay free.

    Args:
        net: takes one image tensor (N, C, H, W), float32 in 0..1.
        path: of the file, written whole or not at all.
        example: shape of an example input; H and W divisible by 32.
        outputs: names of the network's outputs.
        metadata: what the file says about itself; values that are no text are written as JSON.
    """
    import onnx

    net = net.cpu().float().eval()
    # Height and width are multiples of 32 by their meaning, which the exporter has to be told.
    height, width = torch.export.Dim("rows", min=1, max=64), torch.export.Dim("columns", min=1, max=64)
    shapes = ({0: torch.export.Dim("batch", min=1, max=4096), 2: 32 * height, 3: 32 * width},)
    with replacing(path) as temporary:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("torch.onnx").setLevel(logging.ERROR)
            torch.onnx.export(
                net, (torch.rand(example),), str(temporary), input_names=["image"], output_names=list(outputs),
                dynamic_shapes=shapes, opset_version=OPSET, dynamo=True, verbose=False, external_data=False,
            )  # fmt: skip
        model = onnx.load(str(temporary))
        del model.metadata_props[:]
        for node in model.graph.node:  # the exporter notes each node's source line, which is nobody's business
            del node.metadata_props[:]
            node.doc_string = ""
        for key, value in metadata.items():
            model.metadata_props.add(key=key, value=value if isinstance(value, str) else json.dumps(value))
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))


def parity(net: nn.Module, path: Path, shape: tuple[int, int, int, int]) -> float:
    """Largest difference of any output between `net` in torch and the file in onnxruntime, on random images."""
    import onnxruntime

    image = np.random.default_rng(0).random(shape, np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    there = session.run(None, {"image": image})
    with torch.inference_mode():
        here = net.cpu().float().eval()(torch.from_numpy(image))
    return max(float(np.abs(a.numpy() - b).max()) for a, b in zip(here, there, strict=True))
