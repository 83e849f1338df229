from .capsules import Capsules as Capsules
from .capsules import find_capsules as find_capsules
from .link_roles import LinkRoles as LinkRoles
from .link_roles import find_link_roles as find_link_roles
from .read import is_robot as is_robot
from .read import read_robot as read_robot
from .retarget import RobotMotion as RobotMotion
from .retarget import RobotOptions as RobotOptions
from .retarget import RobotQuality as RobotQuality
from .retarget import RobotTake as RobotTake
from .retarget import retarget_to_robot as retarget_to_robot
from .robot import Joint as Joint
from .robot import Mimic as Mimic
from .robot import Robot as Robot
from .robot import Shape as Shape
from .solver import SolveOptions as SolveOptions
from .write import write_robot_motion as write_robot_motion

__all__ = [
    "Capsules",
    "Joint",
    "LinkRoles",
    "Mimic",
    "Robot",
    "RobotMotion",
    "RobotOptions",
    "RobotQuality",
    "RobotTake",
    "Shape",
    "SolveOptions",
    "find_capsules",
    "find_link_roles",
    "is_robot",
    "read_robot",
    "retarget_to_robot",
    "write_robot_motion",
]
