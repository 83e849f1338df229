from .filters import FilterOptions as FilterOptions
from .filters import hampel as hampel
from .filters import residual_cutoff as residual_cutoff
from .filters import smooth as smooth
from .filters import smooth_rotations as smooth_rotations
from .gaps import GAP_METHODS as GAP_METHODS
from .gaps import GapOptions as GapOptions
from .gaps import fill_gaps as fill_gaps
from .kalman import SmoothOptions as SmoothOptions
from .kalman import clean_points as clean_points
from .kalman import smooth_points as smooth_points

__all__ = [
    "FilterOptions",
    "GAP_METHODS",
    "GapOptions",
    "SmoothOptions",
    "clean_points",
    "fill_gaps",
    "hampel",
    "residual_cutoff",
    "smooth",
    "smooth_points",
    "smooth_rotations",
]
