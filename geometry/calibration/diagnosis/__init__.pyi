from .faults import diagnose as diagnose
from .findings import CalibrationDiagnosis as CalibrationDiagnosis
from .findings import DiagnosisOptions as DiagnosisOptions
from .findings import Fault as Fault
from .quality import CalibrationQuality as CalibrationQuality
from .quality import ImagePicture as ImagePicture
from .quality import Plan as Plan
from .quality import check_solved as check_solved
from .quality import check_take as check_take

__all__ = [
    "CalibrationDiagnosis",
    "CalibrationQuality",
    "DiagnosisOptions",
    "Fault",
    "ImagePicture",
    "Plan",
    "check_solved",
    "check_take",
    "diagnose",
]
