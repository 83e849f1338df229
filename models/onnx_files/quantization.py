"""8-bit versions of exported networks: static quantisation with onnxruntime. Needs onnx (the `train` extra).

Weights become 7-bit integers with a scale per output channel, activations 8-bit ones with a scale per tensor, measured
on calibration images. Seven bits, because the kernels of processors without VNNI add pairs of products in 16 bits,
which eight would overflow. The head stays in float32: its output is the result, and it sums and upsamples the outputs
of several convolutions.
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

# Operators whose 8-bit kernels are worthwhile; all others stay in float32.
_OPERATORS = ["Conv", "Add", "Resize", "Relu"]
_IMAGES_AT_ONCE = 8
# onnxruntime's log levels: its default, and errors only.
_WARNINGS, _ERRORS = 2, 3


def int8_path(path: Path) -> Path:
    """Path of the 8-bit version of a network: beside `keypoints.onnx`, `keypoints-int8.onnx`."""
    return path.with_name(f"{path.stem}-int8{path.suffix}")


def quantize(source: Path, target: Path, images: ByteArray) -> None:
    """Write an 8-bit version of a network with the same inputs, outputs and metadata, plus `precision`.

    Args:
        source: float32 ONNX file whose inputs are float images (N, c, H, W) in 0..1.
        target: of the 8-bit file; it appears only when it is complete.
        images: (K, C, H, W), the channels of all inputs in order, to measure activation ranges on; a hundred images
            like those in use suffice.

    Raises:
        ModelError: `source` has no convolution to quantise, or is not an ONNX file.
        ValueError: there are no images.
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
                nodes_to_exclude=_float_nodes(model, source),
            )  # fmt: skip
            quantized = onnx.load(str(temporary))
            onnx.helper.set_model_props(quantized, {**metadata, "precision": "int8"})
            for node in quantized.graph.node:
                node.doc_string = ""
            onnx.checker.check_model(quantized)
            onnx.save(quantized, str(temporary))


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress advice from onnxruntime about pre-processing, which is done, and about inputs with default values, which
    are intended."""
    import onnxruntime

    before = logging.getLogger().level
    logging.getLogger().setLevel(max(before, logging.ERROR))
    onnxruntime.set_default_logger_severity(_ERRORS)
    try:
        yield
    finally:
        logging.getLogger().setLevel(before)
        onnxruntime.set_default_logger_severity(_WARNINGS)


def _float_nodes(model: object, source: Path) -> list[str]:
    """Names of the convolutions that compute an output, of the sums and upsampling after them, and of the nodes that
    prepare the image."""
    graph = model.graph  # type: ignore[attr-defined]
    makes = {name: node for node in graph.node for name in node.output}
    output_nodes: list[str] = []
    results = [output.name for output in graph.output]
    while results:
        node = makes.get(results.pop())
        if node is not None and node.op_type in ("Conv", "Add", "Resize"):
            output_nodes.append(node.name)
            results += [] if node.op_type == "Conv" else list(node.input)
    convolutions = [node for node in graph.node if node.op_type == "Conv"]
    if not convolutions:
        raise ModelError(f"{source}: has no convolution to quantise; name a convolutional network")
    nodes = list(graph.node)
    before = [node.name for node in nodes[: nodes.index(convolutions[0])]]  # these act on the image itself
    return [*before, *output_nodes]


def _channels(graph: object) -> dict[str, int]:
    """Number of channels of each input."""
    inputs = graph.input  # type: ignore[attr-defined]
    return {node.name: node.type.tensor_type.shape.dim[1].dim_value for node in inputs}


class _Images:
    """Calibration images, a few at a time; onnxruntime calls `get_next` until it returns None."""

    def __init__(self, channels: dict[str, int], images: ByteArray) -> None:
        parts = np.split(images, np.cumsum(list(channels.values()))[:-1], axis=1)
        self._parts: Iterator[dict[str, Float32Array]] = (
            {name: np.multiply(part[start : start + _IMAGES_AT_ONCE], np.float32(1 / 255), dtype=np.float32)
             for name, part in zip(channels, parts, strict=True)}
            for start in range(0, len(images), _IMAGES_AT_ONCE)
        )  # fmt: skip

    def get_next(self) -> dict[str, Float32Array] | None:
        """Inputs of the next run."""
        return next(self._parts, None)
