from . import animals as animals
from . import cars as cars
from . import cycles as cycles
from . import household as household
from . import mobility as mobility
from . import music as music
from . import seats as seats
from . import sport as sport
from . import tables as tables

__all__ = [
    "animals",
    "cars",
    "cycles",
    "household",
    "mobility",
    "music",
    "seats",
    "sport",
    "tables",
]
