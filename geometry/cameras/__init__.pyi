from .camera import CAMERA_MODELS as CAMERA_MODELS
from .camera import Camera as Camera
from .camera import camera_from_colmap as camera_from_colmap
from .camera import colmap_camera as colmap_camera
from .crops import Crops as Crops
from .crops import crops_for_boxes as crops_for_boxes
from .group import CameraGroup as CameraGroup
from .rays import midpoint as midpoint
from .rays import nearest_points as nearest_points
from .rays import pair_points as pair_points
from .rays import ray_directions as ray_directions
from .video_size import FitAssumption as FitAssumption
from .video_size import VideoFit as VideoFit
from .video_size import fit_to_video as fit_to_video
from .video_size import guess_calibrated_size as guess_calibrated_size

__all__ = [
    "CAMERA_MODELS",
    "Camera",
    "CameraGroup",
    "Crops",
    "FitAssumption",
    "VideoFit",
    "camera_from_colmap",
    "colmap_camera",
    "crops_for_boxes",
    "fit_to_video",
    "midpoint",
    "nearest_points",
    "pair_points",
    "ray_directions",
    "guess_calibrated_size",
]
