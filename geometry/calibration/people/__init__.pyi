from .calibrate import PeopleCalibration as PeopleCalibration
from .calibrate import PeopleCalibrationOptions as PeopleCalibrationOptions
from .calibrate import calibrate_people as calibrate_people
from .calibrate import refine_people as refine_people

__all__ = [
    "PeopleCalibration",
    "PeopleCalibrationOptions",
    "calibrate_people",
    "refine_people",
]
