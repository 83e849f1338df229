from .amc import read_amc as read_amc
from .amc import write_amc as write_amc
from .asf import read_asf as read_asf
from .bvh import read_bvh as read_bvh
from .bvh import write_bvh as write_bvh
from .bvh_units import read_bvh_take as read_bvh_take
from .mot import read_mot as read_mot
from .mot import write_mot as write_mot
from .opensim import Coordinates as Coordinates
from .opensim import coordinates_of as coordinates_of
from .opensim import motion_of as motion_of
from .storage import read_storage as read_storage
from .usd import write_usda as write_usda

__all__ = [
    "Coordinates",
    "coordinates_of",
    "motion_of",
    "read_amc",
    "read_asf",
    "read_bvh",
    "read_bvh_take",
    "read_mot",
    "read_storage",
    "write_amc",
    "write_bvh",
    "write_mot",
    "write_usda",
]
