"""Inverse kinematics of chains and trees of hinges: all classical methods behind one interface."""

from muybridge.geometry.ik.pose_prior import PosePrior, fit_prior, load_prior, save_prior
from muybridge.geometry.ik.solver import METHODS, IkOptions, IkResult, solve_ik
from muybridge.geometry.ik.tree import Goal, KinematicTree, chain_of_balls, tree_of_skeleton

__all__ = [
    "METHODS",
    "Goal",
    "IkOptions",
    "IkResult",
    "KinematicTree",
    "PosePrior",
    "chain_of_balls",
    "fit_prior",
    "load_prior",
    "save_prior",
    "solve_ik",
    "tree_of_skeleton",
]
