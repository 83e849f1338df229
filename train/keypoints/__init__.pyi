from .evaluate import evaluate_onnx as evaluate_onnx
from .evaluate import load_model as load_model
from .export import publish_keypoints as publish_keypoints
from .options import Adaptation as Adaptation
from .options import Evaluation as Evaluation
from .options import KeypointTraining as KeypointTraining

__all__ = [
    "Adaptation",
    "Evaluation",
    "KeypointTraining",
    "evaluate_onnx",
    "load_model",
    "publish_keypoints",
]
