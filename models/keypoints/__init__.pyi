from .decode import DecodedHeatmaps as DecodedHeatmaps
from .decode import decode_heatmaps as decode_heatmaps
from .decode import with_expectation as with_expectation
from .external import ModelCard as ModelCard
from .external import find_card as find_card
from .external import load_card as load_card
from .external import shipped_cards as shipped_cards
from .metadata import KeypointModelCard as KeypointModelCard
from .metadata import crop_side as crop_side
from .metadata import keypoint_card as keypoint_card
from .network import KeypointNet as KeypointNet
from .simcc import decode_simcc as decode_simcc
from .simcc import decode_value_heatmaps as decode_value_heatmaps
from .test_time import Series as Series
from .test_time import augment_at_test_time as augment_at_test_time
from .test_time import mean_of_mirrored as mean_of_mirrored

__all__ = [
    "DecodedHeatmaps",
    "KeypointModelCard",
    "KeypointNet",
    "ModelCard",
    "Series",
    "augment_at_test_time",
    "crop_side",
    "decode_heatmaps",
    "decode_simcc",
    "decode_value_heatmaps",
    "find_card",
    "keypoint_card",
    "load_card",
    "mean_of_mirrored",
    "shipped_cards",
    "with_expectation",
]
