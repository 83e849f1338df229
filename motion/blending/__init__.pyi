from .alignment import PlanarTransform as PlanarTransform
from .alignment import cloud_windows as cloud_windows
from .alignment import place_at as place_at
from .alignment import planar_alignment as planar_alignment
from .alignment import point_cloud as point_cloud
from .inertialising import inertial_decay as inertial_decay
from .inertialising import inertialise as inertialise
from .inertialising import rotation_offsets as rotation_offsets
from .material import facing_frames as facing_frames
from .material import same_skeleton as same_skeleton

__all__ = [
    "PlanarTransform",
    "cloud_windows",
    "facing_frames",
    "inertial_decay",
    "inertialise",
    "place_at",
    "planar_alignment",
    "point_cloud",
    "rotation_offsets",
    "same_skeleton",
]
