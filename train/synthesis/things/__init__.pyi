from .scene import Posed as Posed
from .scene import Scene as Scene
from .scene import Thing as Thing

__all__ = [
    "Posed",
    "Scene",
    "Thing",
]
