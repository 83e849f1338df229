from . import figure as figure
from . import hands as hands
from . import leaning as leaning
from . import lifting as lifting
from . import lying as lying
from . import moving as moving
from . import playing as playing
from . import riding as riding
from . import sitting as sitting
from . import standing as standing

__all__ = [
    "figure",
    "hands",
    "leaning",
    "lifting",
    "lying",
    "moving",
    "playing",
    "riding",
    "sitting",
    "standing",
]
