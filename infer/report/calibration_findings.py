"""What is wrong with a calibration, in sentences."""

from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality
from muybridge.infer.report.diagnosis_wording import fault_text, note_text
from muybridge.infer.report.findings import Finding, sort_findings

# A focal length known less well than this makes depth and size a guess.
_FOCAL_LOOK, _FOCAL_BAD = 0.01, 0.03
_POSITION_LOOK = 0.03
_COVERED_LOOK = 0.35
_LOW_PX = 2.0


def calibration_findings(quality: CalibrationQuality | None) -> tuple[Finding, ...]:
    """What is wrong with a calibration, the worst first: faulty cameras, then what is not known well enough."""
    found: list[Finding] = []
    if quality is None:
        return ()
    report = quality.diagnosis
    if report is not None:
        found += [Finding("bad", fault_text(fault)) for fault in report.faults]
        if report.note:
            found.append(Finding("note", note_text(report)))
        if report.doubt:
            found.append(Finding("note", report.doubt))
    found += [Finding("bad" if m.grave else "look", m.sentence) for m in quality.misfits]
    if quality.fitted:
        found += _known_findings(quality)
    return sort_findings(found)


def _known_findings(quality: CalibrationQuality) -> list[Finding]:
    """Numbers that a low residual hides: focal lengths and positions that the observations do not tell."""
    found = []
    for c, camera in enumerate(quality.cameras):
        focal, position = quality.focal_sd[c], quality.position_sd[c]
        residual = f"{quality.residual_px[c]:.2f} px"
        proof = f", though its residual is {residual}: a low residual is no proof here"
        if not quality.residual_px[c] < _LOW_PX:
            proof = f", and its residual is {residual}"
        if focal > _FOCAL_LOOK:
            found.append(
                Finding(
                    "bad" if focal > _FOCAL_BAD else "look",
                    f"The focal length of {camera.name} is only known to ±{100 * focal:.1f} %{proof}. Show the board "
                    "at other distances and tilted, or take the lens from a calibration of its own.",
                )
            )
        if position > _POSITION_LOOK:
            found.append(
                Finding(
                    "look",
                    f"The position of {camera.name} is only known to ±{1000 * position:.0f} mm: it shares too few "
                    "views with the others, or all from one place.",
                )
            )
    little = [
        f"{camera.name} ({100 * picture.covered:.0f} %)"
        for camera, picture in zip(quality.cameras, quality.pictures, strict=True)
        if picture.covered < _COVERED_LOOK
    ]
    if little:
        found.append(
            Finding(
                "look",
                f"Little of the image was covered in {', '.join(little)}: towards the edges the lens's distortion is "
                "a guess. Show the board all over each image.",
            )
        )
    return found
