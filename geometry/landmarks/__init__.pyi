from .arrays import Keypoints2D as Keypoints2D
from .arrays import Points3D as Points3D
from .arrays import select_markers as select_markers
from .marker_sets import CMU as CMU
from .marker_sets import PLUG_IN_GAIT as PLUG_IN_GAIT
from .marker_sets import SURFACE as SURFACE
from .marker_sets import MarkerPlan as MarkerPlan
from .marker_sets import MarkerSet as MarkerSet
from .sets import BODY23 as BODY23
from .sets import LandmarkSet as LandmarkSet

__all__ = [
    "BODY23",
    "CMU",
    "Keypoints2D",
    "LandmarkSet",
    "MarkerPlan",
    "MarkerSet",
    "PLUG_IN_GAIT",
    "Points3D",
    "SURFACE",
    "select_markers",
]
