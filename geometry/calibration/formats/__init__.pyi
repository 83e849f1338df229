from .common import Calibration as Calibration
from .export import EXPORT_FORMATS as EXPORT_FORMATS
from .export import ExportFormat as ExportFormat
from .export import export_calibration as export_calibration
from .export import export_texts as export_texts
from .registry import find_calibration as find_calibration
from .registry import load_calibration as load_calibration
from .registry import read_calibration as read_calibration
from .registry import save_calibration as save_calibration
from .table import KNOWN_FORMATS as KNOWN_FORMATS
from .table import CalibrationFormat as CalibrationFormat

__all__ = [
    "Calibration",
    "CalibrationFormat",
    "EXPORT_FORMATS",
    "ExportFormat",
    "KNOWN_FORMATS",
    "export_calibration",
    "export_texts",
    "find_calibration",
    "load_calibration",
    "read_calibration",
    "save_calibration",
]
