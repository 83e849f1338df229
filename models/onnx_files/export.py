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
    optional: str | None = None,
) -> None:
    """Writes `net` with its metadata; batch, height and width stay free.

    Args:
        net: takes one image tensor (N, C, H, W), float32 in 0..1; with `optional` a second one of one channel.
        path: of the file, written whole or not at all.
        example: shape of an example input; H and W divisible by 32.
        outputs: names of the network's outputs.
        metadata: what the file says about itself; values that are no text are written as JSON.
        optional: name of a second input (N, 1, H, W), which whoever runs the file may leave out: then it is zero.
    """
    import onnx

    net = net.cpu().float().eval()
    # Height and width are multiples of 32 by their meaning, which the exporter has to be told.
    height, width = torch.export.Dim("rows", min=1, max=64), torch.export.Dim("columns", min=1, max=64)
    shape = {0: torch.export.Dim("batch", min=1, max=4096), 2: 32 * height, 3: 32 * width}
    names = ["image", *([optional] if optional else [])]
    examples = tuple(torch.rand(example[0], c, *example[2:]) for c in (example[1], 1)[: len(names)])
    with replacing(path) as temporary:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("torch.onnx").setLevel(logging.ERROR)
            torch.onnx.export(
                net, examples, str(temporary), input_names=names, output_names=list(outputs),
                dynamic_shapes=(shape,) * len(names), opset_version=OPSET, dynamo=True, verbose=False,
                external_data=False,
            )  # fmt: skip
        model = onnx.load(str(temporary))
        del model.metadata_props[:]
        for node in model.graph.node:  # the exporter notes each node's source line, which is nobody's business
            del node.metadata_props[:]
            node.doc_string = ""
        if optional:
            _default_to_zero(model.graph, optional)
        for key, value in metadata.items():
            model.metadata_props.add(key=key, value=value if isinstance(value, str) else json.dumps(value))
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))


def _default_to_zero(graph: Any, name: str) -> None:
    """Gives an input of an ONNX graph a value for when it is left out: one zero, which is spread over the first input.
    Its sizes get names of their own, since that zero is smaller than the image."""
    from onnx import helper, numpy_helper

    found = next(node for node in graph.input if node.name == name)
    for axis in (0, 2, 3):
        found.type.tensor_type.shape.dim[axis].dim_param = f"{name}_{axis}"
    graph.initializer.append(numpy_helper.from_array(np.zeros((1, 1, 1, 1), np.float32), name))
    graph.initializer.append(numpy_helper.from_array(np.ones(1, np.int64), f"{name}_channels"))
    batch, size, shape, spread = (f"{name}_{part}" for part in ("batch", "size", "shape", "spread"))
    for node in graph.node:
        node.input[:] = [spread if value == name else value for value in node.input]
    image = graph.input[0].name
    for node in (
        helper.make_node("Expand", [name, shape], [spread], spread),
        helper.make_node("Concat", [batch, f"{name}_channels", size], [shape], shape, axis=0),
        helper.make_node("Shape", [image], [size], size, start=2, end=4),
        helper.make_node("Shape", [image], [batch], batch, start=0, end=1),
    ):
        graph.node.insert(0, node)


def parity(net: nn.Module, path: Path, shape: tuple[int, int, int, int]) -> float:
    """Largest difference of any output between `net` in torch and the file in onnxruntime, on random images."""
    import onnxruntime

    image = np.random.default_rng(0).random(shape, np.float32)
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    there = session.run(None, {"image": image})
    with torch.inference_mode():
        here = net.cpu().float().eval()(torch.from_numpy(image))
    return max(float(np.abs(a.numpy() - b).max()) for a, b in zip(here, there, strict=True))
