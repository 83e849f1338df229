from .export import export_onnx as export_onnx
from .export import write_onnx as write_onnx
from .import_weights import keypoint_net_from_onnx as keypoint_net_from_onnx
from .import_weights import people_net_from_onnx as people_net_from_onnx
from .prune_outputs import without_outputs as without_outputs
from .quantization import int8_path as int8_path
from .quantization import quantize as quantize

__all__ = [
    "export_onnx",
    "int8_path",
    "keypoint_net_from_onnx",
    "people_net_from_onnx",
    "quantize",
    "without_outputs",
    "write_onnx",
]
