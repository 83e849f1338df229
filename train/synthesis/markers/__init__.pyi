from .augment import CloudOptions as CloudOptions
from .augment import CloudSampler as CloudSampler
from .trajectories import MarkerBodies as MarkerBodies
from .trajectories import MarkerClips as MarkerClips
from .trajectories import load_marker_clips as load_marker_clips
from .trajectories import make_marker_clips as make_marker_clips

__all__ = [
    "CloudOptions",
    "CloudSampler",
    "MarkerBodies",
    "MarkerClips",
    "load_marker_clips",
    "make_marker_clips",
]
