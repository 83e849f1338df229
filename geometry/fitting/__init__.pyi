from .body_fit import BodyFit as BodyFit
from .body_fit import FitOptions as FitOptions
from .body_fit import fit_body as fit_body
from .body_fit import landmarks_from_motion as landmarks_from_motion
from .marker_fit import MarkerFit as MarkerFit
from .marker_fit import fit_markers as fit_markers
from .scaling import calibrate_skeleton as calibrate_skeleton
from .skeleton_fit import OnlineFit as OnlineFit
from .skeleton_fit import Rigging as Rigging
from .skeleton_fit import SkeletonFit as SkeletonFit
from .skeleton_fit import SkeletonFitOptions as SkeletonFitOptions
from .skeleton_fit import fit_online as fit_online
from .skeleton_fit import fit_take as fit_take
from .skeleton_fit import joint_rigging as joint_rigging
from .subject import MarkerFitOptions as MarkerFitOptions
from .subject import Person as Person
from .subject import calibrate_person as calibrate_person

__all__ = [
    "BodyFit",
    "FitOptions",
    "MarkerFit",
    "MarkerFitOptions",
    "OnlineFit",
    "Person",
    "Rigging",
    "SkeletonFit",
    "SkeletonFitOptions",
    "calibrate_person",
    "calibrate_skeleton",
    "fit_body",
    "fit_markers",
    "fit_online",
    "fit_take",
    "joint_rigging",
    "landmarks_from_motion",
]
