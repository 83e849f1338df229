from .sample import Outfit as Outfit
from .sample import bare_outfit as bare_outfit
from .sample import sample_outfit as sample_outfit

__all__ = [
    "Outfit",
    "bare_outfit",
    "sample_outfit",
]
