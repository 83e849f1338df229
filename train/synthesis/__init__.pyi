from .options import Synthesis as Synthesis

__all__ = [
    "Synthesis",
]
