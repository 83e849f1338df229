"""8-bit versions of exported networks: static quantisation with onnxruntime. Needs onnx (the `train` extra).

Weights become 7-bit integers with a scale for each output channel, activations 8-bit ones with a scale for each
tensor, measured on calibration images. Seven bits, because the kernels of processors without VNNI add pairs of
products in 16 bits, which eight would overflow. The head stays in float32: its output is the result, and it sums and
enlarges what several convolutions say.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from muybridge.arrays import ByteArray, Float32Array
from muybridge.errors import ModelError
from muybridge.files import replacing

# Operators that have 8-bit kernels worth having; the rest stays in float32.
_OPERATORS = ["Conv", "Add", "Resize", "Relu"]
_IMAGES_AT_ONCE = 8
# What onnxruntime says: its default, and less.
_WARNINGS, _ERRORS = 2, 3


def int8_path(path: Path) -> Path:
    """Where the 8-bit version of the network `path` lies: `keypoints.onnx` has `keypoints-int8.onnx` beside it."""
    return path.with_name(f"{path.stem}-int8{path.suffix}")


def quantize(source: Path, target: Path, images: ByteArray) -> None:
    """Write an 8-bit version of a network with the same inputs, outputs and metadata, plus `precision`.

    Args:
        source: float32 ONNX file whose inputs are float images (N, c, H, W) in 0..1.
        target: of the 8-bit file, written whole or not at all.
        images: (K, C, H, W), the inputs' channels one after another, to measure the activations' ranges on; a hundred
            of what is seen in use will do.

    Raises:
        ModelError: `source` has no convolution to quantise, or is no ONNX file.
    """
    import onnx
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    if not len(images):
        raise ValueError("quantisation needs images to calibrate on")
    with _quiet(), tempfile.TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        # Batch normalisations are folded into the convolutions before these lose precision.
        try:
            quant_pre_process(str(source), str(prepared), skip_symbolic_shape=True)
            model = onnx.load(str(prepared))
        except Exception as error:
            raise ModelError(f"{source}: cannot be prepared for quantisation ({error}); export it again") from error
        metadata = {entry.key: entry.value for entry in onnx.load(str(source)).metadata_props}
        with replacing(target) as temporary:
            quantize_static(
                str(prepared), str(temporary), _Images(_channels(model.graph), images),
                quant_format=QuantFormat.QDQ, per_channel=True, reduce_range=True,
                activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8,
                calibrate_method=CalibrationMethod.MinMax, op_types_to_quantize=_OPERATORS,
                nodes_to_exclude=_kept_in_float(model, source),
            )  # fmt: skip
            quantized = onnx.load(str(temporary))
            onnx.helper.set_model_props(quantized, {**metadata, "precision": "int8"})
            for node in quantized.graph.node:
                node.doc_string = ""
            onnx.checker.check_model(quantized)
            onnx.save(quantized, str(temporary))


@contextmanager
def _quiet() -> Iterator[None]:
    """No hints from onnxruntime on how the model might be prepared: it is, and that an input has a default is meant."""
    import onnxruntime

    before = logging.getLogger().level
    logging.getLogger().setLevel(max(before, logging.ERROR))
    onnxruntime.set_default_logger_severity(_ERRORS)
    try:
        yield
    finally:
        logging.getLogger().setLevel(before)
        onnxruntime.set_default_logger_severity(_WARNINGS)


def _kept_in_float(model: object, source: Path) -> list[str]:
    """Names of the convolutions that make an output, of the sums and enlargements between, and of what prepares the
    image."""
    graph = model.graph  # type: ignore[attr-defined]
    makes = {name: node for node in graph.node for name in node.output}
    last: list[str] = []
    results = [output.name for output in graph.output]
    while results:
        node = makes.get(results.pop())
        if node is not None and node.op_type in ("Conv", "Add", "Resize"):
            last.append(node.name)
            results += [] if node.op_type == "Conv" else list(node.input)
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    if not convolutions:
        raise ModelError(f"{source}: has no convolution to quantise; name a convolutional network")
    nodes = list(graph.node)
    before = [node.name for node in nodes[: nodes.index(convolutions[0])]]  # on the image itself
    return [*before, *last]


def _channels(graph: object) -> dict[str, int]:
    """How many channels each input has."""
    inputs = graph.input  # type: ignore[attr-defined]
    return {node.name: node.type.tensor_type.shape.dim[1].dim_value for node in inputs}


class _Images:
    """Calibration images, a few at a time; onnxruntime asks for `get_next` until it gives None."""

    def __init__(self, channels: dict[str, int], images: ByteArray) -> None:
        parts = np.split(images, np.cumsum(list(channels.values()))[:-1], axis=1)
        self._parts: Iterator[dict[str, Float32Array]] = (
            {name: np.multiply(part[start : start + _IMAGES_AT_ONCE], np.float32(1 / 255), dtype=np.float32)
             for name, part in zip(channels, parts, strict=True)}
            for start in range(0, len(images), _IMAGES_AT_ONCE)
        )  # fmt: skip

    def get_next(self) -> dict[str, Float32Array] | None:
        """The next input of the network."""
        return next(self._parts, None)
