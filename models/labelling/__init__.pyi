from .metadata import LabelModelCard as LabelModelCard
from .metadata import label_card as label_card
from .network import LabelNet as LabelNet

__all__ = [
    "LabelModelCard",
    "LabelNet",
    "label_card",
]
