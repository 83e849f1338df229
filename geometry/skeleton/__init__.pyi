from .body import BODY as BODY
from .body import BodyModel as BodyModel
from .joint_centres import JointCentres as JointCentres
from .joint_centres import centres_from_markers as centres_from_markers
from .joint_regressions import landmarks_from_markers as landmarks_from_markers
from .motion import Motion as Motion
from .skeleton import Skeleton as Skeleton
from .statistical_body import MarkerBody as MarkerBody

__all__ = [
    "BODY",
    "BodyModel",
    "JointCentres",
    "MarkerBody",
    "Motion",
    "Skeleton",
    "centres_from_markers",
    "landmarks_from_markers",
]
