from .blobs import BlobOptions as BlobOptions
from .blobs import find_blobs as find_blobs
from .blobs import find_threshold as find_threshold
from .detect import CameraResult as CameraResult
from .detect import DetectOptions as DetectOptions
from .detect import first_pass as first_pass
from .pose_estimator import KeypointOptions as KeypointOptions
from .pose_estimator import PoseEstimator as PoseEstimator
from .refine import RefinementOptions as RefinementOptions
from .refine import TopDownRefinement as TopDownRefinement
from .tracker import Tracker as Tracker
from .tracker import TrackOptions as TrackOptions
from .tracks import CameraTracks as CameraTracks
from .tracks import LandmarkArrays as LandmarkArrays
from .tracks import merge_tracks as merge_tracks

__all__ = [
    "BlobOptions",
    "CameraResult",
    "CameraTracks",
    "DetectOptions",
    "KeypointOptions",
    "LandmarkArrays",
    "PoseEstimator",
    "RefinementOptions",
    "TopDownRefinement",
    "TrackOptions",
    "Tracker",
    "find_blobs",
    "find_threshold",
    "first_pass",
    "merge_tracks",
]
