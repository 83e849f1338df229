from .soles import Soles as Soles
from .soles import measure_soles as measure_soles
from .solver import Retargeted as Retargeted
from .solver import RetargetOptions as RetargetOptions
from .solver import retarget as retarget

__all__ = [
    "RetargetOptions",
    "Retargeted",
    "Soles",
    "measure_soles",
    "retarget",
]
