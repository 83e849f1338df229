from .solve import WEIGHT_METHODS as WEIGHT_METHODS
from .solve import WeightOptions as WeightOptions
from .solve import packed_weights as packed_weights
from .solve import skin_weights as skin_weights

__all__ = [
    "WEIGHT_METHODS",
    "WeightOptions",
    "packed_weights",
    "skin_weights",
]
