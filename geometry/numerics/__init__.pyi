from .robust import extent as extent
from .robust import median_known as median_known
from .robust import row_median as row_median
from .robust import student_cost as student_cost
from .robust import student_scale as student_scale
from .robust import student_weight as student_weight
from .rotations import conjugate_quat as conjugate_quat
from .rotations import continuous_quat as continuous_quat
from .rotations import exp_so3 as exp_so3
from .rotations import kabsch as kabsch
from .rotations import left_jacobian_so3 as left_jacobian_so3
from .rotations import log_so3 as log_so3
from .rotations import matrix_from_quat as matrix_from_quat
from .rotations import matrix_from_swing_twist as matrix_from_swing_twist
from .rotations import multiply_quat as multiply_quat
from .rotations import quat_from_matrix as quat_from_matrix
from .rotations import quat_from_rotation as quat_from_rotation
from .rotations import quat_from_rotvec as quat_from_rotvec
from .rotations import rotvec_from_quat as rotvec_from_quat
from .rotations import slerp as slerp
from .rotations import swing_twist_from_matrix as swing_twist_from_matrix

__all__ = [
    "conjugate_quat",
    "continuous_quat",
    "exp_so3",
    "extent",
    "kabsch",
    "left_jacobian_so3",
    "log_so3",
    "matrix_from_quat",
    "matrix_from_swing_twist",
    "median_known",
    "multiply_quat",
    "quat_from_matrix",
    "quat_from_rotation",
    "quat_from_rotvec",
    "rotvec_from_quat",
    "row_median",
    "slerp",
    "student_cost",
    "student_scale",
    "student_weight",
    "swing_twist_from_matrix",
]
