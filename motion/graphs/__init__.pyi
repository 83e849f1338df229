from .components import Choice as Choice
from .distances import WindowFeatures as WindowFeatures
from .distances import distance_block as distance_block
from .distances import window_features as window_features
from .files import load_graph as load_graph
from .files import save_graph as save_graph
from .following import FollowOptions as FollowOptions
from .following import follow_path as follow_path
from .graph import Built as Built
from .graph import GraphOptions as GraphOptions
from .graph import MotionGraph as MotionGraph
from .graph import build_graph as build_graph
from .minima import Minima as Minima
from .minima import find_minima as find_minima
from .paths import Deviation as Deviation
from .paths import FloorPath as FloorPath
from .paths import deviation as deviation
from .paths import floor_path as floor_path
from .paths import read_floor_path as read_floor_path
from .transitions import Transitions as Transitions
from .walks import Walk as Walk
from .walks import action_walk as action_walk
from .walks import random_walk as random_walk
from .walks import walk_motion as walk_motion

__all__ = [
    "Built",
    "Choice",
    "Deviation",
    "FloorPath",
    "FollowOptions",
    "GraphOptions",
    "Minima",
    "MotionGraph",
    "Transitions",
    "Walk",
    "WindowFeatures",
    "action_walk",
    "build_graph",
    "deviation",
    "distance_block",
    "find_minima",
    "floor_path",
    "follow_path",
    "load_graph",
    "random_walk",
    "read_floor_path",
    "save_graph",
    "walk_motion",
    "window_features",
]
