from .figure import Figure as Figure
from .figure import posed as posed

__all__ = [
    "Figure",
    "posed",
]
