from .left_right import FlipOptions as FlipOptions
from .left_right import repair_flips as repair_flips
from .mirrored import find_mirrored as find_mirrored
from .multiview import TriangulateOptions as TriangulateOptions
from .multiview import Triangulation as Triangulation
from .multiview import take_noise as take_noise
from .multiview import triangulate as triangulate
from .plausibility import stretched_limbs as stretched_limbs
from .plausibility import uncertain_points as uncertain_points
from .shape_prior import PosePriorOptions as PosePriorOptions
from .shape_prior import apply_pose_prior as apply_pose_prior
from .validation import leave_one_out_error as leave_one_out_error
from .validation import leave_one_out_summary as leave_one_out_summary
from .view_bias import ViewBias as ViewBias
from .view_bias import ViewBiasOptions as ViewBiasOptions
from .view_bias import learn_view_bias as learn_view_bias
from .view_bias import remove_view_bias as remove_view_bias

__all__ = [
    "FlipOptions",
    "PosePriorOptions",
    "TriangulateOptions",
    "Triangulation",
    "ViewBias",
    "ViewBiasOptions",
    "find_mirrored",
    "learn_view_bias",
    "leave_one_out_error",
    "leave_one_out_summary",
    "repair_flips",
    "stretched_limbs",
    "take_noise",
    "triangulate",
    "uncertain_points",
    "apply_pose_prior",
    "remove_view_bias",
]
