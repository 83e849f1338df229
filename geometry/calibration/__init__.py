"""Reading and writing of camera calibrations, one module a format."""

from muybridge.geometry.calibration.formats.common import Calibration
from muybridge.geometry.calibration.formats.export import EXPORT_FORMATS, ExportFormat, export_calibration
from muybridge.geometry.calibration.formats.registry import (
    find_calibration,
    load_calibration,
    read_calibration,
    save_calibration,
)
from muybridge.geometry.calibration.formats.table import KNOWN_FORMATS
from muybridge.geometry.cameras.video_size import VideoFit, fit_to_video, sized_like

__all__ = [
    "EXPORT_FORMATS",
    "KNOWN_FORMATS",
    "Calibration",
    "ExportFormat",
    "VideoFit",
    "export_calibration",
    "find_calibration",
    "fit_to_video",
    "load_calibration",
    "read_calibration",
    "save_calibration",
    "sized_like",
]
