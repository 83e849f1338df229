from .formats.common import Calibration as Calibration
from .formats.export import EXPORT_FORMATS as EXPORT_FORMATS
from .formats.export import ExportFormat as ExportFormat
from .formats.export import export_calibration as export_calibration
from .formats.registry import find_calibration as find_calibration
from .formats.registry import load_calibration as load_calibration
from .formats.registry import read_calibration as read_calibration
from .formats.registry import save_calibration as save_calibration
from .formats.table import KNOWN_FORMATS as KNOWN_FORMATS
from .gravity import level_cameras as level_cameras
from .gravity import level_transform as level_transform
from .resection import KnownPoints as KnownPoints
from .resection import PointsCalibration as PointsCalibration
from .resection import calibrate_points as calibrate_points
from .structure_from_motion import ScanCalibration as ScanCalibration
from .structure_from_motion import ScanOptions as ScanOptions
from .structure_from_motion import calibrate_scan as calibrate_scan

__all__ = [
    "Calibration",
    "EXPORT_FORMATS",
    "ExportFormat",
    "KNOWN_FORMATS",
    "KnownPoints",
    "PointsCalibration",
    "ScanCalibration",
    "ScanOptions",
    "calibrate_points",
    "calibrate_scan",
    "export_calibration",
    "find_calibration",
    "level_transform",
    "level_cameras",
    "load_calibration",
    "read_calibration",
    "save_calibration",
]
