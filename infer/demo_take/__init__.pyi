from .take import demo_folder as demo_folder
from .take import true_points as true_points

__all__ = [
    "demo_folder",
    "true_points",
]
