from .take import Take as Take
from .take import points_of_motion as points_of_motion

__all__ = [
    "Take",
    "points_of_motion",
]
