from .alignment import PlanarTransform as PlanarTransform
from .alignment import cloud_windows as cloud_windows
from .alignment import place_at as place_at
from .alignment import planar_alignment as planar_alignment
from .alignment import point_cloud as point_cloud
from .blend import Blended as Blended
from .blend import Weights as Weights
from .blend import blend_motions as blend_motions
from .blend import plant_blend as plant_blend
from .joins.inertialising import inertial_decay as inertial_decay
from .joins.inertialising import inertialise as inertialise
from .joins.inertialising import rotation_offsets as rotation_offsets
from .joins.join_places import JoinPlace as JoinPlace
from .joins.join_places import find_joins as find_joins
from .joins.joining import Joined as Joined
from .joins.joining import join_motions as join_motions
from .joins.joining import peak_acceleration as peak_acceleration
from .joins.transitions import JoinOptions as JoinOptions
from .joins.transitions import transition as transition
from .material import facing_frames as facing_frames
from .material import same_skeleton as same_skeleton
from .registration import RegistrationCurve as RegistrationCurve
from .registration import RegistrationOptions as RegistrationOptions
from .registration import register as register

__all__ = [
    "Blended",
    "JoinOptions",
    "JoinPlace",
    "Joined",
    "PlanarTransform",
    "RegistrationCurve",
    "RegistrationOptions",
    "Weights",
    "blend_motions",
    "cloud_windows",
    "facing_frames",
    "find_joins",
    "inertial_decay",
    "inertialise",
    "join_motions",
    "peak_acceleration",
    "place_at",
    "planar_alignment",
    "plant_blend",
    "point_cloud",
    "register",
    "rotation_offsets",
    "same_skeleton",
    "transition",
]
