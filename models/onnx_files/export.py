"""Export networks to ONNX files that describe themselves. Needs torch and onnx (the `train` extra)."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from muybridge.arrays import Float32Array
from muybridge.files import replacing

OPSET = 18


def write_onnx(
    net: nn.Module, path: Path, inputs: Mapping[str, Tensor], outputs: Sequence[str], dynamic_shapes: Sequence[Any],
    metadata: Mapping[str, Any], edit: Callable[[Any], None] | None = None,
) -> None:  # fmt: skip
    """Write a network and its metadata to an ONNX file.

    Args:
        net: the network, in evaluation mode.
        path: of the file; it appears only when it is complete.
        inputs: names and example values of the network's inputs, in order.
        outputs: names of its outputs.
        dynamic_shapes: of each input, which axes vary: see `torch.export.Dim`.
        metadata: the file's description; values other than text are written as JSON.
        edit: called with the ONNX graph, to change it.
    """
    import onnx

    with replacing(path) as temporary:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            logging.getLogger("torch.onnx").setLevel(logging.ERROR)
            torch.onnx.export(
                net, tuple(inputs.values()), str(temporary), input_names=list(inputs), output_names=list(outputs),
                dynamic_shapes=tuple(dynamic_shapes), opset_version=OPSET, dynamo=True, verbose=False,
                external_data=False,
            )  # fmt: skip
        model = onnx.load(str(temporary))
        del model.metadata_props[:]
        for node in model.graph.node:  # the exporter records source lines with paths of this machine
            del node.metadata_props[:]
            node.doc_string = ""
        if edit is not None:
            edit(model.graph)
        for key, value in metadata.items():
            model.metadata_props.add(key=key, value=value if isinstance(value, str) else json.dumps(value))
        onnx.checker.check_model(model)
        onnx.save(model, str(temporary))


def export_onnx(
    net: nn.Module,
    path: Path,
    example: tuple[int, int, int, int],
    outputs: tuple[str, ...],
    metadata: Mapping[str, Any],
    optional: str | None = None,
) -> None:
    """Write an image network and its metadata; batch size, height and width stay variable.

    Args:
        net: takes one image tensor (N, C, H, W), float32 in 0..1; with `optional` a second one of one channel.
        path: of the file; it appears only when it is complete.
        example: shape of an example input; H and W divisible by 32.
        outputs: names of the network's outputs.
        metadata: the file's description; values other than text are written as JSON.
        optional: name of a second input (N, 1, H, W) that may be left out when the file is run; it is zero then.
    """
    # Height and width are multiples of 32, which the exporter cannot infer.
    height, width = torch.export.Dim("rows", min=1, max=64), torch.export.Dim("columns", min=1, max=64)
    shape = {0: torch.export.Dim("batch", min=1, max=4096), 2: 32 * height, 3: 32 * width}
    names = ["image", *([optional] if optional else [])]
    examples = {n: torch.rand(example[0], c, *example[2:]) for n, c in zip(names, (example[1], 1), strict=False)}
    edit = None if optional is None else lambda graph: _default_to_zero(graph, optional)
    write_onnx(net.cpu().float().eval(), path, examples, outputs, (shape,) * len(names), metadata, edit)


def _default_to_zero(graph: Any, name: str) -> None:
    """Give an input of an ONNX graph a default value: one zero, expanded to the size of the first input.

    The input's sizes get names of their own, since the zero is smaller than the image.
    """
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


def outputs_of_both(
    net: nn.Module, path: Path, inputs: Mapping[str, Float32Array]
) -> list[tuple[NDArray[Any], NDArray[Any]]]:
    """Each output as computed by `net` in torch and by its file in onnxruntime.

    Args:
        net: the network, in evaluation mode.
        path: of its ONNX file.
        inputs: names and values of the inputs, in order.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    of_file = session.run(None, dict(inputs))
    with torch.inference_mode():
        of_net = net(*(torch.from_numpy(value) for value in inputs.values()))
    of_net = (of_net,) if isinstance(of_net, Tensor) else of_net
    return [(a.numpy(), b) for a, b in zip(of_net, of_file, strict=True)]


def parity(net: nn.Module, path: Path, shape: tuple[int, int, int, int]) -> float:
    """Largest difference of any output between `net` in torch and its file in onnxruntime, on random images."""
    image = np.random.default_rng(0).random(shape, np.float32)
    both = outputs_of_both(net.cpu().float().eval(), path, {"image": image})
    return max(float(np.abs(a - b).max()) for a, b in both)
