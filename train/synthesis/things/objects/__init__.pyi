from .animals import dog as dog
from .animals import horse as horse
from .cycles import bicycle as bicycle
from .cycles import motorbike as motorbike
from .mobility import walker as walker
from .mobility import wheelchair as wheelchair
from .seats import chair as chair
from .tables import table as table

__all__ = [
    "bicycle",
    "chair",
    "dog",
    "horse",
    "motorbike",
    "table",
    "walker",
    "wheelchair",
]
