from .bands import MotionBands as MotionBands
from .bands import scale_bands as scale_bands
from .bands import split_bands as split_bands

__all__ = [
    "MotionBands",
    "scale_bands",
    "split_bands",
]
