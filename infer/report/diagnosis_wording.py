"""What a user of the command line can do about the faults that a calibration diagnosis reports."""

from muybridge.geometry.calibration.diagnosis.findings import CalibrationDiagnosis, Fault

_RECALIBRATE = "Calibrate it again, or run with --refine-cameras."
_RECALIBRATE_ALL = "Calibrate all of them again, or run with --refine-cameras."
_FOCAL = "Calibrate its lens again, with zoom, focus and stabilisation as they were in the videos."
_ADVICE = {"turned": _RECALIBRATE, "moved": _RECALIBRATE, "focal": _FOCAL,
           "shifted": "Align the videos with: muybridge sync.", "swapped": "Rename the files.",
           "unrelated": "Check which video and which calibration belong to it."}  # fmt: skip


def fault_text(fault: Fault) -> str:
    """The description of a fault, and what to do about it where a command helps."""
    advice = _ADVICE.get(fault.kind)
    if fault.rivals and advice == _RECALIBRATE:
        advice = _RECALIBRATE_ALL
    return fault.sentence if advice is None else f"{fault.sentence} {advice}"


def note_text(diagnosis: CalibrationDiagnosis) -> str:
    """What a diagnosis could not determine, and what to do about it; empty where it determined everything."""
    if diagnosis.too_many:
        return f"{diagnosis.note} Calibrate all cameras again, or run with --refine-cameras."
    return diagnosis.note


def diagnosis_text(diagnosis: CalibrationDiagnosis) -> str:
    """All faults and what could not be determined, with what to do about them."""
    if not diagnosis.faults:
        return note_text(diagnosis) or diagnosis.sentence
    return " ".join(filter(None, [*(fault_text(f) for f in diagnosis.faults), note_text(diagnosis)]))
