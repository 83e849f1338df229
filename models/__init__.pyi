from .pseudo_labels import PseudoLabels as PseudoLabels
from .pseudo_labels import load_pseudo_labels as load_pseudo_labels
from .pseudo_labels import save_pseudo_labels as save_pseudo_labels
from .shipped import ModelKind as ModelKind
from .shipped import Precision as Precision
from .shipped import shipped_model as shipped_model
from .uncertainty import SpreadCalibration as SpreadCalibration

__all__ = [
    "ModelKind",
    "Precision",
    "PseudoLabels",
    "SpreadCalibration",
    "load_pseudo_labels",
    "save_pseudo_labels",
    "shipped_model",
]
