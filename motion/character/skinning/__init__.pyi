from .baking import Baked as Baked
from .baking import BakeOptions as BakeOptions
from .baking import bake as bake
from .methods import METHODS as METHODS
from .methods import Skinner as Skinner
from .skin import Skin as Skin

__all__ = [
    "METHODS",
    "BakeOptions",
    "Baked",
    "Skin",
    "Skinner",
    "bake",
]
