from .aliases import body_landmark as body_landmark
from .aliases import map_body as map_body
from .aliases import map_surface as map_surface
from .body import BODY as BODY
from .body import Body as Body
from .body import BodyModel as BodyModel
from .body import prior_shape as prior_shape
from .functional_centres import score_centre as score_centre
from .functional_centres import segment_poses as segment_poses
from .functional_centres import sphere_centre as sphere_centre
from .joint_centres import JointCentres as JointCentres
from .joint_centres import centres_from_markers as centres_from_markers
from .joint_regressions import landmarks_from_markers as landmarks_from_markers
from .local_frames import motion_frames as motion_frames
from .local_frames import own_axes as own_axes
from .local_frames import rest_frames as rest_frames
from .mass import SEGMENTS as SEGMENTS
from .mass import Segment as Segment
from .mass import centre_of_mass as centre_of_mass
from .motion import Motion as Motion
from .profiles import PROFILES as PROFILES
from .profiles import ROLES as ROLES
from .profiles import detect_profile as detect_profile
from .profiles import rename as rename
from .profiles import role_limits as role_limits
from .profiles import roles_of as roles_of
from .profiles import with_limits as with_limits
from .skeleton import Skeleton as Skeleton
from .statistical_body import MarkerBody as MarkerBody

__all__ = [
    "BODY",
    "Body",
    "BodyModel",
    "JointCentres",
    "MarkerBody",
    "Motion",
    "PROFILES",
    "ROLES",
    "SEGMENTS",
    "Segment",
    "Skeleton",
    "body_landmark",
    "centre_of_mass",
    "centres_from_markers",
    "detect_profile",
    "landmarks_from_markers",
    "map_body",
    "map_surface",
    "motion_frames",
    "own_axes",
    "prior_shape",
    "rename",
    "rest_frames",
    "role_limits",
    "roles_of",
    "score_centre",
    "segment_poses",
    "sphere_centre",
    "with_limits",
]
