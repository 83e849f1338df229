from .retarget import Retargeted as Retargeted
from .retarget import RetargetOptions as RetargetOptions
from .retarget import retarget as retarget
from .soles import Soles as Soles
from .soles import measure_soles as measure_soles

__all__ = [
    "RetargetOptions",
    "Retargeted",
    "Soles",
    "measure_soles",
    "retarget",
]
