from .pose_prior import PosePrior as PosePrior
from .pose_prior import fit_prior as fit_prior
from .pose_prior import load_prior as load_prior
from .pose_prior import save_prior as save_prior
from .solver import METHODS as METHODS
from .solver import IkOptions as IkOptions
from .solver import IkResult as IkResult
from .solver import solve_ik as solve_ik
from .tree import Goal as Goal
from .tree import KinematicTree as KinematicTree
from .tree import chain_of_balls as chain_of_balls
from .tree import tree_of_skeleton as tree_of_skeleton
from .two_bone import move_two_bone as move_two_bone
from .two_bone import solve_two_bone as solve_two_bone

__all__ = [
    "Goal",
    "IkOptions",
    "IkResult",
    "KinematicTree",
    "METHODS",
    "PosePrior",
    "chain_of_balls",
    "fit_prior",
    "load_prior",
    "move_two_bone",
    "save_prior",
    "solve_ik",
    "solve_two_bone",
    "tree_of_skeleton",
]
