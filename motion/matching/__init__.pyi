from .controller import Steered as Steered
from .controller import SteerOptions as SteerOptions
from .controller import steer as steer
from .database import Built as Built
from .database import Ignored as Ignored
from .database import MatchDatabase as MatchDatabase
from .database import build_database as build_database
from .features import FeatureOptions as FeatureOptions
from .files import read_database as read_database
from .files import write_database as write_database
from .goals import Goal as Goal
from .goals import Path as Path
from .goals import Stick as Stick
from .goals import Wanted as Wanted
from .search import BoxTree as BoxTree

__all__ = [
    "BoxTree",
    "Built",
    "FeatureOptions",
    "Goal",
    "Ignored",
    "MatchDatabase",
    "Path",
    "SteerOptions",
    "Steered",
    "Stick",
    "Wanted",
    "build_database",
    "read_database",
    "steer",
    "write_database",
]
