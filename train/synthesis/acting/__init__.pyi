from .acts import ACTS as ACTS

__all__ = [
    "ACTS",
]
