from .export import publish_labels as publish_labels
from .options import LabelTraining as LabelTraining

__all__ = [
    "LabelTraining",
    "publish_labels",
]
