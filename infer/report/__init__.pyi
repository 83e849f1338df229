from .calibration_page import CalibrationPage as CalibrationPage
from .calibration_page import render_calibration as render_calibration
from .data import ReportData as ReportData
from .findings import Finding as Finding
from .page import pick_thumbnail_frames as pick_thumbnail_frames
from .page import problems as problems
from .page import render_report as render_report
from .page import write_report as write_report

__all__ = [
    "CalibrationPage",
    "Finding",
    "ReportData",
    "pick_thumbnail_frames",
    "problems",
    "render_calibration",
    "render_report",
    "write_report",
]
