from .corrections import apply_corrections as apply_corrections
from .corrections import read_corrections as read_corrections
from .label import Labelled as Labelled
from .label import LabelOptions as LabelOptions
from .label import label_points as label_points
from .learn_set import learn_marker_set as learn_marker_set

__all__ = [
    "LabelOptions",
    "Labelled",
    "apply_corrections",
    "label_points",
    "learn_marker_set",
    "read_corrections",
]
